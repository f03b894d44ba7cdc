"""What moves a base in simulation: velocity servos on its wheels, or planar joints with servos, in place of its file's.

Servos of the file stay where they are strong enough.
"""

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.mjcf.poses import set_pose
from anm_mj.robot.compiled_robot import lowest_m, solid_geoms, unused_name
from anm_mj.robot.isolate import remove_actuators, remove_joints
from anm_mj.robot.reduced_model import PLANAR_JOINTS
from anm_mj.robot.wheels import least_armature

SUBSTEP_S = 0.002
"""Physics step that servos are made for [s]. From 0.004 on the wheel contacts lose accuracy, at 0.010 the wheels slip.
"""

_KV_PER_INERTIA = 2.0 / (9.6 * 0.05**2)
"""Gain of a motor per mass times squared wheel radius [1/s], scaled from the servos of ``models/diff_drive``."""
_FORCE_PER_KV = 4.0
_DAMPING_PER_KV = 0.02
"""Highest damping of a wheel's joint over the gain of its servo; more would slow the wheel down noticeably."""
_WEAK = 0.25
"""A servo of the file with less than this share of that gain is replaced."""
_STIFF = 5.0
"""A servo of the file is replaced, too, if its gain times the drive's time step is more inertias of the wheel than
this: its velocity would overshoot from step to step. Robots of two masses drove at 4.4 and toppled at 6.8."""
_STICKY_RADPS = 0.1
"""A servo that needs a larger speed error to overcome its joint's friction is replaced [rad/s]."""
_SINKS_M = 0.005
_GAP_M = 0.15
"""Highest gap between the floor and a body without wheels [m]."""
_SERVO_HZ = 40.0
"""Gain of a planar servo per mass [1/s]."""


def fit_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    wheels: tuple[str, ...],
    radius_m: float,
    most_radps: Mapping[str, float],
) -> tuple[tuple[str, ...], float, list[str]]:
    """Give every wheel (named by its hinge; radius [m]) one velocity servo [rad/s]; the spec is changed in place.
    ``most_radps`` are the highest speeds that the file states for hinges beside those of its servos, by name [rad/s].

    Returns:
        Names of the servos; the highest speed that the file allows [rad/s], infinite without a limit; what was changed.
    """
    # Both wheels of a base move its mass and their own armatures.
    armature = sum(float(model.dof_armature[model.joint(wheel).dofadr[0]]) for wheel in wheels)
    kv = _KV_PER_INERTIA * (float(model.body_subtreemass[0]) * radius_m**2 + armature) * 2.0 / len(wheels)
    least = least_armature(model, radius_m)
    names, replaced = [], []
    top_radps = min((most_radps[wheel] for wheel in wheels if wheel in most_radps), default=np.inf)
    for wheel in wheels:
        on_wheel = [actuator for actuator in spec.actuators if actuator.target == wheel]
        servo = next((a for a in on_wheel if _is_fit(model, a.name, wheel, kv, least)), None)
        for actuator in on_wheel:
            top_radps = min(top_radps, _top_speed(model, actuator.name))
        others = [actuator for actuator in on_wheel if actuator is not servo]
        replaced += [actuator.name for actuator in others]
        remove_actuators(spec, others)
        if servo is None:
            name = unused_name(f"{wheel}_motor", spec.actuator)
            servo = spec.add_actuator(name=name, target=wheel, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            make_velocity_servo(servo, kv, _FORCE_PER_KV * kv)
            joint = spec.joint(wheel)
            # Friction and springs in the wheel's joint belong to the motor that was there.
            joint.frictionloss = 0.0
            joint.stiffness = np.zeros(3)
            damping = float(model.dof_damping[model.joint(wheel).dofadr[0]])
            joint.damping = [min(damping, _DAMPING_PER_KV * kv), 0.0, 0.0]
        names.append(servo.name)
    what = f"actuators of the wheels replaced by velocity servos with kv = {kv:.3g}"
    notes = [f"{what}: {', '.join(replaced)}"] if replaced else []
    return tuple(names), top_radps, notes


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
    lowest = lowest_m(model, data, geoms)
    # Such files draw the floor at z = 0 and leave a gap below the body, which nothing else tells.
    T_world_base[2, 3] = 0.0 if -_SINKS_M <= lowest <= _GAP_M else lowest
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


def make_velocity_servo(servo: "mujoco._specs.MjsActuator", kv: float, top_force: float) -> None:
    """Make an actuator added to a joint a velocity servo, whatever the file's defaults for actuators say. ``kv`` is its
    gain [N s/m or N m s/rad], ``top_force`` the largest force or torque that it exerts [N or N m].
    """
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.dyntype, servo.actlimited = mujoco.mjtDyn.mjDYN_NONE, False
    servo.gainprm[:], servo.biasprm[:], servo.gear[:] = 0.0, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    servo.gainprm[0], servo.biasprm[2] = kv, -kv
    servo.ctrllimited = False
    servo.forcelimited, servo.forcerange = True, [-top_force, top_force]


def _is_fit(model: mujoco.MjModel, actuator: str, wheel: str, kv: float, least_armature: float) -> bool:
    """Whether an actuator is a velocity servo in the joint's own unit for both directions, strong enough, with no
    spring against it, and not too stiff for the drive's time step where the joint gets ``least_armature`` [kg m^2].
    """
    index = model.actuator(actuator).id
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index].tolist()
    plain = model.actuator_gear[index, 0] == 1.0 and model.actuator_dyntype[index] == mujoco.mjtDyn.mjDYN_NONE
    is_servo = bool(plain) and gain > 0.0 and bias[1] == 0.0 and bias[2] == -gain
    low, high = model.actuator_ctrlrange[index]
    is_one_way = bool(model.actuator_ctrllimited[index]) and not low < 0.0 < high
    dof = model.joint(wheel).dofadr[0]
    has_spring = float(model.jnt_stiffness[model.joint(wheel).id]) > 0.0
    is_sticky = float(model.dof_frictionloss[dof]) > _STICKY_RADPS * gain
    armature = max(float(model.dof_armature[dof]), least_armature)
    inertia = float(model.dof_M0[dof] - model.dof_armature[dof]) + armature
    is_stiff = gain * SUBSTEP_S > _STIFF * inertia
    return is_servo and gain >= _WEAK * kv and not (is_one_way or has_spring or is_sticky or is_stiff)


def _top_speed(model: mujoco.MjModel, actuator: str) -> float:
    """Highest speed of the joint that a velocity servo accepts [rad/s]; infinite without a limit."""
    index = model.actuator(actuator).id
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index]
    if not model.actuator_ctrllimited[index] or bias[1] != 0.0 or bias[2] >= 0.0 or gain <= 0.0:
        return np.inf
    low, high = model.actuator_ctrlrange[index] * gain / -bias[2] / max(abs(model.actuator_gear[index, 0]), 1e-9)
    return float(min((speed for speed in (-low, high) if speed > 0.0), default=np.inf))
