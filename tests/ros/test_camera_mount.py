"""A live robot's camera that is mounted on its side gives upright images; one that looks away is refused."""

import math
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.frames import back_project
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.ros.commander import Commander
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.health import Health
from anm_mj.ros.live_robot import LiveRobot
from anm_mj.ros.poses import Poses
from anm_mj.ros.rgbd_intake import Rgbd, RgbdIntake
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import camera_pose, room_depth

HERE = Pose2(0.3, -0.2, 0.4)
UPRIGHT = Intrinsics(48, 64, 40.0, 50.0, 20.0, 30.0)
"""Nothing of it is symmetric."""
ON_SIDE = {
    0: UPRIGHT,
    90: Intrinsics(64, 48, 50.0, 40.0, 30.0, 28.0),
    180: Intrinsics(48, 64, 40.0, 50.0, 28.0, 34.0),
    -90: Intrinsics(64, 48, 50.0, 40.0, 34.0, 20.0),
}
"""The same camera by how far it was turned clockwise, seen along its axis [deg]."""


def rotation(axis: int, angle_deg: float) -> np.ndarray:
    """About x, y or z."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    T, (i, j) = np.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
    T[i, i], T[i, j], T[j, i], T[j, j] = c, -s, s, c
    return T


def mounted(*, roll_deg: float = 0.0, aside_deg: float = 0.0, tilt_deg: float = 0.0) -> np.ndarray:
    """``T_base_camera``: rolled clockwise as seen along its axis, turned to the left, tilted up."""
    straight = camera_pose(Pose2(0.05, 0.02, 0.0), 1.2)
    return rotation(2, aside_deg) @ straight @ rotation(0, tilt_deg) @ rotation(2, roll_deg)


def live_robot(T_base_camera: np.ndarray, camera: Intrinsics = UPRIGHT) -> LiveRobot:
    """A robot in the box room whose images are as its camera takes them."""
    T_world_camera = camera_pose(HERE) @ np.linalg.inv(camera_pose(Pose2(0.0, 0.0, 0.0))) @ T_base_camera
    depth_m = room_depth(T_world_camera, camera)
    # The colour tells where its pixel looks.
    rgb = np.repeat((depth_m * 50.0).astype(np.uint8)[..., None], 3, axis=2)
    intake, poses = Mock(spec=RgbdIntake), Mock(spec=Poses, latest_s=1.0, base_frame="base_link")
    intake.depth = "/depth"
    intake.wait_newer.return_value = Rgbd(1.0, rgb, depth_m, "camera_optical", camera)
    poses.base.return_value, poses.camera.return_value = HERE, T_base_camera
    return LiveRobot(intake, poses, Mock(spec=Commander), Health(1.0), DriveConfig("live", pose="odometry"))


@pytest.mark.parametrize("roll_deg", ON_SIDE)
@pytest.mark.parametrize("tilt_deg", [0.0, -20.0])
def test_images_come_upright_however_the_camera_is_mounted(roll_deg: int, tilt_deg: float):
    expected = live_robot(mounted(tilt_deg=tilt_deg)).observe()
    robot = live_robot(mounted(roll_deg=roll_deg, tilt_deg=tilt_deg), ON_SIDE[roll_deg])

    for seen in (robot.observe(), robot.observe()):
        assert seen.intrinsics == UPRIGHT
        np.testing.assert_allclose(seen.depth_m, expected.depth_m, atol=1e-5)
        assert np.abs(seen.rgb.astype(int) - expected.rgb).max() <= 1
        np.testing.assert_allclose(seen.T_world_camera, expected.T_world_camera, atol=1e-12)
        assert seen.rgb.flags.c_contiguous
        assert seen.depth_m.flags.c_contiguous


@pytest.mark.parametrize("roll_deg", [-100, -80, 20, 40, 75, 170])
def test_a_camera_between_the_quarter_turns_keeps_its_pixels_where_they_are(roll_deg: int):
    T_base_camera, nearest = mounted(roll_deg=roll_deg), round(roll_deg / 90) * 90
    robot = live_robot(T_base_camera, ON_SIDE[nearest])
    raw = robot._intake.wait_newer(0.0, 0.0)
    assert raw is not None

    seen = robot.observe()

    assert seen.intrinsics == UPRIGHT
    T_world_camera = camera_pose(HERE) @ np.linalg.inv(camera_pose(Pose2(0.0, 0.0, 0.0))) @ T_base_camera
    points, truth = (
        back_project(*view)
        for view in (
            (seen.depth_m, seen.intrinsics, seen.T_world_camera),
            (raw.depth_m, raw.intrinsics, T_world_camera),
        )
    )
    order, in_truth = (np.lexsort(np.round(p, 6).T) for p in (points, truth))
    np.testing.assert_allclose(points[order], truth[in_truth], atol=1e-5)
    # Down in the image is down.
    assert seen.T_world_camera[2, 1] < -math.cos(math.radians(45.0))


def test_a_camera_on_its_side_is_as_wide_as_it_is_high():
    # 1280 x 720 of a D435 on Stretch's head, eight times smaller.
    camera = Intrinsics(160, 90, 115.0, 115.0, 80.0, 45.0)

    seen = live_robot(mounted(roll_deg=90.0), camera).observe()

    width_deg = math.degrees(FieldOfView.of(seen).width_rad)
    assert width_deg == pytest.approx(2.0 * math.degrees(math.atan(45.0 / 115.0)), abs=1e-3)


def test_a_camera_that_is_rolled_by_a_part_of_a_quarter_turn_is_told(caplog):
    live_robot(mounted(roll_deg=8.0)).observe()
    assert not caplog.records

    live_robot(mounted(roll_deg=-30.0)).observe()

    assert "mounted rolled by -30 degrees" in caplog.text


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ({"aside_deg": 90.0, "roll_deg": 90.0}, "looks 90 degrees to the left of where 'base_link' drives; .* 30 deg"),
        ({"aside_deg": -31.0}, "looks 31 degrees to the right of where 'base_link' drives; it must look within 30 deg"),
        ({"tilt_deg": 46.0}, "looks 46 degrees up; it must look within 45 degrees of the horizontal"),
        ({"tilt_deg": -90.0}, "looks 90 degrees down"),
    ],
)
def test_a_camera_that_looks_away_is_refused(where: dict[str, float], said: str):
    with pytest.raises(RobotError, match=f"The camera in the frame 'camera_optical' {said}.*on tf right"):
        live_robot(mounted(**where)).observe()


def test_a_camera_may_look_a_little_aside_and_down():
    seen = live_robot(mounted(aside_deg=30.0, tilt_deg=-45.0)).observe()
    assert FieldOfView.of(seen).azimuth_rad == pytest.approx(math.radians(30.0), abs=0.005)


def test_only_the_first_image_decides():
    robot = live_robot(mounted(roll_deg=90.0), ON_SIDE[90])
    robot.observe()
    away = mounted(roll_deg=20.0, aside_deg=50.0)
    robot._poses.camera.return_value = away  # type: ignore[attr-defined]

    assert robot.observe().intrinsics == UPRIGHT


def test_a_run_that_goes_on_keeps_its_camera():
    first, T_base_camera = live_robot(mounted(roll_deg=90.0), ON_SIDE[90]), mounted(roll_deg=40.0)
    first.observe()
    for state, camera in ((first.get_state(), UPRIGHT), (None, ON_SIDE[90])):
        robot = live_robot(T_base_camera, ON_SIDE[90])
        robot.set_state(state)
        assert robot.observe().intrinsics == camera
