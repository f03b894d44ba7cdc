"""Joint positions of a robot at a key frame of its file.

Many key frames hold targets of position servos (``ctrl``) instead of positions (``qpos``). Their positions follow by
inverse kinematics: every servo reaches its target and all equalities between joints hold.
"""

from pathlib import Path

import mujoco
import numpy as np

from anm_mj.errors import RobotError

USUAL_KEY_FRAMES = ("stow", "stowed", "tucked", "retract", "home")
"""Key frames at which a robot drives, most compact first."""
_ITERATIONS = 30
_CONVERGED = 1e-9


def at_key_frame(model: mujoco.MjModel, wanted: str, path: Path) -> tuple[mujoco.MjData, str]:
    """The state at a key frame, with all poses up to date, and the key frame's name.

    Free joints stay at their reference. Without a wanted key frame, the first usual one of the file counts; without
    that, the reference positions, and the name is empty. Raises RobotError if the file has no key frame of the wanted
    name.
    """
    data = mujoco.MjData(model)
    known = [model.key(k).name for k in range(model.nkey)]
    if wanted and wanted not in known:
        named = ", ".join(name for name in known if name) or "none"
        raise RobotError(
            f'The robot {path} has no key frame "{wanted}"; its key frames are {named}: name one by --set '
            "model.keyframe=NAME, or leave it out."
        )
    name = wanted or next((name for name in USUAL_KEY_FRAMES if name in known), "")
    if name:
        key = known.index(name)
        qpos = model.key_qpos[key].copy()
        for start in model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
            qpos[start : start + 7] = model.qpos0[start : start + 7]
        data.qpos[:] = qpos
        if np.array_equal(qpos, model.qpos0) and model.key_ctrl[key].any():
            _reach_targets(model, data, model.key_ctrl[key])
    mujoco.mj_forward(model, data)
    return data, name


def _reach_targets(model: mujoco.MjModel, data: mujoco.MjData, ctrl: np.ndarray) -> None:
    """Move the joints to where the position servos hold them: Gauss-Newton of least norm, limits respected."""
    servos = [
        a
        for a in range(model.nu)
        if model.actuator_biasprm[a, 1] < 0.0 and model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
    ]
    targets = -ctrl[servos] * model.actuator_gainprm[servos, 0] / model.actuator_biasprm[servos, 1]
    single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)  # Slides and hinges.
    moment, limited = np.zeros((model.nu, model.nv)), np.flatnonzero(single & (model.jnt_limited != 0))
    for _ in range(_ITERATIONS):
        mujoco.mj_forward(model, data)
        mujoco.mju_sparse2dense(
            moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        equal = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        rows = np.zeros((data.nefc, model.nv))
        if mujoco.mj_isSparse(model) and data.nefc:
            mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        elif data.nefc:
            rows = data.efc_J.reshape(data.nefc, model.nv)
        jacobian = np.concatenate([moment[servos], rows[equal]])
        missing = np.concatenate([targets - data.actuator_length[servos], -data.efc_pos[equal]])
        for start in model.jnt_dofadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
            jacobian[:, start : start + 6] = 0.0
        step = np.linalg.lstsq(jacobian, missing, rcond=1e-6)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        for joint in limited:
            at = model.jnt_qposadr[joint]
            data.qpos[at] = np.clip(data.qpos[at], *model.jnt_range[joint])
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            break
