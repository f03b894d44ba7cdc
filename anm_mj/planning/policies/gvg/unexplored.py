"""What a finished run leaves unexplored, and why: patches of unknown space next to known free space."""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.planning.policies.gvg.ray_cache import INSIDE
from anm_mj.types import FREE, UNKNOWN, Pose2, TopDownMap, UnexploredPatch
from anm_mj.utils.arrays import bounds, dilate, dilate_mask

MIN_AREA_M2 = 0.2
"""Smaller patches are not reported [m2]."""
MAX_PATCHES = 40
"""Only the largest patches are reported."""
MIN_SURFACE_LIKELIHOOD = 0.5
"""In layers that are less likely to hold surface the unknown is sky."""


def unexplored_patches(
    occupancy: PooledOccupancy, topdown: TopDownMap, pose: Pose2, *, safe_m: float, range_m: float, camera: FieldOfView
) -> tuple[UnexploredPatch, ...]:
    """The largest patches of unknown cells next to known free ones, largest first.

    The robot's paths keep ``safe_m`` clearance [m]; its views show surface up to ``range_m`` [m].
    """
    _, steepest = camera.slopes(INSIDE)
    # Around what was seen lies a rim of unknown, as wide as rays are long.
    seen = (occupancy.state == FREE).any(axis=0)
    parts = bounds(seen, (slice(0, seen.shape[0]), slice(0, seen.shape[1])))
    if not parts:
        return ()
    rows, cols = dilate(parts[0], 1, seen.shape)
    state = occupancy.state[:, rows, cols]
    edge = (state == UNKNOWN) & dilate_mask(state == FREE)
    edge[occupancy.layer_share < MIN_SURFACE_LIKELIHOOD] = False
    label = np.empty(edge.shape, np.int32)
    count = int(ndimage.label(edge, np.ones((3, 3, 3)), output=label))  # pyright: ignore[reportArgumentType]
    if not count:
        return ()
    layer, row, col = np.nonzero(edge)
    member = label[layer, row, col] - 1
    cells = np.ravel_multi_index((layer, row + rows.start, col + cols.start), occupancy.state.shape)
    size = np.bincount(member, minlength=count)
    xyz = occupancy.centres(cells)
    centre = np.stack([np.bincount(member, xyz[:, i], count) / size for i in range(3)], axis=1)
    area_m2 = size * occupancy.cell_m**2
    order = np.argsort(-area_m2, kind="stable")[:MAX_PATCHES]
    order = order[area_m2[order] >= MIN_AREA_M2]
    to_drivable = _distance_m(topdown, topdown.clearance_m >= safe_m, pose)
    to_free = _distance_m(topdown, topdown.clearance_m > 0.0, pose)
    found = []
    for k in order:
        row, col = np.floor((centre[k, 1::-1] - topdown.origin_xy_m[::-1]) / topdown.resolution_m).astype(int)
        row, col = (min(max(int(i), 0), n - 1) for i, n in zip((row, col), topdown.state.shape, strict=True))
        distance = float(to_drivable[row, col])
        if distance > range_m:
            why = "too narrow a way" if to_free[row, col] <= range_m else "unreachable"
        elif centre[k, 2] - camera.height_m > steepest * max(distance, topdown.resolution_m):
            why = "too high"
        else:
            why = "hidden"
        found.append(UnexploredPatch(centre[k], float(area_m2[k]), why))
    return tuple(found)


def _distance_m(
    topdown: TopDownMap, open_cells: Bool[np.ndarray, "rows cols"], pose: Pose2
) -> Float[np.ndarray, "rows cols"]:
    """Distance of every cell to the open cells that are connected with the one nearest to the robot [m]."""
    if not open_cells.any():
        return np.full(open_cells.shape, np.inf)
    label = np.empty(open_cells.shape, np.int32)
    ndimage.label(open_cells, np.ones((3, 3)), output=label)  # pyright: ignore[reportArgumentType]
    rows, cols = np.nonzero(open_cells)
    centres = topdown.origin_xy_m + (np.stack([cols, rows], axis=1) + 0.5) * topdown.resolution_m
    nearest = int(np.argmin(((centres - pose.xy_m) ** 2).sum(axis=1)))
    mine = label == label[rows[nearest], cols[nearest]]
    return np.asarray(ndimage.distance_transform_edt(~mine)) * topdown.resolution_m
