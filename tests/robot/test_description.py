"""What is derived from a robot's MJCF: of our own robot, and of one that is written quite differently."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from anm_mj.errors import RobotError
from anm_mj.frames import T_GL_CV, move_pose, pose_matrix
from anm_mj.robot.base_joints import SimulatedBase
from anm_mj.robot.description import describe_robot
from anm_mj.robot.kinematics import RobotKinematics
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.robot.robot_presets import robot_path
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, Twist
from tests.robot.test_kinematics import differences
from tests.robots import ROVER_XML, clearance_of

_EXACT = 1e-10


@pytest.fixture(scope="module")
def rover():
    return describe_robot(ROVER_XML)


def on_a_floor(robot):
    """The robot attached to a world with a floor, as the simulation does it."""
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>')
    spec.attach(robot.spec.copy(), prefix="r/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    return model, mujoco.MjData(model)


def camera_pose(model, data, name):
    mujoco.mj_forward(model, data)
    pose = np.eye(4)
    pose[:3, :3] = data.cam(name).xmat.reshape(3, 3)
    pose[:3, 3] = data.cam(name).xpos
    return pose @ T_GL_CV


def test_figures_of_the_builtin_robot(description):
    assert (description.wheel_radius_m, description.track_m) == pytest.approx((0.05, 0.30))
    assert description.footprint.radius_m == pytest.approx(0.18)
    assert (description.footprint.z_min_m, description.footprint.z_max_m) == pytest.approx((0.05, 1.35))
    assert description.mass_kg == pytest.approx(9.6)
    assert description.shell == ("chassis", "mast", "head")
    assert description.motors == description.wheel_joints == ("wheel_left", "wheel_right")
    np.testing.assert_allclose(description.T_root_base, np.eye(4), atol=1e-12)


def test_figures_of_the_rover(rover):
    assert rover.wheel_joints == ("left_wheel_joint", "right_wheel_joint")
    assert rover.wheel_signs == (1.0, -1.0) or rover.wheel_signs == (-1.0, 1.0)
    assert (rover.wheel_radius_m, rover.track_m) == pytest.approx((0.04, 0.23))
    # Base: on the floor below the middle of the axle; the far corner of the bumper or of the box is the farthest.
    assert rover.body_radius_m == pytest.approx(math.hypot(0.10, 0.18), abs=1e-4)
    assert rover.footprint.radius_m == pytest.approx(rover.body_radius_m + 0.01)
    assert rover.footprint.z_min_m == pytest.approx(0.05)
    assert rover.footprint.z_max_m == pytest.approx(0.09 + 0.05 + 0.01)
    assert rover.camera == "eye"
    np.testing.assert_allclose(
        rover.T_base_camera, [[0, 0, 1, 0.15], [-1, 0, 0, -0.02], [0, -1, 0, 0.20], [0, 0, 0, 1]], atol=1e-9
    )
    names = {rover.spec.bodies[i].name for i in range(len(rover.spec.bodies))}
    assert names == {"world", "rover", "port", "starboard"}
    assert not rover.spec.lights


@pytest.mark.parametrize("name", ["description", "rover"])
def test_reduced_model_matches_the_simulation(request, name, tmp_path):
    robot = request.getfixturevalue(name)
    model, data = on_a_floor(robot)
    kinematics = RobotKinematics(robot)
    base = SimulatedBase(model, data, "r/", robot)
    for pose in (Pose2(0.0, 0.0, 0.0), Pose2(1.5, -2.0, 2.5), Pose2(-3.0, 0.4, -1.1)):
        base.place(pose)
        assert (base.pose.x_m, base.pose.y_m, base.pose.yaw_rad) == pytest.approx(
            (pose.x_m, pose.y_m, pose.yaw_rad), abs=_EXACT
        )
        seen = camera_pose(model, data, f"r/{robot.camera}")
        np.testing.assert_allclose(kinematics.T_world_camera(pose), seen, atol=_EXACT)
        # The wheels stand on the floor, to either side of the base.
        for joint, y in zip(robot.wheel_joints, (robot.track_m / 2, -robot.track_m / 2), strict=True):
            anchor = np.linalg.inv(pose_matrix(pose)) @ [*data.joint(f"r/{joint}").xanchor, 1.0]
            np.testing.assert_allclose(anchor[:3], [0.0, y, robot.wheel_radius_m], atol=_EXACT)
    path = tmp_path / "reduced.xml"
    path.write_text(robot.reduced_mjcf)
    reduced = pin.buildModelFromMJCF(str(path))
    centre = pin.centerOfMass(reduced, reduced.createData(), np.eye(9)[6])
    in_world = (pose_matrix(pose) @ [*centre, 1.0])[:3]
    np.testing.assert_allclose(in_world, data.subtree_com[0], atol=_EXACT)
    found = differences(path)
    assert len(found) == 10
    assert max(found.values()) < _EXACT, found


def test_readings_that_differ_are_refused(rover):
    lighter = replace(rover, reduced_mjcf=rover.reduced_mjcf.replace('<inertial mass="', '<inertial mass="1', 1))
    with pytest.raises(RobotError, match="pinocchio reads the robot rover differently"):
        RobotKinematics(lighter)


def test_rover_in_both_drives(rover):
    model, data = on_a_floor(rover)
    exact = KinematicDrive(model, data, rover, clearance_of(), prefix="r/")
    actions = [Action.MOVE_FORWARD, Action.TURN_LEFT, Action.MOVE_FORWARD, Action.TURN_RIGHT, Action.MOVE_FORWARD] * 3
    for action in actions:
        exact.act(action)
    model, data = on_a_floor(rover)
    driven = PhysicsDrive(model, data, rover, prefix="r/")
    for action in actions:
        assert not driven.act(action).collided
        assert data.body("r/rover").xmat[8] > 0.999
    assert (driven.pose.x_m, driven.pose.y_m) == pytest.approx((exact.pose.x_m, exact.pose.y_m), abs=0.002)
    assert driven.pose.yaw_rad == pytest.approx(exact.pose.yaw_rad, abs=math.radians(0.2))
    assert (driven.odometry.x_m, driven.odometry.y_m) == pytest.approx((exact.pose.x_m, exact.pose.y_m), abs=0.02)


def test_hinge_direction(rover):
    model, data = on_a_floor(rover)
    drive = PhysicsDrive(model, data, rover, prefix="r/")
    drive.place(Pose2(0.0, 0.0, 0.0))
    result = drive.drive(Twist(0.2, 0.0), 1.0)
    assert result.wheel_speeds.left_radps == pytest.approx(result.wheel_speeds.right_radps, abs=0.05)
    assert result.wheel_speeds.left_radps > 0.0
    expected = move_pose(Pose2(0.0, 0.0, 0.0), result.moved_m, 0.0)
    assert drive.pose.x_m == pytest.approx(expected.x_m, abs=0.005)


@pytest.mark.parametrize(
    ("before", "after", "config", "message"),
    [
        (
            "left_wheel_joint",
            "port_hinge",
            {"right_wheel": "right_wheel_joint", "left_wheel": "port"},
            r"no hinge .port.; its hinges are port_hinge, right_wheel_joint",
        ),
        ('name="left_wheel_joint"', 'name="left_wheel_joint" type="slide"', {}, 'joint "left_wheel_joint" .* no hinge'),
        (
            "left_wheel_joint",
            "left_wheel_joint",
            {"right_wheel": "r"},
            r'no hinge "r"; its hinges are left_wheel_joint',
        ),
        ("<camera", "<site/><!--", {}, "cannot read|no camera"),
        ('name="eye"', 'name="eye"', {"camera": "lens"}, 'no camera "lens"; its cameras are eye'),
        ('xyaxes="1 0 0 0 0 1"', 'xyaxes="-1 0 0 0 0 1"', {}, "does not look forward"),
        ("-0.115 -0.05 -0.05", "-0.115 -0.05 -0.02", {}, "must be alike|share one level axle"),
        ("-0.115 -0.05 -0.05", "-0.115 0.03 -0.05", {}, "share one level axle"),
        ('size="0.04 0.012"', 'size="0.04 0.012" mass="-1"', {}, "cannot be compiled by itself|cannot read"),
        ("<mujoco", "<mjc", {}, "MuJoCo cannot read the robot"),
        ('pos="0.02 0.10 0.11"', 'pos="0.02 5.10 0.11"', {}, "eye of .* is 5.* m away from the base"),
        ('left_wheel_joint" axis', 'left_wheel_joint" range="-90 90" axis', {}, "turns within -90 and 90 degrees only"),
    ],
)
def test_what_a_robot_lacks_is_named(tmp_path, before, after, config, message):
    path = tmp_path / "rover.xml"
    path.write_text(ROVER_XML.read_text().replace(before, after))
    with pytest.raises(RobotError, match=message):
        describe_robot(path, RobotConfig(**config))


def test_wheels_that_hardly_turn_are_refused(tmp_path):
    path, slow = tmp_path / "rover.xml", 'kv="0.2" ctrlrange="-{0} {0}"'
    text = ROVER_XML.read_text().replace("<motor name", "<velocity name")
    path.write_text(text.replace('gear="5"', slow.format(1.0)))
    assert describe_robot(path).max_wheel_radps == pytest.approx(1.0)
    path.write_text(text.replace('gear="5"', slow.format(0.01)))
    with pytest.raises(RobotError, match=r"turn by 0\.01 rad/s at most, which moves the robot by 0\.0004 m/s"):
        describe_robot(path)


def test_unusual_part_names(tmp_path):
    path = tmp_path / "rover.xml"
    text = ROVER_XML.read_text().replace("left_wheel_joint", "port_hinge").replace("right_wheel_joint", "star_hinge")
    path.write_text(text.replace('</body>\n    <body name="ball"', '<camera name="rear"/></body><body name="ball"'))
    robot = describe_robot(path, RobotConfig(left_wheel="port_hinge", right_wheel="star_hinge", camera="eye"))
    assert robot.wheel_joints == ("port_hinge", "star_hinge")


_BASE_JOINTS = '<joint name="x" type="slide" axis="1 0 0"/><joint name="t" axis="0 0 1"/>'


@pytest.mark.parametrize(
    "changes",
    [
        {'name="left_motor" ': "", 'name="right_motor" ': ""},
        {'<motor name="left_motor"': "<velocity", '<motor name="right_motor"': "<velocity", 'gear="5"': 'kv="0.2"'},
        {'body name="port"': "body", 'body name="starboard"': "body", 'body name="rover"': "body"},
        {'name="caster"': 'name="left_wheel_joint_contact"', "left_motor": "right_wheel_joint_motor"},
        {'pos="1 2 0.09">': f'pos="1 2 0.09">{_BASE_JOINTS}', "<actuator>": '<actuator><velocity joint="x"/>'},
        {'<geom class="wheel"/>': '<geom class="wheel" pos="0.02 0 0"/><geom class="wheel" pos="-0.02 0 0"/>'},
    ],
    ids=["motors unnamed", "servos unnamed", "bodies unnamed", "names taken", "base on joints", "wheels of two"],
)
def test_mjcf_variants(tmp_path, changes):
    text = ROVER_XML.read_text()
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / "rover.xml"
    path.write_text(text)
    robot = describe_robot(path)
    model, data = on_a_floor(robot)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(expected := Pose2(0.0, 0.0, 0.0))
    for _ in range(2):
        assert not drive.act(Action.MOVE_FORWARD).collided
        assert not drive.act(Action.TURN_LEFT).collided
        expected = move_pose(move_pose(expected, 0.065, 0.0), 0.0, math.radians(10.0))
    np.testing.assert_allclose(drive.pose.xy_m, expected.xy_m, atol=0.001)
    assert drive.pose.yaw_rad == pytest.approx(expected.yaw_rad, abs=math.radians(0.1))


def test_robot_hash(rover, description, tmp_path):
    path = tmp_path / "rover.xml"
    path.write_text(ROVER_XML.read_text())
    assert describe_robot(path).hash == rover.hash != description.hash
    path.write_text(ROVER_XML.read_text().replace('size="0.08 0.01 0.01"', 'size="0.08 0.01 0.02"'))
    assert describe_robot(path).hash != rover.hash


def test_robot_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert robot_path("diff_drive").name == "diff_drive.xml"
    assert robot_path(str(ROVER_XML)) == ROVER_XML
    with pytest.raises(RobotError, match=r"no robot file nobody, .* a name: diff_drive, stretch3"):
        robot_path("nobody")
