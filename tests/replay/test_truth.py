"""What a replay shows of a robot that may be wrong about where it is."""

import math
from pathlib import Path

import numpy as np
import pytest
from PIL.ImageColor import getrgb

from anm_mj.io.read_run import Run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.replay.film_map_and_surface import SUPERSAMPLING, MapPanel
from anm_mj.replay.timeline import Timeline, known_pieces
from anm_mj.types import Intrinsics, Pose2
from anm_mj.viz import palette
from tests.box_room import camera_pose


def timeline(true_y_m=0.0, covariance=None, lost=()):
    frames = tuple(
        FrameRecord(
            k, 0.1 * k, Pose2(0.2 * k, 0.0, 0.0), np.eye(4), Pose2(0.2 * k, true_y_m, 0.0), np.eye(4),
            is_lost=k in lost, covariance_xy_m2=covariance,
        )
        for k in range(8)
    )  # fmt: skip
    camera = Intrinsics.from_fov(8, 8, 1.5)
    return Timeline(Run(RunFolder(Path()), camera, (8, 8), frames, (), (), {}, {}))


def test_a_true_trajectory_is_shown_only_where_it_is_another():
    assert timeline().true_xy_m is None
    true_xy_m = timeline(0.3).true_xy_m
    assert true_xy_m is not None
    np.testing.assert_allclose(true_xy_m[:, 1], 0.3)


def test_the_ellipse_holds_two_standard_deviations():
    assert timeline().ellipse_m(0) is None
    turned = math.radians(30.0)
    rotation = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    (xx, xy), (_, yy) = rotation @ np.diag([0.04, 0.01]) @ rotation.T
    ellipse = timeline(covariance=(xx, xy, yy)).ellipse_m(3)
    assert ellipse is not None
    long, short, direction = ellipse
    assert (long, short) == (pytest.approx(0.4), pytest.approx(0.2))
    assert math.remainder(direction - turned, math.pi) == pytest.approx(0.0, abs=1e-9)


def test_a_trajectory_has_a_gap_where_the_robot_was_lost():
    shown = timeline(lost=(2, 3, 7))
    pieces = known_pieces(shown, 7)
    assert [piece[:, 0].round(1).tolist() for piece in pieces] == [[0.0, 0.2], [0.8, 1.0, 1.2]]
    assert known_pieces(timeline(lost=range(8)), 7) == []


def test_the_map_shows_both_trajectories_and_the_ellipse():
    panel = MapPanel(np.array([[-0.1, -0.6], [1.6, 1.1]]), 0.18)

    def colours(shown):
        image = np.asarray(panel.draw(shown, 7, np.zeros((0, 2)))).reshape(-1, 3)
        return {tuple(each) for each in image.tolist()}

    plain = colours(timeline())
    assert getrgb(palette.TRUE) not in plain
    with_truth = colours(timeline(0.3, covariance=(0.03, 0.01, 0.02)))
    assert {getrgb(palette.TRUE), getrgb(palette.PATH)} <= with_truth
    assert getrgb(palette.CAMERA) in plain
    assert getrgb(palette.CAMERA) not in colours(timeline(lost=range(8)))


@pytest.mark.parametrize(("fov_rad", "aside_rad"), [(1.5, 0.0), (0.8, 0.0), (0.8, 0.4)])
def test_the_cone_of_the_robot_is_what_its_camera_sees(fov_rad, aside_rad):
    T_world_camera = camera_pose(Pose2(0.0, 0.0, aside_rad))
    frame = FrameRecord(0, 0.0, Pose2(0.0, 0.0, 0.0), T_world_camera, Pose2(0.0, 0.0, 0.0), T_world_camera)
    camera = Intrinsics.from_fov(80, 80, fov_rad)
    shown = Timeline(Run(RunFolder(Path()), camera, (80, 80), (frame,), (), (), {}, {}))
    panel = MapPanel(np.array([[-1.0, -1.0], [1.0, 1.0]]), 0.18)
    image = np.asarray(panel.draw(shown, 0, np.zeros((0, 2)))).astype(int)
    angles, ((x, y),) = np.linspace(-math.pi, math.pi, 3600, endpoint=False), panel._px(np.zeros((1, 2)))
    radius_px = 0.45 / panel._metres_per_px
    col, row = (
        np.rint(at / SUPERSAMPLING).astype(int)
        for at in (x + radius_px * np.cos(angles), y - radius_px * np.sin(angles))
    )
    inside = angles[np.abs(image[row, col] - getrgb("#bcd2e6")).max(axis=1) < 8]
    assert inside.min() == pytest.approx(aside_rad - fov_rad / 2, abs=0.03)
    assert inside.max() == pytest.approx(aside_rad + fov_rad / 2, abs=0.03)
