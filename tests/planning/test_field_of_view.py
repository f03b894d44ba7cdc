"""Nothing in planning assumes a camera of 90 degrees at 1.25 m: it follows the observation's."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.planning.field_of_view import FieldOfView, turns_to_look_around
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.region_finder import RegionFinder
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.gvg_policy import Gvg
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.scan_grid import ScanGrid
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Footprint, Intrinsics, Observation, OccupancyGrid, Pose2
from tests.box_room import CAMERA, ROOM_HIGH_M, camera_pose, room_depth
from tests.planning.worlds import room, topdown_map

BODY = Footprint(0.18, 0.05, 1.35)
HERE = Pose2(0.2, 0.1, 0.4)


def view(fov_deg=90.0, width=64, height=64, tilt_deg=0.0, height_m=1.25, range_m=math.inf, pose=HERE, aside_deg=0.0):
    """An observation of the box room by a camera with a horizontal field of view, which looks aside to the left."""
    fov_y = 2.0 * math.atan(math.tan(math.radians(fov_deg) / 2.0) * height / width)
    intrinsics = Intrinsics.from_fov(width, height, fov_y)
    c, s = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
    T = camera_pose(replace(pose, yaw_rad=pose.yaw_rad + math.radians(aside_deg)), height_m)
    T[:3, :3] = T[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    depth = room_depth(T, intrinsics)
    return Observation(0, 0.0, np.full((height, width, 3), 9, np.uint8), depth, intrinsics, T, pose, range_m)


@pytest.mark.parametrize(
    ("fov_deg", "turns", "side"), [(55.0, 31, 2), (69.0, 30, 3), (90.0, 27, 4), (110.0, 25, 5), (150.0, 21, 7)]
)
def test_a_camera_turns_as_far_as_it_needs_to_see_all_around(fov_deg: float, turns: int, side: int):
    seen = view(fov_deg, width=96, height=64)
    camera = FieldOfView.of(seen)
    assert math.degrees(camera.width_rad) == pytest.approx(fov_deg, abs=1e-3)
    assert camera.turns_for_panorama == turns
    assert camera.side_sectors == side
    plan = Gvg(PolicyContext(BODY, GvgConfig())).plan(room(4, 3), seen)
    assert len(plan.actions) == turns
    headings = math.radians(10.0) * np.arange(turns + 1)
    shown = np.abs((np.linspace(0, math.tau, 721)[:, None] - headings + math.pi) % math.tau - math.pi)
    assert (shown.min(axis=1) <= camera.width_rad / 2 + 1e-6).all()


def test_images_that_come_late_ask_for_more_turns():
    seen = view()
    assert [turns_to_look_around(replace(seen, image_age_s=age_s)) for age_s in (0.0, 0.1, 0.5)] == [27, 28, 29]


@pytest.mark.parametrize("tilt_deg", [-30.0, 0.0, 30.0])
@pytest.mark.parametrize("height", [64, 36])
def test_slopes_are_those_of_the_top_and_bottom_rows(tilt_deg: float, height: int):
    camera = FieldOfView.of(view(69.0, 64, height, tilt_deg))
    low, high = camera.slopes()
    half = math.degrees(math.atan(math.tan(math.radians(69.0) / 2.0) * height / 64))
    assert math.degrees(math.atan(low)) == pytest.approx(tilt_deg - half, abs=0.1)
    assert math.degrees(math.atan(high)) == pytest.approx(tilt_deg + half, abs=0.1)


def test_the_usual_camera_is_read_exactly():
    # A last digit would change every run.
    camera = FieldOfView.of(view())
    assert camera.slopes(0.95) == (-0.95, 0.95)
    assert camera.corner_ratio == math.sqrt(2.0)
    assert camera.width_rad == math.pi / 2


@pytest.mark.parametrize("yaw_deg", range(-180, 180, 10))
@pytest.mark.parametrize("tilt_deg", [0.0, -30.0])
def test_a_camera_that_looks_straight_ahead_does_so_to_the_last_digit(yaw_deg: int, tilt_deg: float):
    for off in (0.0, 1e-6, -1e-6, -1e-15):
        pose = Pose2(0.2, 0.1, math.radians(yaw_deg))
        seen = replace(view(tilt_deg=tilt_deg, pose=pose), pose=replace(pose, yaw_rad=pose.yaw_rad + off))
        azimuth = FieldOfView.of(seen).azimuth_rad
        assert azimuth == 0.0
        assert math.copysign(1.0, azimuth) == 1.0


@pytest.mark.parametrize("aside_deg", [-30.0, -5.0, 17.0, 30.0])
def test_where_a_camera_looks_beside_the_heading_is_read_off(aside_deg: float):
    for yaw_deg in (-175.0, 0.0, 90.0, 179.0):
        seen = view(tilt_deg=-20.0, pose=Pose2(0.2, 0.1, math.radians(yaw_deg)), aside_deg=aside_deg)
        assert FieldOfView.of(seen).azimuth_rad == pytest.approx(math.radians(aside_deg), abs=0.005)


def test_where_nobody_knows_where_a_camera_looks_it_looks_ahead():
    # A late image was taken before the last turn; one straight up has no heading.
    assert FieldOfView.of(replace(view(aside_deg=20.0), image_age_s=0.1)).azimuth_rad == 0.0
    assert FieldOfView.of(replace(view(), T_world_camera=np.eye(4))).azimuth_rad == 0.0


def test_the_blind_zone_grows_with_tilt_and_narrow_views():
    blind = {
        (fov, tilt): FieldOfView.of(view(fov, tilt_deg=tilt)).blind_radius_m(BODY, 0.5)
        for fov in (55.0, 90.0)
        for tilt in (-30.0, 0.0, 30.0)
    }
    assert blind[90.0, 0.0] < 0.6
    assert 0.8 < blind[55.0, 0.0] < 1.2
    assert 1.5 < blind[90.0, 30.0] < 2.5
    # It looks over the body's heights altogether.
    assert blind[55.0, 30.0] == math.inf
    low = FieldOfView.of(view(height_m=0.2)).blind_radius_m(Footprint(0.18, 0.05, 0.35), 0.5)
    assert low < 0.2


def test_the_start_is_free_as_far_as_the_camera_is_blind(caplog):
    unknown = OccupancyGrid(
        np.full((40, 120, 120), UNKNOWN, np.int8),
        np.full((40, 120, 120), np.inf, np.float32),
        np.array([-3.0, -3.0, 0.0]),
        0.05,
    )

    def free_radius_m(seen):
        mapper = TopDownMapper(PlanningConfig(), BODY)
        topdown = topdown_map(
            mapper, unknown, lambda p: np.full(len(p), 0.1, np.float32), seen.pose, FieldOfView.of(seen)
        )
        return math.sqrt(np.count_nonzero(topdown.state == FREE) * 0.05**2 / math.pi)

    at = Pose2(0.0, 0.0, 0.0)
    assert free_radius_m(view(pose=at)) == pytest.approx(0.75, abs=0.03)
    assert free_radius_m(view(55.0, pose=at)) > 1.0
    assert not caplog.records
    free_radius_m(view(55.0, tilt_deg=30.0, pose=at))
    assert "sees no place as free" in caplog.text


def test_gain_and_regions_reach_no_farther_than_the_camera():
    gain = InformationGain(GvgConfig(), FieldOfView.of(view(range_m=2.0, pose=Pose2(1.5, 1.5, 0.0))))
    assert gain.range_m == 2.0
    finder = RegionFinder(PlanningConfig())
    finder.limit_range(6.0)
    assert finder.config.anchor_range_m == 3.5
    finder.limit_range(2.0)
    assert finder.config.anchor_range_m == 1.5


@pytest.mark.parametrize("tilt_deg", [-30.0, -10.0, 10.0])
@pytest.mark.parametrize("fov_deg", [69.0, 110.0])
def test_a_tilted_scan_finds_the_walls_where_they_are(tilt_deg: float, fov_deg: float):
    grid = ScanGrid(BODY, 10.0)
    for k in range(36):
        grid.integrate(view(fov_deg, 96, 96, tilt_deg, pose=Pose2(0.2, 0.1, math.radians(10.0 * k))))
    topdown = grid.topdown()
    row, col = np.nonzero(topdown.state == OCCUPIED)
    xy = topdown.origin_xy_m + (np.stack([col, row], axis=1) + 0.5) * topdown.resolution_m
    off = np.abs(np.abs(xy) - ROOM_HIGH_M[:2]).min(axis=1)
    assert len(xy) > 100
    assert off.max() < 0.1


def test_a_level_scan_is_the_same_by_either_way():
    level = view(90.0, 64, 64)
    tilted = replace(view(90.0, 64, 64, tilt_deg=1.0), pose=level.pose)
    a, b = ScanGrid(BODY, 10.0), ScanGrid(BODY, 10.0)
    a.integrate(level)
    b.integrate(tilted)
    free_a, free_b = a.topdown().state == FREE, b.topdown().state == FREE
    assert np.count_nonzero(free_a != free_b) < 0.05 * np.count_nonzero(free_a)
    assert CAMERA.fx == pytest.approx(128.0)
