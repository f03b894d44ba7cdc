import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj.frames import pixel_directions
from anm_mj.ground_truth.reduced_depth import back_project_reduced, halved_intrinsics, kept_pixels, reduce_depth
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import CAMERA as SQUARE
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, camera_pose, room_depth

WIDE = Intrinsics(640, 480, 400.0, 410.0, 315.0, 244.0)
SMALL = Intrinsics.from_fov(96, 64, math.radians(60.0))


def plane_depth(intrinsics: Intrinsics, normal: np.ndarray, offset_m: float) -> np.ndarray:
    """Planar depth of the plane normal . p = offset, in camera axes."""
    return (offset_m / (pixel_directions(intrinsics) @ normal)).astype(np.float32)


def test_every_even_pixel_of_256_is_kept():
    assert kept_pixels(256).tolist() == list(range(0, 256, 2))


@given(st.integers(1, 4000))
def test_kept_pixels_lie_inside_the_image_and_rise(size_px):
    kept = kept_pixels(size_px)
    assert len(kept) == min(size_px, 128)
    assert kept[0] == 0
    assert kept[-1] < size_px
    assert np.all(np.diff(kept) > 0)


@pytest.mark.parametrize("intrinsics", [SQUARE, WIDE, SMALL])
def test_points_of_a_slanted_wall_lie_on_the_wall(intrinsics):
    # Slanted in both directions, so that a shift by half a pixel along either would show.
    normal = np.array([0.4, 0.3, 0.87])
    normal /= np.linalg.norm(normal)
    depth_mm = reduce_depth(plane_depth(intrinsics, normal, 1.5))
    points = back_project_reduced(depth_mm, intrinsics, np.eye(4))
    assert len(points) == depth_mm.size
    # Half a millimetre of depth, along rays up to 1.7 times as long as their depth.
    assert np.abs(points @ normal - 1.5).max() < 0.5e-3 * 1.7


def test_half_a_pixel_would_show_on_the_slanted_wall():
    normal = np.array([0.4, 0.3, 0.87])
    normal /= np.linalg.norm(normal)
    shifted = Intrinsics(256, 256, 128.0, 128.0, 128.5, 128.0)
    points = back_project_reduced(reduce_depth(plane_depth(SQUARE, normal, 1.5)), shifted, np.eye(4))
    assert np.abs(points @ normal - 1.5).mean() > 2e-3


def test_points_of_a_room_lie_on_its_walls_in_the_world():
    T_world_camera = camera_pose(Pose2(0.5, -0.3, 0.8))
    points = back_project_reduced(reduce_depth(room_depth(T_world_camera)), SQUARE, T_world_camera)
    to_walls = np.minimum(np.abs(points - ROOM_LOW_M), np.abs(points - ROOM_HIGH_M)).min(axis=1)
    assert to_walls.max() < 1e-3


def test_depth_is_rounded_to_whole_millimetres_and_nothing_becomes_zero():
    depth_m = np.array([[np.nan, 0.0], [2.0004, 2.0006], [70.0, np.inf]], dtype=np.float32)
    assert reduce_depth(depth_m).tolist() == [[0, 0], [2000, 2001], [0, 0]]


def test_what_is_beyond_ten_metres_does_not_count():
    depth_mm = np.array([[9999, 10000, 10001]], dtype=np.uint16)
    assert len(back_project_reduced(depth_mm, Intrinsics(3, 1, 1.0, 1.0, 1.5, 0.5), np.eye(4))) == 2


def test_halved_intrinsics_shift_points_by_half_a_pixel_as_the_papers_code_does():
    camera = Intrinsics(256, 256, 128.0, 128.0, 128.0, 128.0)
    depth_mm = reduce_depth(np.full((256, 256), 5.0, np.float32))

    own, other = (back_project_reduced(depth_mm, one, np.eye(4)) for one in (camera, halved_intrinsics(camera)))

    # Pixel i of the code's 128 x 128 image, whose focal length is 64 and whose principal point is 63.5.
    u = np.arange(128)
    np.testing.assert_allclose(other.reshape(128, 128, 3)[0, :, 0], 5.0 * (u - 63.5) / 64.0)
    np.testing.assert_allclose(other - own, np.broadcast_to([0.5 * 5.0 / 128.0, 0.5 * 5.0 / 128.0, 0.0], own.shape))
    assert halved_intrinsics(SMALL) == SMALL
