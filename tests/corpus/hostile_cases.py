"""Inputs that ask for too much, climb out of their folder, or name what they should not, as cases."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import trimesh

from tests.corpus import hostile
from tests.corpus.cases import Case, _write
from tests.corpus.commands import commands


def hostile_cases(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Bombs, entities, links out of the folder.

    Args:
        paths: the good inputs.
        canary: a folder that nothing may read or write.
    """

    def imports(kind: str) -> tuple[str, ...]:
        return commands(kind, paths)[0]

    for name, content in hostile.gltf_bombs().items():
        yield Case(f"gltf: {name}", "gltf", partial(_write, "room.gltf", content), imports("gltf"))
    for levels in (5, 30, 60):
        bomb = hostile.dae_bomb(levels)
        yield Case(
            f"dae: nodes that double {levels} times",
            "dae",
            partial(_write, "room.dae", bomb),
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
            yield Case(f"{kind}: {label}", kind, partial(_write, file, content), imports(kind))
    yield Case("world: includes itself", "world", _self_including, imports("world"))
    yield Case("world: includes that double", "world", _doubling_includes, imports("world"))
    yield Case("world: 3000 models", "world", _many_models, imports("world"))
    yield Case("obj: 20,000 groups", "obj", _many_groups, imports("obj"))
    yield Case("obj: 20,000 materials", "obj", _many_materials, imports("obj"))
    yield Case("ply: 10^9 vertices", "ply", _huge_ply, imports("ply"))
    yield Case("ply: negative indices", "ply", _negative_ply, imports("ply"))
    yield Case("stl: 10^9 triangles", "stl", _huge_stl, imports("stl"))
    for width, height in ((60_000, 60_000), (2_000_000_000, 1), (100_000, 100)):
        bomb = partial(_write, "material_0.png", hostile.png(width, height))
        yield Case(f"obj: a texture of {width} x {height}", "obj", bomb, imports("obj"))
        bomb = partial(_write, "room/assets/000_room_obj.png", hostile.png(width, height))
        yield Case(f"scene: a texture of {width} x {height}", "scene", bomb, imports("scene"))
        bomb = partial(_write, "run/depth/000000.png", hostile.png(width, height))
        yield Case(f"run: depth of {width} x {height}", "run", bomb, imports("run"))
    yield Case("obj: a texture that is EPS", "obj", partial(_write, "material_0.png", EPS), imports("obj"))
    for outside in (
        f"{canary}/secret.png",
        "../canary/secret.png",
        "../../../../../../../../etc/passwd",
        "file:///etc/passwd",
        "http://127.0.0.1:9/a.png",
    ):
        yield Case(f"obj: texture {_last(outside)}", "obj", partial(_texture_of_mtl, outside), imports("obj"))
        yield Case(f"gltf: image {_last(outside)}", "gltf", partial(_image_of_gltf, outside), imports("gltf"))
        yield Case(f"world: mesh {_last(outside)}", "world", partial(_mesh_of_model, outside), imports("world"))
        yield Case(f"scene: file {_last(outside)}", "scene", partial(_file_of_scene, outside), imports("scene"))
    for name in ("geometry.npz",):
        yield Case(
            f"scene: bomb in {name}",
            "scene",
            partial(_npz, f"room/{name}", hostile.npz_bomb, ("vertices", "faces")),
            imports("scene"),
        )
        yield Case(
            f"scene: pickle in {name}",
            "scene",
            partial(_npz, f"room/{name}", hostile.pickled_npz, ("vertices", "faces")),
            imports("scene"),
        )
    names = ("samples", "vertices", "faces")
    yield Case(
        "run: bomb in ground_truth.npz",
        "run",
        partial(_npz, "run/ground_truth.npz", hostile.npz_bomb, names),
        imports("run"),
    )
    yield Case(
        "run: pickle in ground_truth.npz",
        "run",
        partial(_npz, "run/ground_truth.npz", hostile.pickled_npz, names),
        imports("run"),
    )
    yield from _links(paths, canary)
    yield from _worlds(paths, canary)
    yield from _sequences(paths, canary)
    yield Case("run: the folder is a link", "run", partial(_linked_folder), ("eval", "in/link"))
    for plan, label in PLANS:
        for kind in ("procthor", "houseexpo"):
            yield Case(f"{kind}: {label}", kind, partial(_write, "plan.json", plan), imports(kind))
    for scale in (1e6, 1e9, 1e-6, 1e300):
        yield Case(f"obj: {scale:g} times as large", "obj", partial(_scaled, scale), imports("obj"))
        yield Case(
            f"houseexpo: {scale:g} times as large",
            "houseexpo",
            partial(_scaled_plan, scale),
            imports("houseexpo"),
        )
    for out in ("in/room.obj", "/dev/null", "in/room.obj/below", "a" * 300, "out\n[red]x[/b]", "-", "/proc/x", "in"):
        yield Case(f"obj: out is {out[:20]!r}", "obj", _as_it_is, ("scene", "import", "in/room.obj", out))
    for out in ("in/rover.xml", "/dev/null/x", "a" * 300, "/proc/x", "in"):
        yield Case(f"robot: out is {out[:20]!r}", "robot", _as_it_is, ("explore", "flat", "--steps", "1", "--out", out))
    for words in OPTIONS:
        yield Case(f"options: {' '.join(words)[:60]}", "robot", _as_it_is, words)


def _links(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Run folders whose files are links to what must not be written."""
    for name in ("metrics.json", "curve.csv", "curve.png", "curve.pdf", "curve.svg", "metrics.json.part", "export"):
        for argv in (commands("run", paths)[0], ("export", "in/run", "--format", "all")):
            yield Case(
                f"run: {name} is a link out: {argv[0]}",
                "run",
                partial(_link_out, f"run/{name}", canary / "precious"),
                argv,
            )
    yield Case(
        "run: export is a linked folder",
        "run",
        partial(_link_out, "run/export", canary),
        ("export", "in/run", "--format", "all"),
    )
    (resume,) = commands("killed", paths)
    for name in (
        *("steps.jsonl", "frames.jsonl", "plans.jsonl", "trajectory.tum", "curve.csv", "resumed.jsonl"),
        *("metrics.json", "map.safetensors", "mesh.ply", "topdown.png", "explored.safetensors", "config.json"),
    ):
        yield Case(
            f"killed: {name} is a link out", "killed", partial(_link_out, f"run/{name}", canary / "precious"), resume
        )
    for name in ("depth", "images", "plans", "checkpoint"):
        yield Case(f"killed: {name} is a linked folder", "killed", partial(_moved_out, f"run/{name}"), resume)
        for below in ("000001.png", "000003.jpg", "000009.npz"):
            link = partial(_link_out, f"run/{name}/{below}", canary / "precious")
            yield Case(f"killed: {name}/{below} is a link out", "killed", link, resume)
    for key, value in (
        ("policy", "os:system"), ("policy", "../x:Y"), ("policy", 3), ("scene", "/dev/zero"), ("scene", "/etc"),
        ("scene", 7), ("robot", "/dev/zero"), ("robot", "/etc/passwd"), ("steps", 10**12), ("image_px", 10**9),
        ("drive", "sideways"), ("seed", -1), ("start", [1]), ("continue_from", "/etc"), ("device", "cuda"),
    ):  # fmt: skip
        change = partial(_entry, "run/config.json", key, value)
        yield Case(f"killed: config.{key} is {value!r}", "killed", change, resume)
        yield Case(
            f"run: config.{key} is {value!r}",
            "run",
            partial(_entry, "run/config.json", key, value),
            commands("run", paths)[5],
        )
    for group, key, value in (
        ("mapping.field", "log2_table_size", 40), ("mapping.field", "num_levels", 10**6),
        ("mapping.schedule", "replay_bytes", 10**15), ("mapping.schedule", "iterations", 10**9),
        ("mapping.occupancy", "voxel_m", 1e-9), ("planning", "margin_m", "x"), ("mapping.sampling", "scheme", []),
        ("record", "images", 7), ("checkpoint", "every_steps", "x"), ("mapping", "surface_lattice_m", 1e-9),
    ):  # fmt: skip
        change = partial(_nested_entry, "run/config.json", group, key, value)
        yield Case(f"killed: config.{group}.{key} is {value!r}", "killed", change, resume)


def _worlds(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """MuJoCo worlds and robots that ask for too much, or for what is not theirs."""
    for kind, file in (("mjcf", "room.xml"), ("robot", "rover.xml")):
        for label, text in hostile.mjcf_bombs().items():
            change = partial(_before, file, "</mujoco>", text)
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
                change = partial(_before, file, "</mujoco>", text)
                yield Case(f"{kind}: {words} {_last(outside)}", kind, change, commands(kind, paths)[0])


def _sequences(paths: dict[str, Path], canary: Path) -> Iterator[Case]:
    """Recorded sequences that name what is not theirs, or that unpack to too much."""
    pictures = {
        "tum": "walk/rgb/0.png", "nerfstudio": "walk/images/000.png", "replica": "walk/results/depth000000.png",
        "sequence": "walk/rgb/000000.png",
    }  # fmt: skip
    for kind, name in pictures.items():
        (argv,) = commands(kind, paths)
        for width, height in ((60_000, 60_000), (2_000_000_000, 1)):
            bomb = partial(_write, name, hostile.png(width, height))
            yield Case(f"{kind}: a picture of {width} x {height}", kind, bomb, argv)
        yield Case(f"{kind}: a picture that is EPS", kind, partial(_write, name, EPS), argv)
        yield Case(f"{kind}: a picture that is a link out", kind, partial(_link_out, name, canary / "secret.png"), argv)
        for option in (
            ("--every", "0"),
            ("--camera", "nan,nan,1,1"),
            ("--camera", "0,0,0,0"),
            ("--depth-unit", "inf"),
            ("--floor", "nan"),
            ("--depth-unit", "-1"),
            ("--radius", "nan"),
            ("--height", "inf"),
            ("--every", str(10**30)),
            ("--layout", "bag"),
        ):
            yield Case(f"{kind}: {' '.join(option)}"[:60], kind, _as_it_is, (*argv, *option))
    for outside in (f"{canary}/secret.png", "../../../canary/secret.png", "/dev/zero", "/proc/self/mem"):
        for file in ("rgb.txt", "depth.txt"):
            lines = "".join(f"{time} {outside}\n" for time in range(6)).encode()
            yield Case(
                f"tum: {file} names {_last(outside)}",
                "tum",
                partial(_write, f"walk/{file}", lines),
                *commands("tum", paths),
            )
        for key in ("file_path", "depth_file_path"):
            change = partial(_frame_entry, key, outside)
            yield Case(f"nerfstudio: {key} is {_last(outside)}", "nerfstudio", change, *commands("nerfstudio", paths))
        change = partial(_replaced, "walk/metadata.yaml", "walk.db3", outside)
        yield Case(f"bag: the file is {_last(outside)}", "bag", change, *commands("bag", paths))
    (argv,) = commands("sequence", paths)
    for label, content in (
        ("of 10^18 numbers", hostile.npy(f"({10**9}, {10**9})")),
        ("of objects", hostile.npy("(48, 64)", "|O")),
        ("of 10^9 numbers", hostile.npy("(100000, 10000)")),
        ("of text", hostile.npy("(48, 64)", "<U1")),
    ):
        yield Case(f"sequence: depth {label}", "sequence", partial(_write, "walk/depth/000000.npy", content), argv)
    for label, text in hostile.yaml_bombs().items():
        for kind in ("bag", "mcap"):
            yield Case(f"{kind}: {label}", kind, partial(_write, "walk/metadata.yaml", text), *commands(kind, paths))
    for label, content in hostile.mcap_bombs().items():
        yield Case(f"mcap: {label}", "mcap", partial(_alone, content), ("map", "in/alone.mcap", "--out", "out"))
    yield Case(
        "sequence: 10^6 poses", "sequence", partial(_write, "walk/poses.tum", b"0 0 0 1 0 0 0 1\n" * 10**6), argv
    )


ROBOT = Path(__file__).resolve().parents[1] / "rover.xml"
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
OPTIONS = (
    ("explore",),
    ("explore", ""),
    ("explore", "\0"),
    ("explore", "flat", "--steps", "1e9"),
    ("explore", "flat", "--seed", "9" * 400),
    ("explore", "flat", "--start", "1e300,0,0"),
    ("explore", "flat", "--start", "nan,0,0"),
    ("explore", "flat", "--set", "mapping.voxel_m=1e-9", "--steps", "1", "--out", "out"),
    ("explore", "flat", "--set", "=", "--steps", "1"),
    ("explore", "flat", "--set", "a.b.c.d.e=1"),
    ("explore", "flat", "--policy", "os:system"),
    ("explore", "flat", "--policy", "../../x:Y"),
    ("explore", "flat", "--sensor", "d435i", "--set", "sensor.noise_scale=-1"),
    ("explore", "flat", "--sensor", "nothing"),
    ("explore", "flat", "--robot", "/dev/zero", "--steps", "1", "--out", "out"),
    ("explore", "flat", "--robot", "missing.xml"),
    ("explore", "/dev/null"),
    ("explore", "/etc"),
    ("scene", "generate", "out", "--rooms", "0"),
    ("scene", "generate", "out", "--rooms", "1000000"),
    ("scene", "generate", "out", "--rooms", "-3"),
    ("scene", "generate", "out", "--rooms", "2", "--seed", "-1"),
    ("scene", "import", "/dev/zero", "out"),
    ("scene", "import", "/etc/passwd", "out"),
    ("scene", "import", "/proc/self/mem", "out"),
    ("scene", "check", "/etc"),
    ("scene", "check", "nothing"),
    ("eval", "/etc"),
    ("eval", "nothing"),
    ("eval", "in"),
    ("bench", "/dev/zero", "--out", "out"),
    ("bench", "nothing.toml", "--out", "out"),
    ("bench", "in", "--out", "out"),
)


def _last(path: str) -> str:
    return path if len(path) < 40 else "…" + path[-25:]


def _as_it_is(folder: Path) -> None:
    del folder


def _npz(name: str, make: Callable[[Path, tuple[str, ...]], None], names: tuple[str, ...], folder: Path) -> None:
    make(folder / name, names)


def _link_out(name: str, target: Path, folder: Path) -> None:
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target)


def _linked_folder(folder: Path) -> None:
    (folder / "link").symlink_to("link")


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


def _alone(content: bytes, folder: Path) -> None:
    (folder / "alone.mcap").write_bytes(content)


def _moved_out(name: str, folder: Path) -> None:
    """A folder of a run that lies elsewhere, with a link in its place."""
    target = folder / "elsewhere"
    (folder / name).rename(target)
    (folder / name).symlink_to(target)


def _entry(name: str, key: str, value: object, folder: Path) -> None:
    path = folder / name
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))


def _nested_entry(name: str, group: str, key: str, value: object, folder: Path) -> None:
    path = folder / name
    values = json.loads(path.read_text())
    holder = values
    for part in group.split("."):
        holder = holder[part]
    holder[key] = value
    path.write_text(json.dumps(values))


def _frame_entry(key: str, value: str, folder: Path) -> None:
    path = folder / "walk" / "transforms.json"
    facts = json.loads(path.read_text())
    for frame in facts["frames"]:
        frame[key] = value
    path.write_text(json.dumps(facts))


def _before(name: str, mark: str, text: str, folder: Path) -> None:
    path = folder / name
    path.write_text(path.read_text().replace(mark, text + mark))


def _replaced(name: str, mark: str, text: str, folder: Path) -> None:
    path = folder / name
    path.write_text(path.read_text().replace(mark, text))
