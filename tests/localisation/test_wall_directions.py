"""Directions of walls, from depth images of a room in closed form and of planes at small angles."""

import math

import numpy as np
import pytest

from anm_mj.frames import pixel_directions
from anm_mj.localisation.wall_directions import wall_directions
from anm_mj.types import Intrinsics
from tests.mapping.ray_room import Room

NOISE_PER_M = 0.004
UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""A level camera that looks along the first axis."""


def off_axis_rad(angle_rad: float) -> float:
    """The angle to the nearer of the room's axes."""
    return (angle_rad + math.pi / 4) % (math.pi / 2) - math.pi / 4


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 100.0, 225.0])
@pytest.mark.parametrize("noise_per_m", [0.0, NOISE_PER_M])
def test_walls_of_a_room_face_along_its_axes(room: Room, yaw_deg: float, noise_per_m: float) -> None:
    frame = room.observe(1.5, 1.5, math.radians(yaw_deg), size=192)
    rng = np.random.default_rng(0)
    depth = 1.0 / (1.0 / frame.depth_m + noise_per_m * rng.standard_normal(frame.depth_m.shape))

    found = wall_directions(depth.astype(np.float32), frame.intrinsics, frame.T_world_camera[:3, :3], noise_per_m)

    # Those that the compass listens to; a wall is far sharper than its pixels, whose planes are off by degrees.
    sharp = [wall for wall in found if wall.deviation_rad < math.radians(0.05)]
    assert sharp
    for wall in sharp:
        assert abs(off_axis_rad(wall.angle_rad)) < 4.0 * wall.deviation_rad + math.radians(0.01)


def test_the_floor_is_no_wall() -> None:
    intrinsics = Intrinsics.from_fov(96, 96, math.pi / 2)
    down = (pixel_directions(intrinsics) @ UPRIGHT.T)[..., 2]
    depth = np.where(down < -0.05, -1.2 / np.minimum(down, -0.05), np.nan)
    assert wall_directions(depth.astype(np.float32), intrinsics, UPRIGHT, 0.0) == []


def two_planes(angle_rad: float, size: int = 128) -> tuple[np.ndarray, Intrinsics]:
    """Depth of two upright planes that meet before the camera, 2 m away, at an angle."""
    intrinsics = Intrinsics.from_fov(size, size, math.pi / 2)
    x = pixel_directions(intrinsics)[..., 0]
    inverse = np.where(x < 0.0, 1.0, 1.0 + x * math.tan(angle_rad)) / 2.0
    return (1.0 / inverse).astype(np.float32), intrinsics


def test_between_walls_that_are_nearly_parallel_there_is_no_direction() -> None:
    for degrees in (1.0, 3.0, 10.0):
        depth, intrinsics = two_planes(math.radians(degrees))
        found = wall_directions(depth, intrinsics, UPRIGHT, 0.0)
        assert degrees < 10.0 or len(found) == 2
        for wall in found:
            off = abs(math.degrees((wall.angle_rad + math.pi / 2) % math.pi - math.pi / 2))
            assert min(off, abs(off - degrees)) < 0.15


@pytest.mark.parametrize("depth", [np.nan, np.inf, 0.0])
def test_nothing_measured_is_no_wall(depth: float) -> None:
    intrinsics = Intrinsics.from_fov(64, 64, math.pi / 2)
    assert wall_directions(np.full((64, 64), depth, np.float32), intrinsics, UPRIGHT, 0.001) == []


@pytest.mark.parametrize("size", [1, 4, 8])
def test_images_of_hardly_a_square_have_no_walls(size: int) -> None:
    intrinsics = Intrinsics.from_fov(size, size, math.pi / 2)
    assert wall_directions(np.ones((size, size), np.float32), intrinsics, UPRIGHT, 0.001) == []
