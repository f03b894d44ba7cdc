"""What the bodies of a world are: their names, which are robots, which move and how, which the robot may push."""

import mujoco
import numpy as np
from jaxtyping import Bool, Float64, Int

from anm_mj.frames import rigid_transform
from anm_mj.scene.importing.readers.parsed_scene import Joint
from anm_mj.scene.movable import Movable, Solid

_BUILDING_M = 3.0
"""A fixed base larger than this is a building, not the base of a robot in it [m]."""
_LEAF_M = 1.5
"""What moves on one joint and is larger than this is the leaf of a door or a gate, not a part of a robot [m]."""


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

    A single actuator drives a door or a fan, which belongs to the building, and two drive the two leaves of a door.
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
    # A handle or a latch on a leaf may move, too, but nothing drives it.
    leaves = [
        body
        for body in np.flatnonzero((model.body_jntnum == 1) & (top == np.arange(model.nbody))).tolist()
        if body and number[body] <= 1 and _extent_m(model, data, top == body) > _LEAF_M
    ]
    by_root = np.bincount(root, np.where(np.isin(top, leaves), 0, driven), model.nbody)
    by_root[0] = 0
    driven_bases = [
        base
        for base in np.flatnonzero(by_root >= 2).tolist()
        if _extent_m(model, data, (top == 0) & (root == base)) < _BUILDING_M
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


def _extent_m(model: mujoco.MjModel, data: mujoco.MjData, bodies: Bool[np.ndarray, " b"]) -> float:
    """Largest extent of some bodies, without planes [m]."""
    geoms = bodies[model.geom_bodyid] & (model.geom_rbound > 0.0)
    if not geoms.any():
        return 0.0
    centre, reach = data.geom_xpos[geoms], model.geom_rbound[geoms, None]
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


def free_bodies(model: mujoco.MjModel) -> list[int]:
    """Bodies with a free joint."""
    return model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE].tolist()


def movable_of(model: mujoco.MjModel, data: mujoco.MjData, body: int, part: str) -> Movable:
    """A free body with all that hangs on it, whose own joints are locked as they stand."""
    members = np.flatnonzero(model.body_rootid == model.body_rootid[body])
    members = members[members >= body]
    T = rigid_transform(data.xmat[body], data.xpos[body])
    inverse = np.linalg.inv(T)
    mass = float(model.body_mass[members].sum())
    centre, inertia = data.xpos[body], np.zeros((3, 3))
    if mass > 0.0:
        centre = np.average(data.xipos[members], axis=0, weights=model.body_mass[members])
    for member in members.tolist():
        axes = data.ximat[member].reshape(3, 3)
        offset = data.xipos[member] - centre
        inertia += axes @ np.diag(model.body_inertia[member]) @ axes.T
        inertia += float(model.body_mass[member]) * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    local = T[:3, :3].T @ inertia @ T[:3, :3]
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, members)).tolist()
    solids = (_solid(model, data, geom, inverse) for geom in geoms)
    local_centre = inverse[:3, :3] @ centre + inverse[:3, 3]
    return Movable(part, T, mass, local_centre, local, tuple(solid for solid in solids if solid is not None))


def _solid(model: mujoco.MjModel, data: mujoco.MjData, geom: int, inverse: Float64[np.ndarray, "4 4"]) -> Solid | None:
    kinds = mujoco.mjtGeom
    words = {
        int(kinds.mjGEOM_SPHERE): ("sphere", 1),
        int(kinds.mjGEOM_CAPSULE): ("capsule", 2),
        int(kinds.mjGEOM_CYLINDER): ("cylinder", 2),
        int(kinds.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
        int(kinds.mjGEOM_BOX): ("box", 3),
        int(kinds.mjGEOM_MESH): ("mesh", 0),
    }
    if not (model.geom_contype[geom] or model.geom_conaffinity[geom]) or int(model.geom_type[geom]) not in words:
        return None
    kind, sizes = words[int(model.geom_type[geom])]
    local = inverse @ rigid_transform(data.geom_xmat[geom], data.geom_xpos[geom])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, local[:3, :3].ravel())
    hull = None
    if kind == "mesh":
        mesh = int(model.geom_dataid[geom])
        first, num = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        hull = model.mesh_vert[first : first + num].astype(np.float64)
    size = tuple(float(value) for value in model.geom_size[geom, :sizes])
    slide, spin, roll = (float(value) for value in model.geom_friction[geom])
    return Solid(kind, size, local[:3, 3].copy(), quaternion, (slide, spin, roll), hull)
