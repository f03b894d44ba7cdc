"""Scenes and robots that ask for too much, climb out of their folder, or name what they should not, as cases."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import trimesh

from tests.corpus import hostile
from tests.corpus.cases import Case
from tests.corpus.changes import (
    arrays_of,
    before,
    last,
    write,
)
from tests.corpus.commands import commands

EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\n/x (out) def\nshowpage\n%%EOF\n"
PLANS = (
    (b"[]", "a list"),
    (b"null", "null"),
    (b'{"verts": [[0,0],[1e9,0],[1e9,1e9],[0,1e9]], "room_category": {}}', "10^9 m"),
    (b'{"verts": [[0,0],[1,1],[2,2],[3,3]], "room_category": {}}', "no area"),
    (b'{"verts": [[0,0],[4,4],[4,0],[0,4]], "room_category": {}}', "a bow"),
    (b'{"verts": "abc", "room_category": []}', "text"),
    (b'{"verts": [[1e6,1e6],[1000005,1e6],[1000005,1000005],[1e6,1000005]], "room_category": {}}', "far away"),
)


def scene_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Meshes, worlds, floor plans and scene folders.

    Args:
        paths: the good inputs.
        canary: a folder that nothing may read or write.
    """

    def imports(kind: str) -> tuple[str, ...]:
        return commands(kind, paths)[0]

    for name, content in hostile.gltf_bombs().items():
        yield Case(f"gltf: {name}", "gltf", partial(write, "room.gltf", content), imports("gltf"))
    for levels in (5, 30, 60):
        bomb = hostile.dae_bomb(levels)
        yield Case(
            f"dae: nodes that double {levels} times",
            "dae",
            partial(write, "room.dae", bomb),
            imports("dae"),
        )
    for kind, file, root in (
        ("dae", "room.dae", "COLLADA"),
        ("world", "room.world", "sdf"),
        ("urdf", "room.urdf", "robot"),
        ("robot", "rover.xml", "mujoco"),
    ):
        for label, content in (
            ("entities", hostile.entities(root)),
            ("an entity from outside", hostile.outside_entity(root)),
            ("60,000 levels", hostile.nested("node")),
            ("60,000 levels within", hostile.nested(root)),
        ):
            yield Case(f"{kind}: {label}", kind, partial(write, file, content), imports(kind))
    yield Case("world: includes itself", "world", _self_including, imports("world"))
    yield Case("world: includes that double", "world", _doubling_includes, imports("world"))
    yield Case("world: 3000 models", "world", _many_models, imports("world"))
    yield Case("obj: 20,000 groups", "obj", _many_groups, imports("obj"))
    yield Case("obj: 20,000 materials", "obj", _many_materials, imports("obj"))
    yield Case("ply: 10^9 vertices", "ply", _huge_ply, imports("ply"))
    yield Case("ply: negative indices", "ply", _negative_ply, imports("ply"))
    yield Case("stl: 10^9 triangles", "stl", _huge_stl, imports("stl"))
    for width, height in ((60_000, 60_000), (2_000_000_000, 1), (100_000, 100)):
        bomb = partial(write, "material_0.png", hostile.png(width, height))
        yield Case(f"obj: a texture of {width} x {height}", "obj", bomb, imports("obj"))
        bomb = partial(write, "room/assets/000_room_obj.png", hostile.png(width, height))
        yield Case(f"scene: a texture of {width} x {height}", "scene", bomb, imports("scene"))
    yield Case("obj: a texture that is EPS", "obj", partial(write, "material_0.png", EPS), imports("obj"))
    for outside in (
        f"{canary}/secret.png",
        "../canary/secret.png",
        "../../../../../../../../etc/passwd",
        "file:///etc/passwd",
        "http://127.0.0.1:9/a.png",
    ):
        yield Case(f"obj: texture {last(outside)}", "obj", partial(_texture_of_mtl, outside), imports("obj"))
        yield Case(f"gltf: image {last(outside)}", "gltf", partial(_image_of_gltf, outside), imports("gltf"))
        yield Case(f"world: mesh {last(outside)}", "world", partial(_mesh_of_model, outside), imports("world"))
        yield Case(f"scene: file {last(outside)}", "scene", partial(_file_of_scene, outside), imports("scene"))
    for name in ("geometry.npz",):
        yield Case(
            f"scene: bomb in {name}",
            "scene",
            partial(arrays_of, f"room/{name}", hostile.npz_bomb, ("vertices", "faces")),
            imports("scene"),
        )
        yield Case(
            f"scene: pickle in {name}",
            "scene",
            partial(arrays_of, f"room/{name}", hostile.pickled_npz, ("vertices", "faces")),
            imports("scene"),
        )
    for plan, label in PLANS:
        for kind in ("procthor", "houseexpo"):
            yield Case(f"{kind}: {label}", kind, partial(write, "plan.json", plan), imports(kind))
    for scale in (1e6, 1e9, 1e-6, 1e300):
        yield Case(f"obj: {scale:g} times as large", "obj", partial(_scaled, scale), imports("obj"))
        yield Case(
            f"houseexpo: {scale:g} times as large",
            "houseexpo",
            partial(_scaled_plan, scale),
            imports("houseexpo"),
        )


