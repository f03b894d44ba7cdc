"""What the bodies of a world are: their names, which are robots, which move and how."""

import mujoco
import numpy as np
from jaxtyping import Bool, Int

from anm_mj.scene.importing.readers.parsed_scene import Joint

_BUILDING_M = 3.0
"""A fixed base larger than this is a building, not the base of a robot in it [m]."""


def part_names(model: mujoco.MjModel) -> list[str]:
    """The path of every body from the world, which is "", such as "kitchen/fridge/door"."""
    names = [""]
    for body in range(1, model.nbody):
        own = model.body(body).name.replace("/", "_") or f"body{body}"
        above = names[int(model.body_parentid[body])]
        names.append(f"{above}/{own}" if above else own)
    return names


def robot_bodies(model: mujoco.MjModel, data: mujoco.MjData) -> Bool[np.ndarray, " b"]:
    """Bodies of robots: mechanisms that at least two actuators drive, with the base that they stand on.

    A single actuator drives a door or a fan, which belongs to the building.
    """
    driven = np.zeros(model.nbody, dtype=np.int64)
    for actuator in range(model.nu):
        for body in _driven_bodies(model, actuator):
            driven[body] += 1
    # Of the whole mechanism: from the topmost body that can move.
    top = _topmost_movers(model)
    number = np.zeros(model.nbody, dtype=np.int64)
    np.add.at(number, top, driven)
    # The parts of a robot on a fixed base may move side by side.
    root = np.asarray(model.body_rootid)
    by_root = np.zeros(model.nbody, dtype=np.int64)
    np.add.at(by_root, root, driven)
    by_root[0] = 0
    driven_bases = [
        base for base in np.flatnonzero(by_root >= 2).tolist() if _fixed_extent_m(model, data, base, top) < _BUILDING_M
    ]
    is_robot = (number[top] >= 2) | np.isin(root, driven_bases)
    is_robot[0] = False
    return is_robot


def _driven_bodies(model: mujoco.MjModel, actuator: int) -> set[int]:
    kinds, target = mujoco.mjtTrn, int(model.actuator_trnid[actuator, 0])
    kind = int(model.actuator_trntype[actuator])
    if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
        return {int(model.jnt_bodyid[target])}
    if kind == kinds.mjTRN_TENDON:
        first, num = int(model.tendon_adr[target]), int(model.tendon_num[target])
        wraps = range(first, first + num)
        joints = [int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == mujoco.mjtWrap.mjWRAP_JOINT]
        sites = [int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == mujoco.mjtWrap.mjWRAP_SITE]
        return {int(model.jnt_bodyid[j]) for j in joints} | {int(model.site_bodyid[s]) for s in sites}
    if kind in (kinds.mjTRN_SITE, kinds.mjTRN_SLIDERCRANK):
        return {int(model.site_bodyid[target])}
    return {target} if kind == kinds.mjTRN_BODY else set()


def _topmost_movers(model: mujoco.MjModel) -> Int[np.ndarray, " b"]:
    """For every body the topmost body above it, or it itself, that has a joint; 0 without one."""
    top = np.zeros(model.nbody, dtype=np.int64)
    for body in range(1, model.nbody):
        above = top[int(model.body_parentid[body])]
        top[body] = above or (body if model.body_jntnum[body] else 0)
    return top


def _fixed_extent_m(model: mujoco.MjModel, data: mujoco.MjData, root: int, top: Int[np.ndarray, " b"]) -> float:
    """Largest extent of what stands fixed below a body of the world, without planes [m]."""
    body = np.asarray(model.geom_bodyid)
    fixed = (top[body] == 0) & (model.body_rootid[body] == root) & (model.geom_rbound > 0.0)
    if not fixed.any():
        return 0.0
    centre, reach = data.geom_xpos[fixed], model.geom_rbound[fixed, None]
    return float(((centre + reach).max(axis=0) - (centre - reach).min(axis=0)).max())


def joints_of(model: mujoco.MjModel, data: mujoco.MjData, names: list[str]) -> dict[str, Joint]:
    """The hinge or slide of every body that has exactly one joint, by the name of its part."""
    found, kinds = {}, mujoco.mjtJoint
    for body in np.flatnonzero(model.body_jntnum == 1).tolist():
        joint = int(model.body_jntadr[body])
        kind = int(model.jnt_type[joint])
        if kind in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
            low, high = (float(value) for value in model.jnt_range[joint])
            found[names[body]] = Joint(
                hinge=bool(kind == kinds.mjJNT_HINGE),
                axis=data.xaxis[joint].copy(),
                anchor_m=data.xanchor[joint].copy(),
                value=float(data.qpos[model.jnt_qposadr[joint]]),
                limits=(low, high) if model.jnt_limited[joint] else None,
            )
    return found
