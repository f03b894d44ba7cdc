"""Measures how long a picture takes, all ways of making one side by side, and how exact each is.

    python scripts/bench_camera.py --json camera.json

The scenes are the house in scenes/home with its triangles halved until there are 50,000, 200,000 and 1,000,000 of
them, textures kept. The camera goes where the robot would: steps of 65 mm and turns of 10 degrees along a walk through
the rooms. Times are medians over the pictures of the walk. A pixel is right if its depth is within a millimetre of a
ray cast through its centre.
"""

import json
import math
import os
import time
import xml.etree.ElementTree as ET
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from jaxtyping import Float
from PIL import Image
from rich.console import Console
from rich.table import Table

from anm_mj.cli.command_line import run_script
from anm_mj.frames import move_pose
from anm_mj.scene.folder import Scene, load_scene, read_scene_folder
from anm_mj.scene.mjcf import read_msh
from anm_mj.scene.navigable import scene_area
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.sim.gl import select_backend
from anm_mj.types import DEFAULT_FOOTPRINT, FORWARD_STEP_M, TURN_STEP_RAD, Pose2

CAMERA_HEIGHT_M = 1.25
IMAGE_PX = 256
Picture = tuple[np.ndarray, np.ndarray]
"""Colour and depth."""


@dataclass(frozen=True)
class Row:
    """One way of making pictures of one scene."""

    scene: str
    triangles: int
    path: str
    wall_ms: float
    """Median time of a picture by the clock [ms]."""
    cpu_ms: float
    """Median time of a picture on all cores together, which a busy machine does not change [ms]."""
    set_up_s: float
    right_share: float
    """Share of pixels whose depth is within 1 mm of an exact ray cast."""
    same_bits: bool | None
    """Whether all pictures of "GL, culled" equal, bit by bit, those with everything drawn; None for the others."""