def mjcf_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """MuJoCo worlds and robots that ask for too much, or for what is not theirs."""
    for kind, file in (("mjcf", "room.xml"), ("robot", "rover.xml")):
        for label, text in hostile.mjcf_bombs().items():
            change = partial(before, file, "</mujoco>", text)
            for argv in commands(kind, paths):
                yield Case(f"{kind}: {label}: {argv[0]}", kind, change, argv)
        for outside in (
            f"{canary}/secret.png",
            "../canary/secret.png",
            "/etc/passwd",
            "/dev/zero",
            "../../../../etc/passwd",
        ):
            asset = (
                f'<asset><texture name="out" type="2d" file="{outside}"/><material name="out" texture="out"/></asset>'
            )
            geom = '<worldbody><geom type="box" size="1 1 0.1" pos="0 0 -0.1" material="out"/></worldbody>'
            for words, text in (("texture", asset + geom), ("include", f'<include file="{outside}"/>')):
                change = partial(before, file, "</mujoco>", text)
                yield Case(f"{kind}: {words} {last(outside)}", kind, change, commands(kind, paths)[0])


def _self_including(folder: Path) -> None:
    model = folder / "models" / "table" / "model.sdf"
    model.write_text("<sdf version='1.6'><model name='table'><include><uri>model://table</uri></include></model></sdf>")


def _doubling_includes(folder: Path) -> None:
    for k in range(30):
        below = folder / "models" / f"m{k}"
        below.mkdir()
        inner = "table" if k == 0 else f"m{k - 1}"
        include = f"<include><uri>model://{inner}</uri></include>"
        (below / "model.config").write_text('<model><sdf version="1.6">model.sdf</sdf></model>')
        (below / "model.sdf").write_text(f"<sdf version='1.6'><model name='m{k}'>{include * 2}</model></sdf>")
    world = folder / "room.world"
    world.write_text(world.read_text().replace("model://table", "model://m29"))


def _many_models(folder: Path) -> None:
    world = folder / "room.world"
    include = "<include><uri>model://table</uri><pose>1 0 0 0 0 0</pose></include>"
    world.write_text(world.read_text().replace("</world>", include * 3000 + "</world>"))


def _many_groups(folder: Path) -> None:
    faces = "".join(
        f"g part{k}\no part{k}\nv {k % 5} {k % 3} 0\nv {k % 5} 1 1\nv 0 {k % 3} 2\nf -3 -2 -1\n" for k in range(20_000)
    )
    (folder / "room.obj").write_text(faces)


def _many_materials(folder: Path) -> None:
    faces = "".join(
        f"usemtl m{k}\nv {k % 5} {k % 3} 0\nv {k % 5} 1 1\nv 0 {k % 3} 2\nf -3 -2 -1\n" for k in range(20_000)
    )
    (folder / "room.obj").write_text("mtllib material.mtl\n" + faces)
    (folder / "material.mtl").write_text("".join(f"newmtl m{k}\nKd 0.5 0.5 0.5\n" for k in range(20_000)))


def _huge_ply(folder: Path) -> None:
    text = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 1000000000\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "room.ply").write_bytes(text.encode() + bytes(1000))


def _negative_ply(folder: Path) -> None:
    text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    text += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 -1 -2 999999\n"
    (folder / "room.ply").write_text(text)


def _huge_stl(folder: Path) -> None:
    (folder / "room.stl").write_bytes(bytes(80) + (10**9).to_bytes(4, "little") + bytes(500))


def _texture_of_mtl(path: str, folder: Path) -> None:
    (folder / "material.mtl").write_text(f"newmtl material_0\nmap_Kd {path}\n")


def _image_of_gltf(path: str, folder: Path) -> None:
    gltf = json.loads((folder / "room.gltf").read_text())
    gltf["images"] = [{"uri": path}]
    gltf["textures"] = [{"source": 0}]
    gltf["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    (folder / "room.gltf").write_text(json.dumps(gltf))


def _mesh_of_model(path: str, folder: Path) -> None:
    world = folder / "models" / "table" / "model.sdf"
    world.write_text(world.read_text().replace("model://table/meshes/table.obj", path))


def _file_of_scene(path: str, folder: Path) -> None:
    xml = folder / "room" / "scene.xml"
    text = xml.read_text()
    xml.write_text(text.replace("000_room_obj.png", path))


def _scaled(scale: float, folder: Path) -> None:
    mesh = trimesh.load_mesh(folder / "room.obj", process=False)
    mesh.vertices = mesh.vertices * scale + scale
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    (folder / "room.obj").write_text("\n".join(lines))


def _scaled_plan(scale: float, folder: Path) -> None:
    plan = json.loads((folder / "plan.json").read_text())
    plan["verts"] = [[x * scale, y * scale] for x, y in plan["verts"]]
    (folder / "plan.json").write_text(json.dumps(plan))
