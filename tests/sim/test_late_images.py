"""Images that arrive late show the world of a moment ago, and say so."""

import itertools
import math

import numpy as np
import pytest

from anm_mj.control.action_motion import MotionLimits, action_profile
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, pose_matrix, wrap_angle
from anm_mj.people.people_config import PeopleConfig
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.scene.folder import load_scene
from anm_mj.sim.ahead_camera import AheadCamera
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action, TruePeople, Twist

FORWARD, LEFT, RIGHT, WAIT = Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT, Action.WAIT
LATE = SensorConfig(delay_s=0.1)


@pytest.fixture(scope="module")
def scene():
    return load_scene("flat")


def share(action: Action, before_end_s: float) -> float:
    profile = action_profile(action, MotionLimits())
    return profile.fraction(profile.duration_s - before_end_s)


def people_of(robot: SimRobot) -> TruePeople:
    people = robot.true_view().people
    assert people is not None
    return people


def yaw_of(T_world_camera: np.ndarray) -> float:
    return math.atan2(T_world_camera[1, 2], T_world_camera[0, 2])


def test_an_image_shows_the_middle_of_the_motion_that_it_was_taken_in(scene):
    with make_robot(scene, image_px=64, sensor=LATE) as robot, make_robot(scene, image_px=64) as there:
        start = robot.pose
        first = robot.observe()
        assert np.array_equal(first.rgb, there.observe().rgb)
        for action, motion in ((LEFT, (0.0, TURN_STEP_RAD)), (FORWARD, (FORWARD_STEP_M, 0.0))):
            robot.act(action)
            seen = robot.observe()
            part = share(action, 0.1)
            assert 0.8 < part < 0.97
            then = move_pose(start, *(part * way for way in motion))
            start = move_pose(start, *motion)
            there.place(then)
            expected = there.observe()
            np.testing.assert_allclose(seen.T_world_camera, expected.T_world_camera, atol=1e-9)
            np.testing.assert_allclose(seen.depth_m, expected.depth_m, atol=1e-3)
            assert (seen.pose.x_m, seen.pose.yaw_rad) == pytest.approx((start.x_m, start.yaw_rad))
            assert seen.image_age_s == 0.1
            np.testing.assert_array_equal(robot.true_view().T_world_camera, seen.T_world_camera)
            assert robot.true_view().pose == seen.pose
        # It catches up while the robot waits.
        robot.act(WAIT)
        np.testing.assert_allclose(robot.observe().T_world_camera[:2, 3], start.xy_m, atol=0.2)
        assert yaw_of(robot.observe().T_world_camera) == pytest.approx(start.yaw_rad)


def test_a_delay_longer_than_a_step_reaches_into_the_one_before(scene):
    with make_robot(scene, image_px=64, sensor=SensorConfig(delay_s=0.5)) as robot:
        start = robot.pose
        seen = [robot.observe().T_world_camera]
        for _ in range(3):
            robot.act(LEFT)
            seen.append(robot.observe().T_world_camera)
        step_s = action_profile(LEFT, MotionLimits()).duration_s
        turned = [wrap_angle(yaw_of(T) - start.yaw_rad) / TURN_STEP_RAD for T in seen]
        part = share(LEFT, 0.5 - step_s)
        assert turned == pytest.approx([0.0, 0.0, part, 1.0 + part], abs=1e-6)
        # Put elsewhere, it has no past.
        robot.place(start)
        assert yaw_of(robot.observe().T_world_camera) == pytest.approx(start.yaw_rad)


def test_the_stamp_and_the_encoders_tell_where_the_camera_was(scene):
    """Odometry is wrong by now, but not about the last tenth of a second."""
    sensor = SensorConfig(delay_s=0.1, odometry_alpha=(0.01, 0.01, 0.01, 0.01))
    with make_robot(scene, image_px=64, sensor=sensor, pose="odometry", model=RobotConfig(wheel_noise=0.02)) as robot:
        for action in (FORWARD, LEFT, FORWARD, LEFT, LEFT):
            robot.act(action)
            seen, true = robot.observe(), robot.true_view()
            assert abs(wrap_angle(seen.pose.yaw_rad - true.pose.yaw_rad)) > 1e-4
            now_then = np.linalg.inv(pose_matrix(seen.pose)) @ seen.T_world_camera
            truly = np.linalg.inv(pose_matrix(true.pose)) @ true.T_world_camera
            np.testing.assert_allclose(now_then, truly, atol=5e-3)


