"""The free bodies of a world as objects that the robot may push."""

import mujoco
import numpy as np
from jaxtyping import Float64

from anm_mj.frames import rigid_transform
from anm_mj.scene.movable import Movable, Solid


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
