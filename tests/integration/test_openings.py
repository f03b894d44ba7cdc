"""Worlds with open sides, and with a door that a wide robot hardly fits through: whole runs."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.ImageColor import getrgb

from anm_mj.config import make_config
from anm_mj.io.jsonl import read_jsonl
from anm_mj.run import run
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.viz import palette

pytestmark = pytest.mark.slow

Box = tuple[float, float, float, float, float, float]
"""x, y and z from and to [m]."""

ROOM: tuple[Box, ...] = (
    (-3.0, 3.0, 0.0, 3.0, -0.1, 0.0),
    (-3.0, 3.0, 3.0, 3.1, 0.0, 2.5),
    (-3.1, -3.0, 0.0, 3.1, 0.0, 2.5),
    (3.0, 3.1, 0.0, 3.1, 0.0, 2.5),
    (-3.1, -1.0, -0.1, 0.0, 0.0, 2.5),
    (0.6, 3.1, -0.1, 0.0, 0.0, 2.5),
    (1.8, 2.4, 2.2, 2.8, 0.0, 0.7),
)
"""A room with an opening 1.6 m wide."""
EDGE: Box = (-3.0, 3.0, -1.6, 0.0, -0.1, 0.0)
"""Floor before the opening, without walls, beyond which nothing is."""
DOOR_M = 0.7
TWO_ROOMS: tuple[Box, ...] = (
    (-1.2, 1.2, -3.0, 2.0, -0.1, 0.0),
    (-1.3, -1.2, -3.0, 2.0, 0.0, 2.5),
    (1.2, 1.3, -3.0, 2.0, 0.0, 2.5),
    (-1.3, 1.3, 2.0, 2.1, 0.0, 2.5),
    (-1.3, 1.3, -3.1, -3.0, 0.0, 2.5),
    (-1.2, -DOOR_M / 2, -0.1, 0.0, 0.0, 2.5),
    (DOOR_M / 2, 1.2, -0.1, 0.0, 0.0, 2.5),
)
"""A small room, from which the door leads to a larger one, at lower y."""


def scene_of(boxes: tuple[Box, ...], folder: Path) -> Path:
    geoms = "".join(
        f'<geom type="box" size="{(x1 - x0) / 2} {(y1 - y0) / 2} {(z1 - z0) / 2}" '
        f'pos="{(x0 + x1) / 2} {(y0 + y1) / 2} {(z0 + z1) / 2}" rgba=".{k + 2} .6 .{9 - k} 1"/>'
        for k, (x0, x1, y0, y1, z0, z1) in enumerate(boxes)
    )
    world = folder / "world.xml"
    world.write_text(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>", encoding="utf-8")
    return import_scene(world, folder / "scene").folder


def explore(scene: Path, out: Path, start: tuple[float, float, float], **options):
    return run(make_config("quick", [], scene=str(scene), start=start, seed=0, device="cpu", **options), out=out)[1]


@pytest.fixture(scope="module")
def open_side(tmp_path_factory) -> Path:
    return scene_of((*ROOM, EDGE), tmp_path_factory.mktemp("open_side"))


@pytest.mark.parametrize("policy", ["gvg", "frontier"])
def test_a_camera_that_looks_at_nothing_is_not_at_fault(open_side, tmp_path, policy):
    metrics = explore(open_side, tmp_path / "run", (-0.4, -0.7, -90.0), policy=policy, steps=250, goal="coverage")
    assert metrics.stop_reason in ("BUDGET", "COMPLETE")
    assert metrics.collisions == 0
    assert (metrics.observable_ratio or 0.0) > 90.0


def test_beyond_the_edge_nothing_is_expected_and_the_picture_says_so(open_side, tmp_path):
    explore(open_side, tmp_path / "run", (-0.4, 1.5, -90.0), steps=250, goal="coverage")
    closed = [line["closed"] for line in read_jsonl(tmp_path / "run" / "plans.jsonl") if line.get("closed")]
    outside_m2 = sum(one["expected_m2"] for one in closed if one["kind"] == "outside")
    assert outside_m2 <= 0.2 * sum(one["expected_m2"] for one in closed)
    picture = np.asarray(Image.open(tmp_path / "run" / "topdown.png").convert("RGB")).reshape(-1, 3)
    drop, wall = ((picture == getrgb(colour)).all(axis=1).sum() for colour in (palette.NO_FLOOR, palette.WALL))
    assert drop > 0.2 * wall > 0


@pytest.mark.parametrize("start", [(0.0, 1.0, 0.0), (-0.4, 1.2, 90.0), (0.4, 0.8, 180.0)])
def test_a_wide_robot_passes_its_door_early(tmp_path, start):
    scene = scene_of(TWO_ROOMS, tmp_path)
    metrics = explore(scene, tmp_path / "run", start, robot="stretch3", steps=120, goal="coverage")
    assert metrics.collisions == 0
    y_m = np.loadtxt(tmp_path / "run" / "trajectory.tum")[:, 2]
    assert y_m[0] > 0.0
    assert y_m.min() < -0.4, f"after {len(y_m) - 1} steps {y_m.min():.2f} m"
