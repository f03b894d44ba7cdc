"""All cases: a changed copy of a good input, and the command that reads it."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from tests.corpus import hostile
from tests.corpus.damage import damaged_bytes, damaged_json, damaged_numbers, damaged_values

TEXT = (".obj", ".gltf", ".dae", ".world", ".urdf", ".sdf", ".mtl", ".xml", ".toml", ".json", ".jsonl", ".tum", ".csv")
RUN_FILES = (
    "camera.json",
    "manifest.json",
    "config.json",
    "metrics.json",
    "frames.jsonl",
    "steps.jsonl",
    "plans.jsonl",
)


@dataclass(frozen=True)
class Case:
    """One input and what reads it."""

    name: str
    kind: str
    """Which of the good inputs is copied; its folder becomes ``in``."""
    change: Callable[[Path], None]
    """Changes the copy."""
    argv: tuple[str, ...]
    """Words of the command line; the working directory holds ``in``, and ``out`` is for what it makes."""


def _write(name: str, content: bytes, folder: Path) -> None:
    (folder / name).write_bytes(content)


def _command(kind: str, file: str) -> tuple[str, ...]:
    if kind == "scene":
        return ("scene", "check", "in/room")
    if kind == "run":
        return ("eval", "in/run")
    if kind == "robot":
        return ("explore", "flat", "--robot", f"in/{file}", "--steps", "1", "--out", "out")
    if kind == "bench":
        return ("bench", f"in/{file}", "--out", "out")
    return ("scene", "import", f"in/{file}", "out", *(("--up", "z") if kind in ("obj", "ply", "stl") else ()))


def damaged_cases(paths: dict[str, Path], seed: int, per_file: int) -> Iterator[Case]:
    """Damage to every file of every input."""
    for kind, path in paths.items():
        rng = np.random.default_rng([seed, *kind.encode()])
        root = path if path.is_dir() else path.parent
        below = root.parent if path.is_dir() else root
        files = sorted(file for file in root.rglob("*") if file.is_file() and file.suffix not in (".pdf", ".svg"))
        for file in files:
            if file.parent.name == "depth" and file.stem != "000000":
                continue
            name = str(file.relative_to(below))
            content = file.read_bytes()
            argv = _command(kind, path.name)
            changes = list(damaged_bytes(content, rng, flips=per_file))
            text = content.decode(errors="replace")
            if file.suffix in TEXT:
                changes += damaged_numbers(text, rng, per_file)
            if file.suffix in (".json", ".gltf"):
                changes += damaged_json(text, rng, 4 * per_file)
            if file.suffix == ".jsonl":
                first, _, rest = text.partition("\n")
                changes += [
                    (label, line + b"\n" + rest.encode()) for label, line in damaged_json(first, rng, 3 * per_file)
                ]
            if file.suffix == ".toml":
                changes += [
                    (label, _toml(value)) for label, value in damaged_values(tomllib.loads(text), rng, 5 * per_file)
                ]
            for label, changed in changes:
                yield Case(f"{kind}: {name}: {label}", kind, partial(_write, name, changed), argv)
            for label, place in (
                ("missing", Path.unlink),
                ("a FIFO", hostile.fifo),
                ("a device", hostile.device),
                ("a folder", hostile.folder),
            ):
                yield Case(f"{kind}: {name}: {label}", kind, partial(_placed, name, place), argv)


def _placed(name: str, place: Callable[[Path], None], folder: Path) -> None:
    place(folder / name)


def _toml(value: object) -> bytes:
    """A value as TOML, as far as TOML can say it."""
    if not isinstance(value, dict):
        return repr(value).encode()
    return "".join(f"{key} = {_toml_value(entry)}\n" for key, entry in value.items()).encode()


def _toml_value(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}" = {_toml_value(entry)}' for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\0", "\\u0000") + '"'
    return "none" if value is None else repr(value)


def hostile_cases(canary: Path) -> Iterator[Case]:
    """Bombs, entities, links out of the folder; ``canary`` is a folder that nothing may read or write."""
    imports = partial(_command)
    for name, content in hostile.gltf_bombs().items():
        yield Case(f"gltf: {name}", "gltf", partial(_write, "room.gltf", content), imports("gltf", "room.gltf"))
    for levels in (5, 30, 60):
        bomb = hostile.dae_bomb(levels)
        yield Case(
            f"dae: nodes that double {levels} times",
            "dae",
            partial(_write, "room.dae", bomb),
            imports("dae", "room.dae"),
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
            yield Case(f"{kind}: {label}", kind, partial(_write, file, content), imports(kind, file))
    yield Case("world: includes itself", "world", _self_including, imports("world", "room.world"))
    yield Case("world: includes that double", "world", _doubling_includes, imports("world", "room.world"))
    yield Case("world: 3000 models", "world", _many_models, imports("world", "room.world"))
    yield Case("obj: 20,000 groups", "obj", _many_groups, imports("obj", "room.obj"))
    yield Case("obj: 20,000 materials", "obj", _many_materials, imports("obj", "room.obj"))
    yield Case("ply: 10^9 vertices", "ply", _huge_ply, imports("ply", "room.ply"))
    yield Case("ply: negative indices", "ply", _negative_ply, imports("ply", "room.ply"))
    yield Case("stl: 10^9 triangles", "stl", _huge_stl, imports("stl", "room.stl"))
    for width, height in ((60_000, 60_000), (2_000_000_000, 1), (100_000, 100)):
        bomb = partial(_write, "material_0.png", hostile.png(width, height))
        yield Case(f"obj: a texture of {width} x {height}", "obj", bomb, imports("obj", "room.obj"))
        bomb = partial(_write, "room/assets/000_room_obj.png", hostile.png(width, height))
        yield Case(f"scene: a texture of {width} x {height}", "scene", bomb, imports("scene", "room"))
        bomb = partial(_write, "run/depth/000000.png", hostile.png(width, height))
        yield Case(f"run: depth of {width} x {height}", "run", bomb, imports("run", "run"))
    yield Case("obj: a texture that is EPS", "obj", partial(_write, "material_0.png", EPS), imports("obj", "room.obj"))
    for outside in (
        f"{canary}/secret.png",
        "../canary/secret.png",
        "../../../../../../../../etc/passwd",
        "file:///etc/passwd",
        "http://127.0.0.1:9/a.png",
    ):
        yield Case(
            f"obj: texture {_last(outside)}", "obj", partial(_texture_of_mtl, outside), imports("obj", "room.obj")
        )
        yield Case(
            f"gltf: image {_last(outside)}", "gltf", partial(_image_of_gltf, outside), imports("gltf", "room.gltf")
        )
        yield Case(
            f"world: mesh {_last(outside)}", "world", partial(_mesh_of_model, outside), imports("world", "room.world")
        )
        yield Case(f"scene: file {_last(outside)}", "scene", partial(_file_of_scene, outside), imports("scene", "room"))
    for name in ("geometry.npz",):
        yield Case(
            f"scene: bomb in {name}",
            "scene",
            partial(_npz, f"room/{name}", hostile.npz_bomb, ("vertices", "faces")),
            imports("scene", "room"),
        )
        yield Case(
            f"scene: pickle in {name}",
            "scene",
            partial(_npz, f"room/{name}", hostile.pickled_npz, ("vertices", "faces")),
            imports("scene", "room"),
        )
    names = ("samples", "vertices", "faces")
    yield Case(
        "run: bomb in ground_truth.npz",
        "run",
        partial(_npz, "run/ground_truth.npz", hostile.npz_bomb, names),
        imports("run", "run"),
    )
    yield Case(
        "run: pickle in ground_truth.npz",
        "run",
        partial(_npz, "run/ground_truth.npz", hostile.pickled_npz, names),
        imports("run", "run"),
    )
    for name in (
        "metrics.json",
        "curve.csv",
        "curve.png",
        "curve.pdf",
        "curve.svg",
        "metrics.json.part",
        "manifest.json",
    ):
        yield Case(
            f"run: {name} is a link out",
            "run",
            partial(_link_out, f"run/{name}", canary / "precious"),
            imports("run", "run"),
        )
    yield Case("run: the folder is a link", "run", partial(_linked_folder), ("eval", "in/link"))
    for plan, label in PLANS:
        for kind in ("procthor", "houseexpo"):
            yield Case(f"{kind}: {label}", kind, partial(_write, "plan.json", plan), imports(kind, "plan.json"))
    for scale in (1e6, 1e9, 1e-6, 1e300):
        yield Case(f"obj: {scale:g} times as large", "obj", partial(_scaled, scale), imports("obj", "room.obj"))
        yield Case(
            f"houseexpo: {scale:g} times as large",
            "houseexpo",
            partial(_scaled_plan, scale),
            imports("houseexpo", "plan.json"),
        )
    for out in ("in/room.obj", "/dev/null", "in/room.obj/below", "a" * 300, "out\n[red]x[/b]", "-", "/proc/x", "in"):
        yield Case(f"obj: out is {out[:20]!r}", "obj", _as_it_is, ("scene", "import", "in/room.obj", out))
    for out in ("in/rover.xml", "/dev/null/x", "a" * 300, "/proc/x", "in"):
        yield Case(f"robot: out is {out[:20]!r}", "robot", _as_it_is, ("explore", "flat", "--steps", "1", "--out", out))
    for words in OPTIONS:
        yield Case(f"options: {' '.join(words)[:60]}", "robot", _as_it_is, words)


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
    import json

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
    import json

    plan = json.loads((folder / "plan.json").read_text())
    plan["verts"] = [[x * scale, y * scale] for x, y in plan["verts"]]
    (folder / "plan.json").write_text(json.dumps(plan))


def prepare(case: Case, good: dict[str, Path], folder: Path) -> None:
    """Put the changed input into ``folder/in``."""
    source = good[case.kind]
    shutil.copytree(source.parent, folder / "in", symlinks=True)
    case.change(folder / "in")
