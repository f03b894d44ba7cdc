import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.frames import move_pose
from anm_mj.geometry.clearance import Clearance
from anm_mj.types import FORWARD_STEP_M, Pose2
from tests.robots import FOOTPRINT, clearance_of

ORIGIN = Pose2(0.0, 0.0, 0.0)


def _box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(centre))


def _wall_at_x(x_m: float) -> trimesh.Trimesh:
    """A wall whose near face is at ``x_m``."""
    return _box((0.1, 6.0, 2.5), (x_m + 0.05, 0.0, 1.25))


@pytest.fixture(scope="module")
def wall() -> Clearance:
    return clearance_of(_wall_at_x(2.0))


@given(gap=st.sampled_from([-1e-5, 1e-5]), y=st.floats(-1.0, 1.0), yaw=st.floats(-math.pi, math.pi))
@settings(max_examples=50, deadline=None)
def test_a_wall_is_touched_at_its_face(wall, gap, y, yaw):
    assert wall.collides(Pose2(2.0 - 0.18 - gap, y, yaw)) == (gap < 0.0)
    assert wall.collides(Pose2(1.9, y, yaw))


def test_a_corner_is_touched_at_its_edge():
    clearance = clearance_of(_box((1.0, 1.0, 2.0), (1.5, 1.5, 1.0)))
    aside = 0.18 / math.sqrt(2.0)
    assert not clearance.collides(Pose2(1.0 - aside - 1e-5, 1.0 - aside - 1e-5, 0.0))
    assert clearance.collides(Pose2(1.0 - aside + 1e-5, 1.0 - aside + 1e-5, 0.0))


def test_heights_of_the_footprint():
    floor, carpet = _box((4, 4, 0.1), (0, 0, -0.05)), _box((1, 1, 0.049), (0, 0, 0.0245))
    ceiling, lamp = _box((4, 4, 0.1), (0, 0, 2.5)), _box((0.3, 0.3, 0.2), (0, 0, 1.46))
    clearance = clearance_of(floor, carpet, ceiling, lamp)
    assert not clearance.collides(ORIGIN)
    table = _box((1.0, 1.0, 0.04), (0, 0, 0.75))
    assert clearance_of(floor, table).collides(ORIGIN)


def test_large_triangle():
    vertices = np.array([[0.5, -9.0, -1.0], [0.5, 9.0, -1.0], [0.5, 0.0, 9.0]])
    clearance = Clearance(vertices, np.array([[0, 1, 2]]), FOOTPRINT)
    assert not clearance.collides(Pose2(0.5 - 0.18 - 1e-5, 0.0, 0.0))
    assert clearance.collides(Pose2(0.5 - 0.18 + 1e-5, 0.0, 0.0))


def test_sweep_towards_a_wall(wall):
    free = 2.0 - 0.18 - FORWARD_STEP_M
    assert not wall.sweep_collides(Pose2(free - 0.001, 0.0, 0.0), FORWARD_STEP_M)
    assert wall.sweep_collides(Pose2(free + 0.001, 0.0, 0.0), FORWARD_STEP_M)
    assert not wall.sweep_collides(Pose2(2.0 - 0.18 - 0.001, 0.0, math.pi / 2), FORWARD_STEP_M)
    assert not wall.sweep_collides(Pose2(2.0 - 0.18 - 0.001, 0.0, math.pi), FORWARD_STEP_M)


def test_sweep_past_a_post():
    # A thin post beside the middle of a long move: both ends are free, the way is not.
    clearance = clearance_of(_box((0.01, 0.01, 2.0), (0.5, 0.17, 1.0)))
    start = Pose2(0.0, 0.0, 0.0)
    assert not clearance.collides(start)
    assert not clearance.collides(move_pose(start, 1.0, 0.0))
    assert clearance.sweep_collides(start, 1.0)


@given(x=st.floats(-0.4, 0.4), y=st.floats(-0.4, 0.4), yaw=st.floats(-math.pi, math.pi))
@settings(max_examples=50, deadline=None)
def test_a_sweep_agrees_with_many_small_checks(x, y, yaw):
    post = _box((0.02, 0.02, 2.0), (0.0, 0.0, 1.0))
    clearance, wider = clearance_of(post), clearance_of(post, footprint=replace(FOOTPRINT, radius_m=0.1801))
    start = Pose2(x, y, yaw)
    along = [move_pose(start, float(s), 0.0) for s in np.linspace(0.0, FORWARD_STEP_M, 66)]
    if clearance.collides(start):
        return
    if any(clearance.collides(pose) for pose in along):
        assert clearance.sweep_collides(start, FORWARD_STEP_M)
    elif not any(wider.collides(pose) for pose in along):
        assert not clearance.sweep_collides(start, FORWARD_STEP_M)


def test_an_empty_scene_is_free_everywhere():
    clearance = clearance_of()
    assert not clearance.collides(ORIGIN)
    assert not clearance.sweep_collides(ORIGIN, 1.0)
