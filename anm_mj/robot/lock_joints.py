"""Locks joints of a robot's spec at given positions, and removes everything that refers to them."""

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.frames import rigid_transform
from anm_mj.mjcf.poses import body_pose, set_pose
from anm_mj.robot.body_tree import joints_above


def lock_joints(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, keep: set[str], root: str
) -> list[str]:
    """Weld all bodies of a robot to their parents where they are, but for the joints in ``keep``; names of the others.

    Joints of ``root``, its top-level body, stay as well. Actuators and sensors of the locked joints disappear, with all
    tendons and equalities, which would hold the wheels; gravity acts on all bodies again. All joints of the spec, which
    is changed in place, are named.
    """
    root_id = model.body(root).id
    locked = [
        j
        for j in range(model.njnt)
        if model.body_rootid[model.jnt_bodyid[j]] == root_id
        and model.jnt_bodyid[j] != root_id
        and model.joint(j).name not in keep
    ]
    if not locked:
        _uncouple(spec)
        return []
    names = [model.joint(j).name for j in locked]
    for body_id in sorted({int(model.jnt_bodyid[j]) for j in locked}):
        parent = int(model.body_parentid[body_id])
        body = spec.body(model.body(body_id).name)
        pose = np.linalg.inv(body_pose(data, parent)) @ body_pose(data, body_id)
        set_pose(body, np.linalg.inv(_frame_pose(spec, body.frame)) @ pose)
    for element in [*spec.sensors, *spec.keys]:
        spec.delete(element)
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for actuator in [a for a in spec.actuators if a.trntype not in kinds or a.target in names]:
        spec.delete(actuator)
    _uncouple(spec)
    for name in names:
        spec.delete(spec.joint(name))
    return names


def _uncouple(spec: mujoco.MjSpec) -> None:
    """Remove what couples the wheels to each other or carries the robot: equalities, tendons, gravity compensation."""
    tendons = list(spec.tendons)
    if tendons:
        of_tendons = [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_TENDON]
        for element in [*of_tendons, *[s for s in spec.sensors if s.objtype == mujoco.mjtObj.mjOBJ_TENDON]]:
            spec.delete(element)
    # What bends hangs on equalities, and belongs to no body that drives.
    for element in [*spec.equalities, *tendons, *spec.flexes, *spec.skins]:
        spec.delete(element)
    for body in spec.bodies:
        body.gravcomp = 0.0


def hangs_on_joint(model: mujoco.MjModel, body: int, kept: set[str]) -> bool:
    """Whether one of the kept joints lies between a body and the world, the root's own not counted."""
    return any(
        model.joint(j).name in kept and model.jnt_bodyid[j] != model.body_rootid[body]
        for j in joints_above(model, body)
    )


def _frame_pose(spec: mujoco.MjSpec, frame: "mujoco._specs.MjsFrame | None") -> Float[np.ndarray, "4 4"]:
    pose = np.eye(4)
    while frame is not None:
        quat = np.array(frame.quat)
        if frame.alt.type != mujoco.mjtOrientation.mjORIENTATION_QUAT:
            compiler = spec.compiler
            quat = np.array(
                spec.resolve_orientation(degree=compiler.degree, sequence=compiler.eulerseq, orientation=frame.alt)
            )
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, quat / np.linalg.norm(quat))
        pose = rigid_transform(rotation, np.array(frame.pos)) @ pose
        frame = frame.frame
    return pose
