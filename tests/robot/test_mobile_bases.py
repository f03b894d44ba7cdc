"""Bases of other makes: suspensions, arms, cameras far down, four driven wheels, planar joints."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.robot.description import describe_robot
from anm_mj.robot.robot_camera import tilt_deg
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, StopReason, Twist
from tests.robots import ROVER_XML, clearance_of

MODELS = Path(__file__).parent / "models"
ACTIONS = [Action.MOVE_FORWARD] * 2 + [Action.TURN_LEFT] * 3 + [Action.MOVE_FORWARD] * 2 + [Action.TURN_RIGHT]
START = Pose2(0.0, 0.0, 0.0)
KINDS = [
    ("lifting", {}),
    ("bimanual", {}),
    ("four_wheels", {"skid_steer": True}),
    ("planar", {}),
]


def describe(name, **config):
    return describe_robot(MODELS / f"{name}.xml", RobotConfig(**config))


def on_a_floor(robot):
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>')
    spec.attach(robot.spec.copy(), prefix="r/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    return model, mujoco.MjData(model)


def edited(tmp_path, name, *changes):
    text = (MODELS / f"{name}.xml").read_text() if name != "rover" else ROVER_XML.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / f"{name}.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("name", "config"), KINDS)
def test_both_drives_agree(name, config):
    robot = describe(name, **config)
    model, data = on_a_floor(robot)
    exact = KinematicDrive(model, data, robot, clearance_of(), prefix="r/")
    exact.place(START)
    for action in ACTIONS:
        exact.act(action)
    model, data = on_a_floor(robot)
    driven = PhysicsDrive(model, data, robot, prefix="r/")
    driven.place(START)
    for action in ACTIONS:
        result = driven.act(action)
        assert not result.collided
        assert result.fault is None
    np.testing.assert_allclose(driven.pose.xy_m, exact.pose.xy_m, atol=0.002)
    assert driven.pose.yaw_rad == pytest.approx(exact.pose.yaw_rad, abs=math.radians(0.2))
    looked = driven.look_at(np.array([0.0, 3.0, 0.5]))
    assert not looked.collided
    assert driven.pose.yaw_rad == pytest.approx(math.atan2(3.0 - driven.pose.y_m, -driven.pose.x_m), abs=0.1)


def test_suspension_arm_and_head_are_locked_at_the_key_frame():
    stowed, reaching = describe("lifting"), describe("lifting", keyframe="reach")
    assert stowed.key_frame == "stow"
    assert stowed.wheel_joints == ("wheel_left_joint", "wheel_right_joint")
    assert {"suspension_left_joint", "torso_lift_joint", "arm_2_joint", "caster_back_2_joint"} <= set(stowed.locked)
    model = stowed.spec.compile()
    assert model.njnt == 3
    # Servos hold their targets: the lift is up by 5 cm, and the arm folded inside the base's circle.
    assert model.body("torso_lift_link").pos[2] == pytest.approx(0.93, abs=1e-6)
    assert stowed.footprint.radius_m == pytest.approx(0.27, abs=1e-3)
    assert reaching.footprint.radius_m > 0.6
    assert any("2.0 mm" in note for note in stowed.notes)


def test_key_frame_of_positions():
    robot = describe("bimanual")
    upper = robot.spec.compile().body("follower_left")
    still = describe_robot(MODELS / "bimanual.xml", RobotConfig(keyframe="home")).spec.compile().body("follower_left")
    np.testing.assert_allclose(upper.quat, still.quat)
    # 90 degrees by the frame about z, then 10 by the body and 0.5 rad by the joint about the same y.
    up = np.empty(9)
    mujoco.mju_quat2Mat(up, upper.quat)
    angle = math.radians(10.0) + 0.5
    np.testing.assert_allclose(up.reshape(3, 3)[:, 2], [0.0, math.sin(angle), math.cos(angle)], atol=1e-9)


def test_camera_far_down_is_taken_and_wrists_are_not():
    robot = describe("bimanual")
    assert robot.camera == "cam_high"
    assert tilt_deg(robot.T_base_camera) == pytest.approx(37.0, abs=0.1)
    assert describe("planar").camera == "base"


def test_four_driven_wheels_slip_in_turns():
    robot = describe("four_wheels", skid_steer=True)
    assert robot.kind == "skid steer"
    assert robot.wheel_joints == ("front_left_wheel", "rear_left_wheel", "front_right_wheel", "rear_right_wheel")
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(START)
    for _ in range(4):
        drive.act(Action.TURN_LEFT)
    assert drive.pose.yaw_rad == pytest.approx(math.radians(40.0), abs=0.01)
    slip = drive.odometry.yaw_rad / drive.pose.yaw_rad
    assert slip > 1.3
    scaled = describe("four_wheels", skid_steer=True, track_scale=round(slip, 2))
    model, data = on_a_floor(scaled)
    drive = PhysicsDrive(model, data, scaled, prefix="r/")
    drive.place(START)
    for _ in range(4):
        drive.act(Action.TURN_LEFT)
    assert drive.odometry.yaw_rad == pytest.approx(drive.pose.yaw_rad, rel=0.15)


LONG = [('size="0.095 0.00001"', 'size="0.05 0.00001"'), ('pos="0.131', 'pos="0.2'), ('pos="-0.131', 'pos="-0.2')]


def long_base(tmp_path):
    """A drive of a base whose wheels stand far apart lengthwise, so that they slip much in turns."""
    path = edited(tmp_path, "four_wheels", *LONG)
    robot = describe_robot(path, RobotConfig(skid_steer=True))
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(START)
    return drive


@pytest.mark.parametrize("towards_deg", [20.0, 90.0, -150.0])
def test_slipping_wheels_turn_as_far_as_they_should(tmp_path, towards_deg):
    drive, towards_rad = long_base(tmp_path), math.radians(towards_deg)
    looked = drive.look_at(np.array([3.0 * math.cos(towards_rad), 3.0 * math.sin(towards_rad), 0.5]))
    assert not looked.collided
    assert drive.pose.yaw_rad == pytest.approx(towards_rad, abs=math.radians(0.5))


def test_a_turn_that_slips_away_is_not_made_up_for(tmp_path):
    drive = long_base(tmp_path)
    turned_rad = sum(drive.drive(Twist(0.0, 1.5), 0.5).turned_rad for _ in range(8))
    assert turned_rad < 5.5
    turned_rad += drive.drive(Twist(0.0, 0.0), 1.0).turned_rad
    before = drive.pose
    assert not drive.act(Action.MOVE_FORWARD).collided
    assert drive.pose.yaw_rad == pytest.approx(before.yaw_rad, abs=math.radians(1.0))
    assert math.dist(drive.pose.xy_m, before.xy_m) == pytest.approx(0.065, abs=0.01)


@pytest.mark.parametrize("frame", ["", '<frame pos="0.3 0 0.1" euler="0 0 0.2">'])
def test_planar_joints_become_the_base(tmp_path, frame):
    place = '<body name="base_link" pos="0 0 -0.1">' if frame else '<body name="base_link">'
    text = edited(tmp_path, "planar", ('<body name="base_link">', frame + place)).read_text()
    path = tmp_path / "framed.xml"
    path.write_text(text.replace("</worldbody>", "</frame></worldbody>") if frame else text)
    robot = describe_robot(path, RobotConfig())
    assert (robot.kind, robot.wheel_joints, robot.wheel_radius_m) == ("holonomic", (), 0.0)
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(Pose2(1.0, -2.0, 2.5))
    mujoco.mj_forward(model, data)
    ahead = -data.cam("r/base").xmat.reshape(3, 3)[:, 2]
    assert math.atan2(ahead[1], ahead[0]) == pytest.approx(2.5, abs=1e-6)
    assert (robot.footprint.z_min_m, robot.footprint.radius_m) == pytest.approx((0.05, 0.330), abs=1e-3)


def test_a_planar_base_that_turns_past_the_back_turns_the_shortest_way():
    robot = describe("planar")
    model, data = on_a_floor(robot)
    drive = KinematicDrive(model, data, robot, clearance_of(model, robot), prefix="r/")
    drive.place(Pose2(0.0, 0.0, math.radians(175.0)))
    before_rad = data.qpos[2]
    drive.act(Action.TURN_LEFT)
    assert drive.pose.yaw_rad == pytest.approx(math.radians(-175.0))
    assert data.qpos[2] - before_rad == pytest.approx(math.radians(10.0))


def test_wheels_without_telling_names_are_found(tmp_path):
    path = edited(tmp_path, "rover", ("left_wheel_joint", "motor_a"), ("right_wheel_joint", "motor_b"))
    assert describe_robot(path).wheel_joints == ("motor_a", "motor_b")
    path = edited(tmp_path, "four_wheels", ("front_left_wheel", "a"), ("front_right_wheel", "b"))
    named = describe_robot(path, RobotConfig(skid_steer=True))
    assert named.wheel_joints == ("a", "rear_left_wheel", "b", "rear_right_wheel")


def test_a_mounted_camera():
    robot = describe_robot(ROVER_XML, RobotConfig(camera_pose="0.1,0.05,0.4,20,75"))
    np.testing.assert_allclose(robot.T_base_camera[:3, 3], [0.1, 0.05, 0.4], atol=1e-9)
    assert tilt_deg(robot.T_base_camera) == pytest.approx(20.0)
    np.testing.assert_allclose(robot.T_base_camera[:3, 0], [0.0, -1.0, 0.0], atol=1e-9)
    assert robot.fovy_deg == 75.0


def test_a_robot_that_lies_on_its_side():
    robot = describe_robot(ROVER_XML)
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(START)
    assert drive.act(Action.TURN_LEFT).fault is None
    model.opt.gravity[:] = 0.0, 9.0, -3.0  # As on a steep slope: it falls over one wheel.
    faults = [drive.act(Action.TURN_LEFT).fault for _ in range(3)]
    assert faults[-1] is StopReason.TOPPLED


def test_a_simulation_that_becomes_unstable():
    robot = describe_robot(ROVER_XML)
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(START)
    data.qvel[0] = 1e11
    assert drive.act(Action.MOVE_FORWARD).fault is StopReason.DIVERGED


def test_a_robot_without_traction(tmp_path):
    slippery = edited(tmp_path, "rover", ('size="0.04 0.012"', 'size="0.04 0.012" friction="0.0001 0 0" priority="2"'))
    robot = describe_robot(slippery)
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(START)
    faults = [drive.act(Action.MOVE_FORWARD).fault for _ in range(6)]
    assert faults[0] is None
    assert faults[-1] is StopReason.NO_TRACTION


@pytest.mark.parametrize(
    ("name", "changes", "config", "message"),
    [
        ("four_wheels", [], {}, r"has 4 driven wheels \(front_left_wheel.* model.skid_steer=true"),
        ("lifting", [], {"skid_steer": True}, "skid_steer is set, but"),
        ("lifting", [], {"keyframe": "sit"}, r'no key frame "sit"; its key frames are reach, stow'),
        ("lifting", [("wheel_left", "part_a"), ("wheel_right", "part_b"),
          (' joint="part_a_joint"', ' joint="arm_1_joint"'), (' joint="part_b_joint"', ' joint="arm_2_joint"')],
         {}, "has no wheels"),
        ("planar", [('type="slide" axis="0 1 0"', 'type="slide" axis="0 0 1"')], {}, "has no wheels"),
        ("planar", [('name="base" pos', 'name="side" pos'), ("0 -0.7853981634 -1.5707963268", "0 -0.37 -1.5707963268")],
         {"camera": "side"}, "looks 69 degrees down; it must look within 45"),
        ("bimanual", [], {"camera": "cam_low"}, 'no camera "cam_low"; its cameras are cam_high, cam_left_wrist'),
        ("rover", [], {"camera_pose": "0,0,0.09,0,60"}, "inside the robot's body"),
        ("rover", [('<camera name="eye"', '<site name="eye"'), (' fovy="60"/>', "/>")], {},
         "has no camera: mount one by --set model.camera_pose"),
        ("rover", [('pos="0 0.11 -0.075"', 'pos="0 0.11 -0.125"')], {}, "cm below the wheels"),
        ("rover", [("left_wheel_joint", "l"), ('name="right_wheel_joint" axis', 'name="r" range="-9 9" axis'),
                   ("right_wheel_joint", "r")], {}, r"one driven wheel \(l\)"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path, name, changes, config, message):
    path = edited(tmp_path, name, *changes)
    with pytest.raises(RobotError, match=message):
        describe_robot(path, RobotConfig(**config))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"camera_pose": "1,2,3"}, "give x,y,z,pitch,fovy"),
        ({"camera_pose": "a,b,c,d,e"}, "give x,y,z,pitch,fovy"),
        ({"camera_pose": "0,0,nan,0,60"}, "must be finite"),
        ({"camera_pose": "0,0,0.3,60,60"}, "within 45 degrees of the horizontal"),
        ({"camera_pose": "0,0,0.3,0,180"}, "within 10 and 150"),
        ({"camera_pose": "0,0,-1,0,60"}, "its height must lie within"),
        ({"camera_pose": "0,0,0.3,0,60", "camera": "eye"}, "give one of the two"),
        ({"track_scale": 9.0}, "within 0.5 and 5"),
    ],
)
def test_settings_out_of_range(config, message):
    with pytest.raises(RobotError, match=message):
        RobotConfig(**config)
