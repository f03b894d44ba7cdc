"""A base that moves by planar joints: its frame, and the joints and servos that replace those of the file."""

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.mjcf.poses import set_pose
from anm_mj.robot.compiled_robot import height_range_m, solid_geoms, unused_name
from anm_mj.robot.isolate import remove_joints
from anm_mj.robot.reduced_model import PLANAR_JOINTS
from anm_mj.robot.servos import make_velocity_servo

_SINKS_M = 0.005
_GAP_M = 0.15
"""Highest gap between the floor and a body without wheels [m]."""
_SERVO_HZ = 40.0
"""Gain of a planar servo per mass [1/s]."""


def planar_base_frame(
    model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, ...], ahead: Float[np.ndarray, "3"] | None
) -> Float[np.ndarray, "4 4"]:
    """``T_world_base``: on the floor below the upright hinge, x along the first slide, or to where the camera looks.

    The camera counts where it looks more than 30 degrees aside of the slide: such a base drives in any direction.
    """
    ids = [model.joint(name).id for name in joints]
    hinge = next(j for j in ids if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE)
    slide = next(j for j in ids if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE)
    forward = np.array([*data.xaxis[slide][:2], 0.0])
    forward /= np.linalg.norm(forward)
    if ahead is not None and ahead @ forward < np.cos(np.radians(30.0)):
        forward = ahead
    geoms = [g for g in solid_geoms(model) if model.geom_bodyid[g]] or list(range(model.ngeom))
    T_world_base = np.eye(4)
    T_world_base[:3, 0] = forward
    T_world_base[:3, 1] = np.cross([0.0, 0.0, 1.0], forward)
    T_world_base[:2, 3] = data.xanchor[hinge][:2]
    lowest_m = min(height_range_m(model, data, g)[0] for g in geoms)
    # Such files draw the floor at z = 0 and leave a gap below the body, which nothing else tells.
    T_world_base[2, 3] = 0.0 if -_SINKS_M <= lowest_m <= _GAP_M else lowest_m
    return T_world_base


def give_planar_joints(
    spec: mujoco.MjSpec, root: str, T_root_base: Float[np.ndarray, "4 4"], mass_kg: float, radius_m: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Replace the root's joints by two slides and a hinge whose positions are the pose of the base, with servos.
    Returns the names of the joints, and of their velocity servos [m/s, m/s, rad/s].
    """
    body = spec.body(root)
    remove_joints(spec, {joint.name for joint in body.joints})
    set_pose(body, np.linalg.inv(T_root_base))
    joints, servos = [], []
    for column, wanted in enumerate(PLANAR_JOINTS):
        turns = column == 2
        joint = body.add_joint(
            name=unused_name(wanted, spec.joint),
            type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=T_root_base[:3, column],
            pos=T_root_base[:3, 3],
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            # Not those of the file's defaults.
            damping=np.zeros(3),
            stiffness=np.zeros(3),
            frictionloss=0.0,
            armature=0.0,
        )
        servo = spec.add_actuator(
            name=unused_name(f"{wanted}_servo", spec.actuator), target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        kv = _SERVO_HZ * mass_kg * (radius_m**2 if turns else 1.0)
        # Enough to accelerate within the limits of motion; a robot that is held fast pushes no harder.
        top = mass_kg * (6.0 * radius_m**2 * 4.0 if turns else 6.0)
        make_velocity_servo(servo, kv, top)
        joints.append(joint.name)
        servos.append(servo.name)
    return tuple(joints), tuple(servos)
