"""Velocity servos on a robot's wheels: those of its file where they are strong enough, else ours."""

import mujoco
import numpy as np

from anm_mj.robot.compiled_robot import unused_name

_KV_PER_INERTIA = 2.0 / (9.6 * 0.05**2)
"""Gain of a motor per mass times squared wheel radius [1/s], scaled from the servos of ``models/diff_drive``."""
_FORCE_PER_KV = 4.0
_DAMPING_PER_KV = 0.02
"""Highest damping of a wheel's joint over the gain of its servo; more would slow the wheel down noticeably."""
_WEAK = 0.25
"""A servo of the file with less than this share of that gain is replaced."""
_STICKY_RADPS = 0.1
"""A servo that needs a larger speed error to overcome its joint's friction is replaced [rad/s]."""


def fit_servos(
    spec: mujoco.MjSpec, model: mujoco.MjModel, wheels: tuple[str, ...], radius_m: float
) -> tuple[tuple[str, ...], float, list[str]]:
    """Give every wheel (named by its hinge; radius [m]) one velocity servo [rad/s]; the spec is changed in place.

    Returns:
        Names of the servos; the highest speed that the file allows [rad/s], infinite without a limit; what was changed.
    """
    # Both wheels of a base move its mass and their own armatures.
    armature = sum(float(model.dof_armature[model.joint(wheel).dofadr[0]]) for wheel in wheels)
    kv = _KV_PER_INERTIA * (float(model.body_subtreemass[0]) * radius_m**2 + armature) * 2.0 / len(wheels)
    names, top_radps, replaced = [], np.inf, []
    for wheel in wheels:
        on_wheel = [actuator for actuator in spec.actuators if actuator.target == wheel]
        servo = next((a for a in on_wheel if _is_fit(model, a.name, wheel, kv)), None)
        for actuator in on_wheel:
            top_radps = min(top_radps, _top_speed(model, actuator.name))
            if actuator is not servo:
                replaced.append(actuator.name)
                spec.delete(actuator)
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
    notes = [f"motors replaced by velocity servos: {', '.join(replaced)}"] if replaced else []
    return tuple(names), top_radps, notes


def make_velocity_servo(servo: "mujoco._specs.MjsActuator", kv: float, top_force: float) -> None:
    """Make an actuator added to a joint a velocity servo, whatever the file's defaults for actuators say.

    ``kv`` is its gain [N s/m or N m s/rad], ``top_force`` the largest force or torque that it exerts [N or N m].
    """
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    servo.dyntype, servo.actlimited = mujoco.mjtDyn.mjDYN_NONE, False
    servo.gainprm[:], servo.biasprm[:], servo.gear[:] = 0.0, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    servo.gainprm[0], servo.biasprm[2] = kv, -kv
    servo.ctrllimited = False
    servo.forcelimited, servo.forcerange = True, [-top_force, top_force]


def _is_fit(model: mujoco.MjModel, actuator: str, wheel: str, kv: float) -> bool:
    """Whether an actuator is a velocity servo in the joint's own unit that is strong enough."""
    index = model.actuator(actuator).id
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index].tolist()
    plain = model.actuator_gear[index, 0] == 1.0 and model.actuator_dyntype[index] == mujoco.mjtDyn.mjDYN_NONE
    is_servo = bool(plain) and gain > 0.0 and bias[1] == 0.0 and bias[2] == -gain
    sticky = float(model.dof_frictionloss[model.joint(wheel).dofadr[0]]) > _STICKY_RADPS * gain
    return is_servo and gain >= _WEAK * kv and not sticky


def _top_speed(model: mujoco.MjModel, actuator: str) -> float:
    """Highest speed of the joint that a velocity servo accepts [rad/s]; infinite without a limit."""
    index = model.actuator(actuator).id
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index]
    if not model.actuator_ctrllimited[index] or bias[1] != 0.0 or bias[2] >= 0.0 or gain <= 0.0:
        return np.inf
    low, high = model.actuator_ctrlrange[index] * gain / -bias[2] / max(abs(model.actuator_gear[index, 0]), 1e-9)
    return float(min(-low, high)) if low < 0.0 < high else np.inf
