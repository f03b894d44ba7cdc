"""Questions about a compiled robot: its bodies, the space that it takes, and names for unnamed elements of its spec.

Extents of geoms follow from their support functions, exact for MuJoCo's primitives and for meshes.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.types import Footprint

_NUM_DIRECTIONS = 720
"""Directions about the vertical axis, half a degree apart: the error is 1e-5 of a corner's distance."""
FOOTPRINT_MARGIN_M = 0.01
"""The footprint is wider than the robot by this margin [m]."""
WIDEST_M, HIGHEST_M = 2.0, 4.0
"""Larger robots, by radius and height, are not in metres [m]."""
LOWEST_M = 0.05
"""Rugs and thresholds below this height are no obstacles [m]; scenes have no collision boxes there either."""


@dataclass(frozen=True, eq=False)
class CompiledRobot:
    """A robot's spec, the model compiled from it, and its state with all poses up to date."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    data: mujoco.MjData
    path: Path
    """The robot's file, for messages."""


def subtree(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and all its descendants."""
    found = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in found:
            found.add(other)
    return sorted(found)


def joints_above(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints between a body, its own included, and the world."""
    found = []
    while body:
        found += range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        body = int(model.body_parentid[body])
    return found


def solid_geoms(model: mujoco.MjModel) -> list[int]:
    """Indices of geoms that can touch something."""
    return np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist()


def unused_name(wanted: str, find: Callable[[str], Any]) -> str:
    """The wanted name, extended until ``find`` (such as ``spec.geom``) does not know it."""
    while find(wanted) is not None:
        wanted += "_"
    return wanted


def name_all(elements: Iterable[Any], kind: str) -> None:
    """Name all unnamed elements; later look-ups go by name."""
    elements = list(elements)
    taken = {element.name for element in elements}
    for number, element in enumerate(elements):
        if not element.name:
            element.name = next(name for k in range(len(taken) + 1) if (name := f"{kind}_{number + k}") not in taken)
            taken.add(element.name)


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


def robot_footprint(
    model: mujoco.MjModel, data: mujoco.MjData, T_world_base: Float[np.ndarray, "4 4"]
) -> tuple[Footprint, float]:
    """The upright cylinder about the base that encloses the robot, joints locked, and the robot's own radius [m]."""
    solid = solid_geoms(model)
    floor_z = float(T_world_base[2, 3])
    radius = max(radius_about_axis_m(model, data, g, T_world_base[:2, 3]) for g in solid)
    # Wheels count: what passes below a high body does not pass below them.
    heights = [height_range_m(model, data, g) for g in solid]
    lowest, highest = min(low for low, _ in heights) - floor_z, max(high for _, high in heights) - floor_z
    footprint = Footprint(
        radius_m=round(radius + FOOTPRINT_MARGIN_M, 6),
        z_min_m=round(max(lowest, LOWEST_M), 6),
        z_max_m=round(max(highest, LOWEST_M + 0.05), 6),
    )
    return footprint, round(radius, 6)


def require_size(footprint: Footprint, path: Path) -> None:
    """Accept a robot that fits buildings. Raises RobotError if it is too large, as in a file in centimetres."""
    if footprint.radius_m > WIDEST_M or footprint.z_max_m > HIGHEST_M:
        raise RobotError(
            f"The robot {path} is {2.0 * footprint.radius_m:.3g} m across and {footprint.z_max_m:.3g} m high; MuJoCo's "
            "unit is the metre: scale the file, or choose a key frame in which it is compact by --set "
            "model.keyframe=NAME."
        )


def lowest_m(model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int]) -> float:
    """Lowest point of some geoms in the world [m]."""
    return min(height_range_m(model, data, geom)[0] for geom in geoms)


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
