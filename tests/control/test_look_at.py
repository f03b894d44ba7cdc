import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from anm_mj.control.look_at import LookAt, PlanarLookAt
from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.errors import RobotError
from anm_mj.frames import wrap_angle
from anm_mj.robot.description import describe_robot
from anm_mj.robot.kinematics import PlanarKinematics, kinematics_of
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, Twist
from tests.robots import ROVER_XML, clearance_of

_PERIOD_S = 0.02
_MODELS = Path(__file__).parents[1] / "robot" / "models"


@pytest.fixture(params=["kinematic", "physics"])
def drive(request, compile_scene, description):
    model, data = compile_scene()
    if request.param == "kinematic":
        return KinematicDrive(model, data, description, clearance_of())
    return PhysicsDrive(model, data, description)


@pytest.fixture(scope="module")
def look(description, kinematics):
    return LookAt(description, kinematics, MotionLimits(), period_s=_PERIOD_S)


@given(
    bearing=st.floats(-math.pi, math.pi), away_m=st.floats(0.1, 6.0), up_m=st.floats(-1.2, 1.0), yaw=st.floats(-3, 3)
)
@settings(max_examples=12, deadline=None, phases=(Phase.explicit, Phase.generate))
def test_look_at_respects_limits(look, bearing, away_m, up_m, yaw):
    start = pose = Pose2(0.5, -0.3, yaw)
    point = np.array([0.5 + away_m * math.cos(yaw + bearing), -0.3 + away_m * math.sin(yaw + bearing), 1.25 + up_m])
    look.reset()
    rates, turned = [0.0, 0.0], 0.0
    while (following := look.next_pose(pose, point)) is not None:
        rates.append(wrap_angle(following.yaw_rad - pose.yaw_rad) / _PERIOD_S)
        turned += abs(rates[-1]) * _PERIOD_S
        assert (following.x_m, following.y_m) == (pose.x_m, pose.y_m)
        pose = following
        assert len(rates) < 250
    assert abs(wrap_angle(pose.yaw_rad - start.yaw_rad - bearing)) < math.radians(0.02)
    assert turned == pytest.approx(abs(bearing), abs=math.radians(0.1))
    assert np.abs(rates).max() <= MotionLimits().turn_radps + 1e-6
    assert np.diff(np.abs(rates)).max() <= MotionLimits().turn_radps2 * _PERIOD_S + 1e-6


def test_look_at_point_above(look):
    look.reset()
    assert look.next_pose(Pose2(1.0, 2.0, 0.7), np.array([1.0, 2.0, 2.5])) is None


def test_look_at_of_both_drives(drive):
    drive.place(Pose2(1.0, 1.0, 0.0))
    result = drive.look_at(np.array([1.0, 3.0, 0.4]))
    assert not result.collided
    assert drive.pose.yaw_rad == pytest.approx(math.pi / 2, abs=math.radians(0.1))
    assert math.hypot(drive.pose.x_m - 1.0, drive.pose.y_m - 1.0) < 0.001
    assert result.turned_rad == pytest.approx(math.pi / 2, abs=math.radians(0.1))
    assert result.equivalent_steps == pytest.approx(9.0, abs=0.1)
    assert result.duration_s > 0.5
    # And goes on in steps from there.
    drive.act(Action.MOVE_FORWARD)
    assert (drive.pose.x_m, drive.pose.y_m) == pytest.approx((1.0, 1.065), abs=0.001)


def test_a_moving_robot_stops_before_it_looks(drive):
    drive.drive(Twist(0.3, 0.2), 0.4)
    before = drive.pose
    drive.look_at(np.array([-5.0, 0.0, 1.0]))
    assert abs(drive.pose.yaw_rad) > math.radians(175.0)
    # The way to brake from 0.3 m/s at 1.5 m/s2.
    assert math.hypot(drive.pose.x_m - before.x_m, drive.pose.y_m - before.y_m) < 0.05


