"""What a finished run leaves unseen, and why: patches of space that border on the known free and stayed unknown."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from anm_mj.planning.grid_windows import dilate_mask
from anm_mj.planning.policies.gvg.information_gain import MAX_SLOPE
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.types import FREE, UNKNOWN, Pose2, TopDownMap, UnexploredPatch

LEAST_M2 = 0.2
"""Smaller patches are not worth a word [m2]."""
MOST_PATCHES = 40
"""The largest so many are reported."""
LIKELY_SHARE = 0.5
"""Layers less likely than this to hold surface are sky, not something left unseen."""


def unexplored_patches(
    view: PooledOccupancy, topdown: TopDownMap, pose: Pose2, *, safe_m: float, range_m: float, camera_height_m: float
) -> tuple[UnexploredPatch, ...]:
    """The largest patches of unknown next to known free space, largest first.

    Args:
        view: what was seen.
        topdown: where the robot can drive.
        pose: where it stands.
        safe_m: clearance that it needs [m].
        range_m: surface is seen well from within this distance [m].
        camera_height_m: height that it looks from [m].
    """
    edge = (view.state == UNKNOWN) & dilate_mask(view.state == FREE)
    edge[view.layer_share < LIKELY_SHARE] = False
    label = np.empty(edge.shape, np.int32)
    count = int(ndimage.label(edge, np.ones((3, 3, 3)), output=label))  # pyright: ignore[reportArgumentType]
    if not count:
        return ()
    cells = np.flatnonzero(edge)
    member = label.ravel()[cells] - 1
    size = np.bincount(member, minlength=count)
    xyz = view.centres(cells)
    centre = np.stack([np.bincount(member, xyz[:, i], count) / size for i in range(3)], axis=1)
    area_m2 = size * view.cell_m**2
    order = np.argsort(-area_m2, kind="stable")[:MOST_PATCHES]
    order = order[area_m2[order] >= LEAST_M2]
    to_drivable = _distance_m(topdown, topdown.clearance_m >= safe_m, pose)
    to_free = _distance_m(topdown, topdown.clearance_m > 0.0, pose)
    found = []
    for k in order:
        row, col = np.floor((centre[k, 1::-1] - topdown.origin_xy_m[::-1]) / topdown.resolution_m).astype(int)
        row, col = (min(max(int(i), 0), n - 1) for i, n in zip((row, col), topdown.state.shape, strict=True))
        distance = float(to_drivable[row, col])
        if distance > range_m:
            why = "too narrow a way" if to_free[row, col] <= range_m else "unreachable"
        elif centre[k, 2] - camera_height_m > MAX_SLOPE * max(distance, topdown.resolution_m):
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
