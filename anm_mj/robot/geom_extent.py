"""Extents of geoms by their support functions: exact for MuJoCo's primitives and for meshes."""

import math

import mujoco
import numpy as np
from jaxtyping import Float

_NUM_DIRECTIONS = 720
"""Directions about the vertical axis, half a degree apart: the error is 1e-5 of a corner's distance."""


def support_m(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, directions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Support function of a geom: its extent along unit directions of the world, from the world's origin [m]."""
    local = directions @ data.geom_xmat[geom].reshape(3, 3)
    return directions @ data.geom_xpos[geom] + _local_support(model, geom, local)


def radius_about_axis_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int, xy_m: Float[np.ndarray, "2"]) -> float:
    """Largest horizontal distance of a geom from the vertical axis through a world position [m]."""
    angles = np.arange(_NUM_DIRECTIONS) * (math.tau / _NUM_DIRECTIONS)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    return float((support_m(model, data, geom, directions) - directions[:, :2] @ xy_m).max())


def height_range_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> tuple[float, float]:
    """Lowest and highest point of a geom in the world [m]."""
    down, up = support_m(model, data, geom, np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    return -float(down), float(up)


def _local_support(model: mujoco.MjModel, geom: int, d: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(len(d), size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] + size[1] * np.abs(d[:, 2])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return size[0] * np.hypot(d[:, 0], d[:, 1]) + size[1] * np.abs(d[:, 2])
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return np.linalg.norm(d * size, axis=1)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        return (d @ model.mesh_vert[first : first + count].T.astype(float)).max(axis=1)
    # A box; for planes, height fields and SDFs, which no robot has, the bounding box.
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return d @ centre + np.abs(d) @ half
