"""Views rendered from the map, sampled about the surface that each ray meets first."""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt8

from anm_mj.frames import pixel_directions
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.types import OCCUPIED, Intrinsics, SdfQuery

_SAMPLES = 24
"""Samples per ray."""
_STRIDE = 0.6
"""Steps of the search, in voxel edges."""
_REACH = 0.9
"""How far about a place in an occupied voxel the field's surface may lie, in voxel edges."""
_PROBES = 9
"""Places within that reach at which the field is asked for its sign."""


def render_view(
    backend: MapperBackend,
    occupancy: DepthOccupancy,
    intrinsics: Intrinsics,
    T_world_camera: Float[np.ndarray, "4 4"],
    max_depth_m: float = math.inf,
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """Colour and planar depth [m] as a camera would see them; black and NaN along rays that meet no surface up to
    ``max_depth_m`` [m].
    """
    limits = backend.config.field.truncation_m, max_depth_m
    origin, direction, z, hit = view_samples(occupancy, backend.query_sdf, intrinsics, T_world_camera, *limits)
    rgb = np.zeros((intrinsics.height * intrinsics.width, 3), np.uint8)
    depth = np.full(len(rgb), np.nan, np.float32)
    rendered, rendered_depth = backend.render(origin, direction, z)
    rgb[hit] = np.rint(rendered * 255.0).astype(np.uint8)
    depth[hit] = rendered_depth
    shape = (intrinsics.height, intrinsics.width)
    return rgb.reshape(*shape, 3), depth.reshape(shape)


def view_samples(
    occupancy: DepthOccupancy,
    sdf: SdfQuery,
    intrinsics: Intrinsics,
    T_world_camera: Float[np.ndarray, "4 4"],
    truncation_m: float,
    max_depth_m: float = math.inf,
) -> tuple[
    Float32[np.ndarray, "n 3"],
    Float32[np.ndarray, "n 3"],
    Float32[np.ndarray, "n samples"],
    Bool[np.ndarray, " pixels"],
]:
    """Rays that meet a surface, and the planar depths to sample along each.

    The field passes from free to solid at a surface, and an occupied voxel says that it has not made the surface up. A
    ray that grazes an occupied voxel and stays in free space goes on. One that meets occupied voxels and never passes
    into a solid, because the field has no surface where the voxels are, ends at the first of them. Returns origins [m]
    and directions (planar depth 1) of the rays that meet a surface, their sample depths [m], and which pixels they are,
    row by row. ``sdf`` may be in any unit; ``truncation_m`` is that of the field; the search ends at the planar depth
    ``max_depth_m`` [m], or where the map does.
    """
    directions = pixel_directions(intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T
    origin = T_world_camera[:3, 3]
    begin_m, end_m = _map_depths_m(occupancy, T_world_camera)
    first, crossing = _search(occupancy, sdf, origin, directions, begin_m, min(max_depth_m, end_m))
    hit = np.isfinite(first)
    crossed = np.isfinite(crossing[hit])
    middle = np.where(crossed, crossing[hit], first[hit] + 0.5 * truncation_m)
    # Where the surface lies is known to a probe's spacing, or else to within a voxel.
    reach = np.where(crossed, 0.6 * truncation_m, 1.5 * truncation_m)
    z = middle[:, None] + reach[:, None] * np.linspace(-1.0, 1.0, _SAMPLES)
    rays = directions[hit].astype(np.float32)
    start = np.broadcast_to(origin.astype(np.float32), rays.shape).copy()
    return start, rays, np.maximum(z, 1e-3).astype(np.float32), hit


def _map_depths_m(occupancy: DepthOccupancy, T_world_camera: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
    """Planar depth of the nearest and of the farthest corner of the occupancy grid [m]; 0 for one behind the camera."""
    grid = occupancy.grid
    low = grid.origin_m - T_world_camera[:3, 3]
    high = low + np.array(grid.state.shape[::-1]) * grid.resolution_m
    axis = T_world_camera[:3, 2]
    near_m, far_m = np.minimum(low * axis, high * axis).sum(), np.maximum(low * axis, high * axis).sum()
    return max(0.0, float(near_m)), max(0.0, float(far_m))


def _search(
    occupancy: DepthOccupancy,
    sdf: SdfQuery,
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    begin_m: float,
    end_m: float,
) -> tuple[Float64[np.ndarray, " n"], Float64[np.ndarray, " n"]]:
    """Planar depth of the first occupied voxel, and of the first surface in or at one, up to ``end_m`` [m]; NaN where
    there is none. Nothing is occupied before ``begin_m`` [m].
    """
    first = np.full(len(directions), np.nan)
    crossing = np.full(len(directions), np.nan)
    searching = np.arange(len(directions))
    step, reach = occupancy.config.voxel_m * _STRIDE, occupancy.config.voxel_m * _REACH
    # From a place far outside of the map, the way to it would take hours.
    before = max(begin_m // step - 1.0, 0.0)
    for z in step + step * np.arange(before, np.ceil((end_m - step) / step)):
        occupied = searching[occupancy.state_at(origin + directions[searching] * z) == OCCUPIED]
        if not len(occupied):
            continue
        first[occupied] = np.fmin(first[occupied], z)
        crossing[occupied] = _crossing(sdf, origin, directions[occupied], z - reach, z + reach)
        searching = np.setdiff1d(searching, occupied[np.isfinite(crossing[occupied])], assume_unique=True)
        if not len(searching):
            break
    return first, crossing


def _crossing(
    sdf: SdfQuery, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"], near_m: float, far_m: float
) -> Float64[np.ndarray, " n"]:
    """Planar depth at which each ray passes from free to solid between two depths [m]; NaN where it does not."""
    z = np.linspace(near_m, far_m, _PROBES)
    values = sdf((origin + directions[:, None] * z[:, None]).reshape(-1, 3)).reshape(-1, _PROBES)
    into = (values[:, :-1] > 0.0) & (values[:, 1:] <= 0.0)
    found = into.any(axis=1)
    interval: Int64[np.ndarray, " n"] = into.argmax(axis=1)
    row = np.arange(len(values))
    before, after = values[row, interval], values[row, interval + 1]
    share = before / np.where(found, before - after, 1.0)
    return np.where(found, z[interval] + share * (z[1] - z[0]), np.nan)
