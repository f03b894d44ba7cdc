"""pinocchio's reading of the robot against MuJoCo's reading of the same file."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj.frames import T_GL_CV, pose_matrix
from anm_mj.robot.reduced_model import WHEEL_JOINTS
from anm_mj.types import Pose2, WheelSpeeds
from tests.robots import ROBOT_XML

_EXACT = 1e-10
_POSES = [Pose2(0.0, 0.0, 0.0), Pose2(1.5, -2.0, 2.5), Pose2(-3.0, 0.4, -1.1)]


def differences(path: Path) -> dict[str, float]:
    """How far the two libraries' readings of a robot are apart: what is there, how heavy it is and where it stands."""
    robot, model = pin.buildModelFromMJCF(str(path)), mujoco.MjModel.from_xml_path(str(path))
    data, robot_data = mujoco.MjData(model), robot.createData()
    if (robot.nq, robot.nv) != (model.nq, model.nv):
        return {"number of joints": math.inf}

    rng = np.random.default_rng(3)
    q, v = rng.normal(size=model.nq), rng.normal(size=model.nv)
    q[3:7] /= np.linalg.norm(q[3:7])
    data.qpos, data.qvel = q, v
    mujoco.mj_forward(model, data)
    # MuJoCo: quaternion wxyz and linear velocity in the world; pinocchio: xyzw and in the base.
    q_pin = np.concatenate([q[:3], q[4:7], q[3:4], q[7:]])
    v_pin = np.concatenate([data.body("base").xmat.reshape(3, 3).T @ v[:3], v[3:]])
    pin.forwardKinematics(robot, robot_data, q_pin, v_pin)
    pin.updateFramePlacements(robot, robot_data)

    found = {
        "mass": abs(pin.computeTotalMass(robot) - model.body_subtreemass[0]),
        "centre of mass": np.abs(pin.centerOfMass(robot, robot_data, q_pin) - data.subtree_com[0]).max(),
    }
    mujoco.mj_energyVel(model, data)
    # Kinetic energy at a random velocity involves every inertia.
    found["kinetic energy"] = abs(pin.computeKineticEnergy(robot, robot_data, q_pin, v_pin) - data.energy[1])
    for i in range(model.nsite):
        site = data.site(i)
        frame = robot_data.oMf[robot.getFrameId(site.name, pin.FrameType.OP_FRAME)]
        found[f"site {site.name}"] = np.abs(frame.homogeneous[:3] - np.c_[site.xmat.reshape(3, 3), site.xpos]).max()
    for name in WHEEL_JOINTS:
        wheel = robot_data.oMi[robot.getJointId(name)]
        found[f"joint {name}"] = np.abs(wheel.translation - data.joint(name).xanchor).max()
        found[f"axis {name}"] = np.abs(wheel.rotation[:, 1] - data.joint(name).xaxis).max()
    return found


def test_pinocchio_matches_mujoco():
    found = differences(ROBOT_XML)
    assert len(found) == 10
    assert max(found.values()) < _EXACT, found


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # pinocchio ignores what stands in a <frame> and masses in defaults.
        ('<geom name="head"', '<frame><geom name="extra" type="sphere" size="0.1" mass="1"/></frame><geom name="head"'),
        ('pos="0.13 0 0.02" mass="0.05"', 'pos="0.13 0 0.02"'),
    ],
)
def test_different_readings_are_noticed(tmp_path, before, after):
    text = ROBOT_XML.read_text()
    assert before in text
    if "frame" not in after:
        text = text.replace('<geom type="sphere" size="0.02"', '<geom type="sphere" size="0.02" mass="0.05"')
    path = tmp_path / "robot.xml"
    path.write_text(text.replace(before, after))
    assert max(differences(path).values()) > 1e-3


@pytest.mark.parametrize("pose", _POSES)
def test_camera_pose(kinematics, pose):
    model = mujoco.MjModel.from_xml_path(str(ROBOT_XML))
    data = mujoco.MjData(model)
    data.qpos[:7] = [pose.x_m, pose.y_m, 0, math.cos(pose.yaw_rad / 2), 0, 0, math.sin(pose.yaw_rad / 2)]
    mujoco.mj_forward(model, data)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = data.cam("camera").xmat.reshape(3, 3)
    T_world_camera[:3, 3] = data.cam("camera").xpos
    np.testing.assert_allclose(kinematics.T_world_camera(pose), T_world_camera @ T_GL_CV, atol=_EXACT)
    np.testing.assert_allclose(pose_matrix(pose) @ kinematics.T_base_camera, T_world_camera @ T_GL_CV, atol=_EXACT)


def test_wheel_geometry(kinematics):
    model = mujoco.MjModel.from_xml_path(str(ROBOT_XML))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for name in WHEEL_JOINTS:
        assert model.geom(name).size[0] == kinematics.wheel_radius_m
    left, right = (data.geom(name).xpos for name in WHEEL_JOINTS)
    assert left[1] - right[1] == pytest.approx(kinematics.track_m, abs=_EXACT)


@given(left=st.floats(-20, 20), right=st.floats(-20, 20))
def test_wheel_and_body_motion_are_inverse(kinematics, left, right):
    assert kinematics.wheel_motion(*kinematics.body_motion(left, right)) == pytest.approx((left, right), abs=1e-9)
    by_jacobian = kinematics.wheel_jacobian @ np.array([left, right])
    assert kinematics.body_motion(left, right) == pytest.approx(tuple(by_jacobian), abs=1e-12)


def test_wheel_speeds(kinematics):
    assert kinematics.wheel_speeds(0.5, 0.0) == WheelSpeeds(10.0, 10.0)
    left, right = kinematics.wheel_motion(0.0, 1.0)
    assert (left, right) == pytest.approx((-3.0, 3.0))


@given(left=st.floats(-6, 6), right=st.floats(-6, 6), yaw=st.floats(-3.1, 3.1))
def test_odometry_is_the_se2_exponential(kinematics, left, right, yaw):
    forward_m, turn_rad = kinematics.body_motion(left, right)
    group = pin.liegroups.SE2()
    start = np.array([0.4, -0.7, math.cos(yaw), math.sin(yaw)])
    x, y, c, s = group.integrate(start, np.array([forward_m, 0.0, turn_rad]))
    pose = kinematics.odometry(Pose2(0.4, -0.7, yaw), left, right)
    assert (pose.x_m, pose.y_m) == pytest.approx((x, y), abs=1e-12)
    assert (math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)) == pytest.approx((c, s), abs=1e-12)
