"""Names of wheels as they are used in the wild."""

import pytest

from anm_mj.robot.drive_joints import side_of

_LEFT = (
    "wheel_left",
    "left_wheel",
    "wheel_left_joint",
    "left_wheel_joint",
    "joint_left_wheel",
    "joint_wheel_left",
    "leftWheel",
    "LeftWheelJoint",
    "base_left_wheel_joint",
    "wheel_l",
    "l_wheel_joint",
    "wheelLeft",
    "leftwheel",
    "left_wheel_hinge",
    "robot/wheel_left",
    "drive_wheel_left",
    "front_left_wheel",
    "rear_left_wheel_joint",
    "fl_wheel",
    "wheel_FL",
    "wheel_bl",
    "port_wheel",
    "left_tire",
    "drivewhl_l_joint",
)
_NONE = (
    "left_caster_wheel",
    "caster_left_wheel_joint",
    "suspension_left_joint",
    "left_shoulder",
    "arm_left_joint",
    "joint_lift",
    "swivel_wheel_left",
    "left_finger",
    "wheel_suspension_left",
    "leftcaster_wheel",
)


@pytest.mark.parametrize("name", _LEFT)
def test_left_wheels(name):
    assert side_of(name) == "left"


@pytest.mark.parametrize("name", [n.replace("left", "right").replace("Left", "Right") for n in _LEFT if "eft" in n])
def test_right_wheels(name):
    assert side_of(name) == "right"


@pytest.mark.parametrize("name", _NONE)
def test_no_driven_wheels(name):
    assert side_of(name) == ""


def test_wheels_of_no_side():
    assert side_of("wheel_1_joint") == side_of("drive_wheel") == "wheel"
