"""A frame against an earlier one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.localisation.frame_points import draw_points
from anm_mj.localisation.frame_to_images import FrameToImages, coarse_gray_at
from anm_mj.localisation.key_images import KeyImages, _shares_in, gray_values, key_image, smoothed_depth
from anm_mj.localisation.localisation_config import KeyImageConfig, RegistrationConfig
from anm_mj.localisation.motion_search import rotation_search
from anm_mj.localisation.registration import PLANAR, Prior
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.types import FREE, UNKNOWN, Intrinsics
from tests.mapping.ray_room import Room

CONFIG = KeyImageConfig()
KERNEL = 20.0


@pytest.fixture(scope="module")
def images(room: Room) -> KeyImages:
    kept = KeyImages(CONFIG)
    for yaw in (0.0, 0.2, 2.0):
        kept.add(room.observe(1.5, 1.5, yaw, size=128, step=round(10 * yaw)), 0.0)
    return kept


def test_gauss_newton_finds_the_motion(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.55, 1.45, 0.1, size=128)
    points = draw_points(frame, 600, 0.0, 8.0, np.random.default_rng(0))
    T = moved_camera(frame.T_world_camera, np.array([0.03, -0.02, 0.02, 0.01, -0.02, 0.03]))
    count = 0.0
    for kernel in (KERNEL, KERNEL, 8.0, 4.0, 2.5, 2.5, 2.5):
        sums = images.equations(images.images[:1], points, T, 0.0, kernel, gray_values(points.rgb))
        T, count = moved_camera(T, -np.linalg.solve(sums.hessian, sums.gradient)), sums.num_points
    off = camera_motion(frame.T_world_camera, T)
    assert np.linalg.norm(off[:3]) < 0.002
    assert np.linalg.norm(off[3:]) < 0.001
    assert count > 200


def test_pixels_without_depth_show_no_point(room: Room) -> None:
    kept = KeyImages(CONFIG)
    frame = room.observe(1.5, 1.5, 0.0, size=128)
    kept.add(replace(frame, depth_m=np.full_like(frame.depth_m, np.nan)), 0.0)
    points = draw_points(frame, 600, 0.0, 8.0, np.random.default_rng(0))
    # However vague the pose is.
    assert list(_shares_in(kept.images, points, frame.T_world_camera, 5.0)) == [0.0]


@pytest.mark.parametrize("radius_px", [-100_000_001, -1, 2**31 - 2])
def test_normals_from_nowhere_are_refused(room: Room, images: KeyImages, radius_px: int) -> None:
    frame = room.observe(1.5, 1.5, 0.0, size=128)
    points = draw_points(frame, 600, 0.0, 8.0, np.random.default_rng(0))
    damaged = [replace(images.images[0], radius_px=radius_px)]
    with pytest.raises(ValueError, match="pixels beside"):
        images.equations(damaged, points, frame.T_world_camera, 0.0, KERNEL, gray_values(points.rgb))


def test_exposure_is_no_motion(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.52, 1.48, 0.05, size=128)
    dark = replace(frame, rgb=(0.9 * frame.rgb).astype(np.uint8))
    off = []
    for shot in (frame, dark):
        points = draw_points(shot, 600, 0.0, 8.0, np.random.default_rng(0))
        sums = images.equations(images.images[:1], points, frame.T_world_camera, 0.0, KERNEL, gray_values(points.rgb))
        off.append(np.linalg.solve(sums.hessian, -sums.gradient))
    assert np.linalg.norm(off[1] - off[0]) < 0.002


def test_a_vague_turn_is_rotation_search(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.5, 1.5, 0.1, size=128)
    points = draw_points(frame, 900, 0.0, 8.0, np.random.default_rng(0))
    gray = coarse_gray_at(key_image(frame, CONFIG.longest_px), points)
    extra = FrameToImages(images, images.images[:2], points, gray, 0.0, 1.0)
    for off in (-0.12, 0.12):
        T = moved_camera(frame.T_world_camera, np.array([0.0, 0.0, 0.0, 0.0, 0.0, off]))
        prior = Prior(T, np.diag([0.01, 0.01, 0.08]) ** 2, PLANAR)
        start = rotation_search(prior, extra, RegistrationConfig())
        assert abs(camera_motion(frame.T_world_camera, start)[5]) < 0.03
        # What is well known is not searched for.
        sure = replace(prior, covariance=np.diag([0.01, 0.01, 0.001]) ** 2)
        np.testing.assert_array_equal(rotation_search(sure, extra, RegistrationConfig()), T)


def test_a_wrong_displacement_leads_no_rotation_astray(room: Room) -> None:
    frame = room.observe(0.8, 1.5, 0.5, size=128)
    images = KeyImages(CONFIG)
    images.add(room.observe(0.8, 1.5, 0.35, size=128), 0.0)
    points = draw_points(frame, 900, 0.0, 8.0, np.random.default_rng(0))
    gray = coarse_gray_at(key_image(frame, CONFIG.longest_px), points)
    extra = FrameToImages(images, images.images[:1], points, gray, 0.0, 1.0)
    for aside in (-0.05, 0.05):
        T = moved_camera(frame.T_world_camera, np.array([0.05, aside, 0.0, 0.0, 0.0, 0.04]))
        start = rotation_search(Prior(T, np.diag([0.01, 0.01, 0.04]) ** 2, PLANAR), extra, RegistrationConfig())
        # By its depths it would be twice as far off.
        assert abs(camera_motion(frame.T_world_camera, start)[5]) < 0.03


def test_without_grey_values_a_rotation_is_searched_by_depth(room: Room) -> None:
    config = replace(CONFIG, gray_deviation=0.0)
    images = KeyImages(config)
    images.add(room.observe(1.5, 1.5, 0.0, size=128), 0.0)
    frame = room.observe(1.5, 1.5, 0.1, size=128)
    points = draw_points(frame, 900, 0.0, 8.0, np.random.default_rng(0))
    gray = coarse_gray_at(key_image(frame, config.longest_px), points)
    extra = FrameToImages(images, images.images, points, gray, 0.0, 1.0)
    assert not extra.has_gray
    T = moved_camera(frame.T_world_camera, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.12]))
    start = rotation_search(Prior(T, np.diag([0.01, 0.01, 0.08]) ** 2, PLANAR), extra, RegistrationConfig())
    assert abs(camera_motion(frame.T_world_camera, start)[5]) < 0.03


def test_a_rotation_that_shows_nothing_alike_is_not_found(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.5, 1.5, 0.0, size=128)
    points = draw_points(frame, 900, 0.0, 8.0, np.random.default_rng(0))
    gray = coarse_gray_at(key_image(frame, CONFIG.longest_px), points)
    extra = FrameToImages(images, images.images[:1], points, gray, 0.0, 1.0)
    # Three standard deviations lead out of the picture.
    prior = Prior(frame.T_world_camera, np.diag([0.01, 0.01, 0.6]) ** 2, PLANAR)
    start = rotation_search(prior, extra, RegistrationConfig())
    assert abs(camera_motion(frame.T_world_camera, start)[5]) < 0.35


def test_a_picture_of_two_rows_has_no_coarse_grey_values(room: Room) -> None:
    frame = room.observe(1.5, 1.5, 0.1, size=128)
    camera = Intrinsics(128, 2, 64.0, 64.0, 64.0, 1.0)
    flat = replace(frame, rgb=frame.rgb[63:65], depth_m=frame.depth_m[63:65], intrinsics=camera)
    points = draw_points(flat, 100, 0.0, 8.0, np.random.default_rng(0))
    assert not coarse_gray_at(key_image(flat, CONFIG.longest_px), points).any()


def test_coarse_grey_values_are_those_of_a_frame_at_its_own_place(room: Room) -> None:
    frame = room.observe(1.5, 1.5, 0.1, size=128)
    kept = KeyImages(CONFIG)
    kept.add(frame, 0.0)
    points = draw_points(frame, 900, 0.0, 8.0, np.random.default_rng(0))
    gray = coarse_gray_at(kept.images[0], points)
    sums = kept.equations(kept.images, points, frame.T_world_camera, 0.0, KERNEL, gray, coarse=True)
    assert sums.mean_gray_cost < 1e-6


def test_what_lies_on_no_plane_tells_by_its_looks_alone(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.52, 1.48, 0.05, size=128)
    points = draw_points(frame, 600, 0.0, 8.0, np.random.default_rng(0))
    image = images.images[0]
    edges = replace(image, depth_m=-image.depth_m)
    gray = gray_values(points.rgb)
    sums = images.equations([edges], points, frame.T_world_camera, 0.0, KERNEL, gray)
    assert sums.num_points == 0.0
    # Grey values bind the rotation about the vertical.
    assert sums.hessian[5, 5] > 1e4
    flat = replace(edges, gray=np.full_like(image.gray, 128))
    assert not images.equations([flat], points, frame.T_world_camera, 0.0, KERNEL, gray).hessian.any()


def test_gradient_is_that_of_the_cost(room: Room, images: KeyImages) -> None:
    # With a kernel that bends nothing, the gradient is half the derivative of the sum of squares.
    config = replace(CONFIG, gray_deviation=0.0)
    wide = KeyImages(config)
    wide.images = images.images
    frame = room.observe(1.52, 1.5, 0.05, size=128)
    points = draw_points(frame, 400, 0.0, 8.0, np.random.default_rng(1))
    gray = gray_values(points.rgb)
    base = wide.equations(wide.images[:1], points, frame.T_world_camera, 0.0, 1e6, gray)
    step = 1e-5
    for axis in range(6):
        costs = [
            wide.equations(wide.images[:1], points, moved_camera(frame.T_world_camera, change), 0.0, 1e6, gray).cost
            for change in (-step * np.eye(6)[axis], step * np.eye(6)[axis])
        ]
        slope = (costs[1] - costs[0]) / (2.0 * step)
        assert slope == pytest.approx(2.0 * base.gradient[axis], rel=0.02, abs=0.02 * np.abs(base.gradient).max())


def test_the_oldest_that_shows_enough_is_chosen(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.5, 1.5, 0.15, size=128)
    points = draw_points(frame, 300, 0.0, 8.0, np.random.default_rng(0))
    chosen = images.overlapping(points, frame.T_world_camera)
    assert [image.step for image in chosen] == [0, 2]
    behind = room.observe(1.5, 1.5, math.pi, size=128)
    assert [image.step for image in images.overlapping(points, behind.T_world_camera)] in ([], [20])


def test_a_pose_that_may_be_off_counts_depths_as_near(room: Room, images: KeyImages) -> None:
    frame = room.observe(1.5, 1.5, 0.1, size=128)
    points = draw_points(frame, 600, 0.0, 8.0, np.random.default_rng(0))
    T = frame.T_world_camera.copy()
    T[:2, 3] += 0.15
    assert not images.overlapping(points, T)[:-1]
    assert images.overlapping(points, T, slack_m=0.15)[0].step == 0


def test_the_last_frame_is_preferred_until_it_is_forgotten(room: Room) -> None:
    kept = KeyImages(replace(CONFIG, num_images=1))
    kept.add(room.observe(1.5, 1.5, 0.0, size=128, step=0), 0.0)
    kept.see(key_image(room.observe(1.5, 1.5, 0.3, size=128, step=3), CONFIG.longest_px))
    frame = room.observe(1.5, 1.5, 0.35, size=128)
    points = draw_points(frame, 300, 0.0, 8.0, np.random.default_rng(0))
    assert [image.step for image in kept.overlapping(points, frame.T_world_camera)] == [3]
    kept.see(None)
    assert [image.step for image in kept.overlapping(points, frame.T_world_camera)] == [0]


def test_what_was_seen_from_much_farther_away_is_not_alike(room: Room) -> None:
    # Both look along x at the same wall.
    kept = KeyImages(replace(CONFIG, most_apart_m=10.0))
    kept.add(room.observe(0.4, 1.5, 0.0, size=128), 0.0)
    shares = {}
    for x in (0.6, 2.6):
        frame = room.observe(x, 1.5, 0.0, size=128)
        points = draw_points(frame, 300, 0.0, 8.0, np.random.default_rng(0))
        shares[x] = kept.shares(points, frame.T_world_camera)[0][0]
    assert shares[0.6] > 0.5
    assert shares[2.6] < 0.1


@pytest.mark.parametrize("size", [(128, 96), (33, 47)])
def test_a_reduced_pixel_keeps_its_ray(size: tuple[int, int], room: Room) -> None:
    width, height = size
    frame = room.observe(1.5, 1.5, 0.3, size=128)
    camera = Intrinsics(width, height, 64.0, 64.0, width / 2.0, height / 2.0)
    cut = replace(frame, rgb=frame.rgb[:height, :width], depth_m=frame.depth_m[:height, :width], intrinsics=camera)
    image = key_image(cut, 32)
    fx, fy, cx, cy = image.camera
    factor = math.ceil(max(size) / 32)
    row, col = 3, 5
    source = row * factor + factor // 2, col * factor + factor // 2
    assert image.depth_m[row, col] == np.float16(cut.depth_m[source])
    assert (col + 0.5 - cx) / fx == pytest.approx((source[1] + 0.5 - camera.cx) / camera.fx)
    assert (row + 0.5 - cy) / fy == pytest.approx((source[0] + 0.5 - camera.cy) / camera.fy)


@pytest.mark.parametrize("longest", [32, 43, 64, 128])
def test_a_reduced_grey_value_stands_on_its_ray(longest: int, room: Room) -> None:
    frame = room.observe(1.5, 1.5, 0.3, size=128)
    ramp = np.broadcast_to(np.arange(128, dtype=np.uint8)[None, :, None], (128, 128, 3))
    image = key_image(replace(frame, rgb=ramp), longest)
    factor = math.ceil(128 / longest)
    np.testing.assert_array_equal(image.gray[10, 3:20], np.arange(3, 20) * factor + factor // 2)


def test_of_too_many_images_one_of_those_most_alike_goes(room: Room) -> None:
    kept = KeyImages(replace(CONFIG, most_images=3))
    for step, yaw in enumerate((0.0, 0.5, 0.52, 1.5)):
        kept.add(room.observe(1.5, 1.5, yaw, size=32, step=step), 0.0)
    assert [image.step for image in kept.images] == [0, 1, 3]


def test_smoothing_keeps_planes_and_leaves_edges_out(room: Room) -> None:
    depth = room.observe(1.5, 1.5, 0.4, size=128).depth_m
    rng = np.random.default_rng(0)
    noise = 0.004
    noisy = (1.0 / (1.0 / depth + noise * rng.standard_normal(depth.shape))).astype(np.float32)
    smooth = smoothed_depth(noisy, 2, noise)
    kept = smooth > 0.0
    np.testing.assert_array_equal(smooth[~kept], -noisy[~kept])
    assert 0.6 < kept.mean() < 1.0
    before, after = (np.median(np.abs(1.0 / image[kept] - 1.0 / depth[kept])) for image in (noisy, smooth))
    # Twenty-five pixels, but creases are rounded.
    assert after < 0.4 * before


def test_a_grid_that_is_built_again_knows_nothing_beyond_the_range_of_the_camera(room: Room) -> None:
    """What the camera looked farther than its range is not what it looked through."""
    frames = []
    for step, seen in enumerate(room.turn(1.5, 1.5, 6, size=96)):
        depth_m = np.where(seen.depth_m < 1.2, seen.depth_m, np.float32(np.inf))
        frames.append(key_image(replace(seen, depth_m=depth_m, range_m=1.2, step=step), CONFIG.longest_px).frame)
    occupancy = DepthOccupancy(OccupancyConfig())
    occupancy.rebuild(frames)
    assert (occupancy.state_at(np.array([[3.5, 1.5, 1.2], [1.5, 2.9, 1.2]])) == UNKNOWN).all()
    assert (occupancy.state_at(np.array([[2.2, 1.5, 1.2], [1.5, 2.2, 1.2]])) == FREE).all()


def test_what_moved_is_compared_and_not_mapped(room: Room) -> None:
    frame = replace(room.observe(1.5, 1.5, 0.4, size=96), range_m=9.0, shown_range_m=8.0)
    moved_m = np.full(frame.depth_m.shape, np.nan, np.float32)
    moved_m[20:40, 30:60] = frame.depth_m[20:40, 30:60]
    images = KeyImages(KeyImageConfig(longest_px=48))
    images.see(key_image(frame, 48))
    images.add(replace(frame, moved_m=moved_m), 0.0)
    image = images.images[0]
    assert np.isfinite(image.depth_m).all()
    depth, intrinsics, _, range_m, moved = image.frame
    assert depth.shape == (intrinsics.height, intrinsics.width) == (48, 48)
    assert np.isnan(depth[10:20, 15:30]).all()
    assert np.isnan(depth).sum() == 10 * 15
    # The grid is told what it was told of the frame.
    assert range_m == 8.0
    assert moved is not None
    np.testing.assert_array_equal(np.isfinite(moved), np.isnan(depth))
    np.testing.assert_array_equal(np.fmin(depth, moved), image.depth_m.astype(np.float32))