def main(
    triangles: Annotated[list[int], tyro.conf.arg(metavar="N")] = [50_000, 200_000, 1_000_000],  # noqa: B006
    scene: list[str] = [],  # noqa: B006
    steps: int = 120,
    scenes_folder: Path = Path("runs") / "bench_camera",
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure and print a table.

    Args:
        triangles: sizes of the house.
        scene: scenes to measure besides, by name or folder.
        steps: length of the walk.
        scenes_folder: where the larger houses are kept.
        json_file: where the numbers are written.
    """
    backend = select_backend()
    rows: list[Row] = []
    for name in [*(str(refined_home(count, scenes_folder).folder) for count in triangles), *scene]:
        rows += measure(load_scene(name), steps)
    table = Table("scene", "triangles", "path", "wall ms", "CPU ms", "set-up s", "right pixels", "same bits", box=None)
    for row in rows:
        numbers = (f"{row.wall_ms:.1f}", f"{row.cpu_ms:.1f}", f"{row.set_up_s:.1f}", f"{row.right_share:.4%}")
        same = {True: "yes", False: "NO", None: ""}[row.same_bits]
        table.add_row(row.scene, f"{row.triangles:,}", row.path, *numbers, same)
    console = Console()
    console.print(table)
    load = os.getloadavg()[0]
    console.print(f"{IMAGE_PX} x {IMAGE_PX} pixels, {steps} steps, GL by {backend.renderer_string}, load {load:.1f}")
    if json_file is not None:
        about = {"image_px": IMAGE_PX, "steps": steps, "gl": backend.renderer_string, "load": load}
        json_file.write_text(json.dumps({**about, "rows": [asdict(row) for row in rows]}, indent=1))


def measure(scene: Scene, steps: int) -> list[Row]:
    """All ways on one scene."""
    import mujoco

    from anm_mj.scene.build import build_spec
    from anm_mj.scene.chunks import MIN_TRIANGLES, cut_into_chunks
    from anm_mj.sim.gl_camera import GlCamera
    from anm_mj.sim.ray_camera import EmbreeCamera, MujocoRayCamera
    from anm_mj.utils.raycast import embree_installed

    spec = build_spec(scene)
    if scene.num_triangles < MIN_TRIANGLES:
        cut_into_chunks(spec)
    body = spec.worldbody.add_body(name="eye", mocap=True)
    body.add_camera(name="eye", fovy=90.0, xyaxes=[0.0, -1.0, 0.0, 0.0, 0.0, 1.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    size = (model, "eye", IMAGE_PX, IMAGE_PX)
    ways = {
        "GL, everything": lambda: GlCamera(*size, cull_face=scene.cull_face, cull_hidden=False),
        "GL, culled": lambda: GlCamera(*size, cull_face=scene.cull_face, cull_hidden=True),
        "GL, both sides": lambda: GlCamera(*size, cull_face=False),
        "MuJoCo's rays": lambda: MujocoRayCamera(*size),
    }
    if embree_installed():
        ways["Embree"] = lambda: EmbreeCamera(*size)

    rows, pictures = [], {}
    for path, make in ways.items():
        # Every 10th place is enough for what is slow and only compared with.
        poses = walk(scene, steps)[:: 10 if path == "MuJoCo's rays" else 1]
        begin = time.perf_counter()
        camera = make()
        set_up_s = time.perf_counter() - begin
        wall_ms, cpu_ms, pictures[path] = [], [], []
        for pose in poses:
            look_from(data, pose)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            begin, begin_cpu = time.perf_counter(), time.process_time()
            pictures[path].append(camera.render(data))
            wall_ms.append(1e3 * (time.perf_counter() - begin))
            cpu_ms.append(1e3 * (time.process_time() - begin_cpu))
        camera.close()
        rows.append((path, float(np.median(wall_ms)), float(np.median(cpu_ms)), set_up_s))
    return [
        Row(
            scene.name,
            scene.num_triangles,
            path,
            wall_ms,
            cpu_ms,
            set_up_s,
            _right_share(pictures[path][:: 1 if path == "MuJoCo's rays" else 10], pictures["MuJoCo's rays"]),
            _same_bits(pictures[path], pictures["GL, everything"]) if path == "GL, culled" else None,
        )
        for path, wall_ms, cpu_ms, set_up_s in rows
    ]


def _right_share(pictures: list[Picture], cast: list[Picture]) -> float:
    """Share of pixels within a millimetre of MuJoCo's rays, or without depth in both."""
    same = [(np.abs(a - b) < 1e-3) | (np.isnan(a) & np.isnan(b)) for (_, a), (_, b) in zip(pictures, cast, strict=True)]
    return float(np.mean(same))


def _same_bits(pictures: list[Picture], others: list[Picture]) -> bool:
    """Whether all pictures are the same, bit by bit."""
    pairs = zip(pictures, others, strict=True)
    return all(a.tobytes() == b.tobytes() for picture, other in pairs for a, b in zip(picture, other, strict=True))


def look_from(data: Any, pose: Pose2) -> None:
    """Put the camera above a pose."""
    data.mocap_pos[0] = (pose.x_m, pose.y_m, CAMERA_HEIGHT_M)
    data.mocap_quat[0] = (math.cos(pose.yaw_rad / 2), 0.0, 0.0, math.sin(pose.yaw_rad / 2))


def walk(scene: Scene, steps: int) -> list[Pose2]:
    """A walk like the robot's: ahead while there is room, else turning; now and then it looks round."""
    area = scene_area(scene, DEFAULT_FOOTPRINT)
    rng = np.random.default_rng(0)
    poses, turns = [], 0
    for start in range(6):
        pose = scene.starts[start % len(scene.starts)]
        for _ in range(steps // 6):
            poses.append(pose)
            ahead = move_pose(pose, FORWARD_STEP_M, 0.0)
            col, row = ((ahead.xy_m - area.grid.origin_xy_m) / area.grid.resolution_m).astype(int)
            inside = 0 <= row < area.grid.rows and 0 <= col < area.grid.cols
            if turns == 0 and (not inside or area.component[row, col] != 1 or rng.random() < 0.05):
                turns = int(rng.integers(3, 12))
            if turns:
                pose, turns = move_pose(pose, 0.0, TURN_STEP_RAD), turns - 1
            else:
                pose = ahead
    return poses


def refined_home(num_triangles: int, folder: Path) -> Scene:
    """The house with at least so many triangles; made once."""
    out = folder / f"home_{num_triangles}"
    if (out / "scene.toml").is_file():
        return read_scene_folder(out)
    home = load_scene("home")
    parts, length_m = home_parts(home), 2.0
    while sum(len(part.faces) for part in parts) < num_triangles:
        parts = [halved(part, length_m) for part in parts]
        length_m /= 1.1
    info = SceneInfo(out.name, home.source, home.licence, rooms=home.rooms, cull_face=home.cull_face)
    return write_scene(parts, info, out, home.starts)


def home_parts(home: Scene) -> list[Submesh]:
    """The parts that a scene folder was written from."""
    root = ET.parse(home.xml).getroot()
    parts = []
    for mesh in root.iter("mesh"):
        vertices, uv, faces = read_msh(home.folder / "assets" / str(mesh.get("file")))
        texture = home.folder / "assets" / f"{mesh.get('name')}.png"
        image = np.asarray(Image.open(texture).convert("RGB")) if texture.is_file() else None
        uv_up = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1) if image is not None else None
        parts.append(Submesh(str(mesh.get("name")), vertices, faces, uv=uv_up, texture=image))
    return parts


def halved(part: Submesh, length_m: float) -> Submesh:
    """The same surface with every triangle halved whose longest edge is longer, at the middle of that edge."""
    corners = part.vertices_m[part.faces]
    lengths: Float[np.ndarray, "f 3"] = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    split = lengths.max(axis=1) > length_m
    a, b, c = np.take_along_axis(part.faces, (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3, axis=1)[split].T
    edges, middle = np.unique(np.sort(np.stack([a, b], axis=1), axis=1), axis=0, return_inverse=True)
    middle = middle.ravel() + len(part.vertices_m)
    faces = [part.faces[~split], np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
    return Submesh(
        part.name,
        np.concatenate([part.vertices_m, part.vertices_m[edges].mean(axis=1)]),
        np.concatenate(faces).astype(np.int32),
        part.rgb,
        None if part.uv is None else np.concatenate([part.uv, part.uv[edges].mean(axis=1)]),
        part.texture,
    )


if __name__ == "__main__":
    run_script(main)