def planar_look(camera_x_m, camera_y_m):
    """The controller of a holonomic base whose camera looks ahead from a place on it."""
    T_base_camera = np.eye(4)
    T_base_camera[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    T_base_camera[:3, 3] = camera_x_m, camera_y_m, 1.3
    return PlanarLookAt(PlanarKinematics(T_base_camera), MotionLimits(), period_s=_PERIOD_S)


def wheeled_look():
    """The controller of a robot on two wheels whose camera looks ahead from 10.8 cm before its axis."""
    lifting = describe_robot(_MODELS / "lifting.xml")
    return LookAt(lifting, kinematics_of(lifting), MotionLimits(), period_s=_PERIOD_S)


def turned_towards(look, pose, point_m):
    look.reset()
    for _ in range(300):
        following = look.next_pose(pose, point_m)
        if following is None:
            return pose
        pose = following
    raise AssertionError("it turns for ever")


@pytest.mark.parametrize("make", [lambda: planar_look(0.05, -0.003), wheeled_look], ids=["planar", "wheeled"])
def test_a_point_between_the_camera_and_the_axis_is_refused(make):
    look = make()
    for away_m in (0.0, 0.03):
        with pytest.raises(RobotError, match=rf"the point is {away_m:.3g} m from .* axis of rotation, and the camera"):
            look.next_pose(Pose2(1.0, 2.0, 0.7), np.array([1.0 - away_m, 2.0, 2.5]))


@pytest.mark.parametrize("away_m", [0.12, 0.2, 0.5])
def test_a_point_just_beyond_the_camera_is_faced(away_m):
    point_m = np.array([1.0 - away_m, 2.0, 0.4])
    for look in (planar_look(0.108, 0.0), planar_look(0.05, 0.09), wheeled_look()):
        pose = turned_towards(look, Pose2(1.0, 2.0, 0.7), point_m)
        assert abs(look.error_rad(pose, point_m)) < math.radians(0.02)


@pytest.mark.parametrize(
    ("camera", "beyond_m", "bearing"), [("0.3,0,0.5,0,60", 0.001, -1.5), ("0.1,-1,0.5,10,60", 1.0, -2.7)]
)
def test_a_camera_far_from_the_axis_faces_a_point_by_the_shortest_turn(camera, beyond_m, bearing):
    robot = describe_robot(ROVER_XML, RobotConfig(camera_pose=camera))
    look = LookAt(robot, kinematics_of(robot), MotionLimits(), period_s=_PERIOD_S)
    away_m = math.hypot(*robot.T_base_camera[:2, 3]) + beyond_m
    point_m = np.array([away_m * math.cos(bearing), away_m * math.sin(bearing), 0.4])
    start = Pose2(0.0, 0.0, 0.0)
    turn_rad = look.turn_rad(start, point_m)
    pose = turned_towards(look, start, point_m)
    assert pose.yaw_rad == pytest.approx(turn_rad, abs=math.radians(0.02))
    assert abs(look.error_rad(pose, point_m)) < math.radians(0.02)


def test_a_camera_behind_the_axis_faces_a_point_above_it():
    pose = turned_towards(planar_look(-0.1, 0.0), Pose2(1.0, 2.0, 0.7), np.array([0.98, 2.0, 2.5]))
    assert abs(wrap_angle(pose.yaw_rad - math.pi)) < math.radians(0.02)


def test_a_drive_refuses_a_point_that_no_turn_faces(compile_scene, description):
    drive = KinematicDrive(*compile_scene(), description, clearance_of())
    drive._look_at = planar_look(0.05, 0.0)
    drive.place(Pose2(1.0, 1.0, 0.3))
    with pytest.raises(RobotError, match="give a point farther away"):
        drive.look_at(np.array([1.0, 1.0, 2.5]))
    assert drive.pose == Pose2(1.0, 1.0, 0.3)
