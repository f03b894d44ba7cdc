"""Drives a robot over an empty floor to see whether it stands, rolls and turns; and its file in plain MuJoCo."""

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco

from anm_mj.frames import wrap_angle
from anm_mj.mjcf.read_mjcf import TIMESTEPS_S, quiet_mujoco
from anm_mj.robot.compiled_robot import height_range_m
from anm_mj.robot.description import RobotDescription
from anm_mj.sim.drives.physics_drive import UNSTABLE, PhysicsDrive
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Action, Pose2, StopReason

_START = Pose2(0.0, 0.0, 0.0)
_FORWARD, _TURNS = 8, 9
_PLAIN_S = 2.0
_FALLEN = math.cos(math.radians(30.0))
_FAST_MPS = 5.0
_FLOOR = '<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>'


@dataclass(frozen=True)
class DriveTrial:
    """What a robot did on an empty floor in the physics drive."""

    moved_m: float
    """Forward, of ``asked_m``."""
    asked_m: float
    turned_rad: float
    """To the left, of ``asked_rad``; counted over the turns alone."""
    asked_rad: float
    turn_by_wheels_rad: float
    """The same turns as its wheels measured them."""
    fault: StopReason | None
    """Why it could drive no more; None = it could."""


def drive_over_a_floor(robot: RobotDescription) -> DriveTrial:
    """Drive 8 steps forward and 9 turns to the left in the physics drive; takes about a second. Raises RobotError if
    the robot cannot be put on a floor.
    """
    spec = mujoco.MjSpec.from_string(_FLOOR)
    spec.attach(robot.spec.copy(), prefix="robot/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    data = mujoco.MjData(model)
    drive = PhysicsDrive(model, data, robot, prefix="robot/")
    drive.place(_START)
    fault = None
    for action in [Action.MOVE_FORWARD] * _FORWARD:
        fault = fault or drive.act(action).fault
    ahead, turned_rad, by_wheels_rad = drive.pose, 0.0, 0.0
    for action in [Action.TURN_LEFT] * _TURNS:
        yaw, measured = drive.pose.yaw_rad, drive.odometry.yaw_rad
        fault = fault or drive.act(action).fault
        turned_rad += wrap_angle(drive.pose.yaw_rad - yaw)
        by_wheels_rad += wrap_angle(drive.odometry.yaw_rad - measured)
    return DriveTrial(ahead.x_m, FORWARD_STEP_M * _FORWARD, turned_rad, TURN_STEP_RAD * _TURNS, by_wheels_rad, fault)


def plain_fault(path: Path, root: str) -> str:
    """What goes wrong when plain MuJoCo simulates a robot's file for two seconds without commands; empty = nothing.

    The file compiles; a floor is added where it has none. ``root`` names the robot's top-level body, or is empty where
    the file leaves it unnamed.
    """
    with quiet_mujoco():
        return _simulated_fault(mujoco.MjSpec.from_file(str(path)), root)


def _simulated_fault(spec: mujoco.MjSpec, root: str) -> str:
    shortest_s, longest_s = TIMESTEPS_S
    if not shortest_s <= spec.option.timestep <= longest_s:
        return (
            f"its time step of {spec.option.timestep:g} s is none for plain MuJoCo, which was not tried: give one from "
            f"{shortest_s:g} to {longest_s:g} s by <option timestep=.../>"
        )
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
        lowest_m = min((height_range_m(model, data, g)[0] for g in solid), default=0.0)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], pos=[0.0, 0.0, lowest_m])
    model = spec.compile()
    data = mujoco.MjData(model)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, root) if root else -1
    mujoco.mj_forward(model, data)
    up = data.xmat[body].reshape(3, 3)[2].copy() if body > 0 else None
    while data.time < _PLAIN_S:
        mujoco.mj_step(model, data)
        if any(data.warning[kind].number for kind in UNSTABLE):
            return (
                f"in plain MuJoCo its simulation diverges after {data.time:.2f} s: look for bodies with hardly any "
                "mass, stiff servos, or a time step that is too long"
            )
        if body > 0 and abs(data.cvel[body][3:]).max() > _FAST_MPS:
            return (
                f"in plain MuJoCo it is thrown off after {data.time:.2f} s: look for geoms that overlap, such as "
                "wheels inside the body or the floor"
            )
    if up is not None and data.xmat[body].reshape(3, 3)[2] @ up < _FALLEN:
        return "in plain MuJoCo it falls over within 2 s: look for a missing caster, or a centre of mass too far out"
    return ""