def test_a_stamp_that_errs_puts_the_camera_where_it_was_at_another_time(scene):
    with make_robot(scene, image_px=64, sensor=SensorConfig(delay_s=0.1, stamp_error_s=0.02)) as robot:
        robot.act(LEFT)
        seen, true = robot.observe(), robot.true_view()
        off_rad = wrap_angle(yaw_of(seen.T_world_camera) - yaw_of(true.T_world_camera))
        assert off_rad == pytest.approx((share(LEFT, 0.08) - share(LEFT, 0.1)) * TURN_STEP_RAD)
        assert seen.image_age_s == pytest.approx(0.08)
    with make_robot(scene, image_px=64, sensor=SensorConfig(stamp_error_s=-0.02)) as robot:
        robot.act(LEFT)
        off_rad = yaw_of(robot.observe().T_world_camera) - robot.pose.yaw_rad
        assert off_rad == pytest.approx((share(LEFT, 0.02) - 1.0) * TURN_STEP_RAD)


@pytest.mark.parametrize("pose", ["true", "odometry"])
def test_in_physics_and_among_people(scene, pose):
    options = {"image_px": 64, "drive": "physics", "people": PeopleConfig(number=2), "pose": pose}
    with make_robot(scene, sensor=LATE, **options) as robot, make_robot(scene, **options) as prompt:
        for action in (LEFT, LEFT, FORWARD, RIGHT, FORWARD):
            assert robot.act(action) == prompt.act(action)
            late, now = robot.observe(), prompt.observe()
            # What happens is the same, what is seen of it is older. Wheels creep while they accelerate.
            assert late.pose == now.pose
            np.testing.assert_array_equal(people_of(robot).states, people_of(prompt).states)
            np.testing.assert_allclose(late.T_world_camera, robot.true_view().T_world_camera, atol=6e-3)
            assert 1e-4 < np.abs(late.T_world_camera - now.T_world_camera).max() < 0.1
        # A velocity leaves no time to settle.
        for _ in range(5):
            robot.drive(Twist(0.2, 0.0), 0.2)
        seen = robot.observe()
        ahead_m = np.linalg.norm(robot.true_view().T_world_camera[:2, 3] - robot.data.cam_xpos[-1, :2])
        assert ahead_m == pytest.approx(0.02, abs=0.004)
        assert seen.time_s == robot.data.time


def test_people_are_shown_where_they_were(scene):
    """The robot waits, so that only people differ between an image and that of a period later."""
    options = {"image_px": 128, "people": PeopleConfig(number=6, longest_stand_s=0.0)}
    sensor = SensorConfig(delay_s=action_profile(WAIT, MotionLimits()).duration_s)
    with make_robot(scene, sensor=sensor, **options) as robot, make_robot(scene, **options) as prompt:
        late, now, shown = [], [], False
        for _ in range(40):
            late.append(robot.observe())
            now.append(prompt.observe())
            shown |= bool(people_of(robot).shown.any())
            robot.act(WAIT)
            prompt.act(WAIT)
        assert shown
        assert any((a.rgb != b.rgb).any() for a, b in itertools.pairwise(now))
        for before, after in zip(now, late[1:], strict=False):
            assert np.array_equal(before.rgb, after.rgb)


@pytest.mark.parametrize("people", [0, 2])
def test_an_image_that_is_begun_ahead_is_late_too(scene, people, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    options = {"image_px": 64, "people": PeopleConfig(number=people), "sensor": LATE}
    actions = [FORWARD, LEFT, RIGHT, FORWARD, RIGHT, LEFT]
    with make_robot(scene, anticipates=True, **options) as robot, make_robot(scene, **options) as plain:
        robot.observe()
        plain.observe()
        camera = robot._camera
        assert isinstance(camera, AheadCamera)
        for action, following in itertools.pairwise(actions):
            robot.anticipate(action, following)
            begun = camera.num_begun
            robot.act(action)
            plain.act(action)
            seen, expected = robot.observe(), plain.observe()
            assert camera.num_begun == begun - 1
            assert np.array_equal(seen.rgb, expected.rgb)
            assert np.array_equal(seen.T_world_camera, expected.T_world_camera)


def test_what_no_camera_does_is_refused():
    with pytest.raises(RobotError, match=r"delay_s is -0\.1; it must be"):
        SensorConfig(delay_s=-0.1)
    with pytest.raises(RobotError, match=r"delay_s is 7\.0; .*at most 2"):
        SensorConfig(delay_s=7.0)
    with pytest.raises(RobotError, match=r"stamp_error_s is 0\.7; .*at most 0\.5"):
        SensorConfig(stamp_error_s=0.7)
    with pytest.raises(
        RobotError, match=r"stamp_error_s is 0\.05 s and sensor\.delay_s 0\.02 s; .* give a delay_s as long"
    ):
        SensorConfig(delay_s=0.02, stamp_error_s=0.05)
    SensorConfig(delay_s=0.02, stamp_error_s=0.02)
