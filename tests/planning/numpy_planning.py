"""NumPy and SciPy code that computes what the native engine does for the planner: the reference of its tests."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix, csgraph

from anm_mj.planning.policies.gvg.pooled_occupancy import POOL
from anm_mj.types import FREE, OCCUPIED, UNKNOWN
from anm_mj.utils.arrays import bounds, dilate_mask

RAYS_PER_BATCH = 16_384
"""Rays that are cast at once."""
KNOWN = 2
"""State of a pooled cell that holds no new surface, without being free."""
SAMPLES_AT_ONCE = 12
"""Rays are followed by this many samples at a time."""


def numpy_capped_distance_cells(free, cap_cells):
    """Distance to the nearest cell that is not free, capped [cells]."""
    # The smaller type holds the sum of two squares up to 181 cells, and takes half of the time.
    whole = np.uint16 if 2 * cap_cells**2 <= np.iinfo(np.uint16).max else np.uint32
    squared = np.square(_along_rows(free, cap_cells), dtype=whole)
    nearest = squared.copy()
    shifted = np.empty_like(squared)
    for d in range(1, min(cap_cells, len(free))):
        np.add(squared, whole(d * d), out=shifted)
        np.minimum(nearest[:-d], shifted[d:], out=nearest[:-d])
        np.minimum(nearest[d:], shifted[:-d], out=nearest[d:])
    return np.sqrt(nearest, dtype=np.float32)


def _along_rows(free, cap_cells):
    """Distance to the nearest cell of the same row that is not free, capped [cells]."""
    distance = np.where(free, np.uint16(cap_cells), np.uint16(0))
    step = 1
    while step < min(cap_cells, free.shape[1]):
        # Distances that were exact below one step are exact below two.
        farther = distance + np.uint16(step)
        np.minimum(distance[:, :-step], farther[:, step:], out=distance[:, :-step])
        np.minimum(distance[:, step:], farther[:, :-step], out=distance[:, step:])
        step *= 2
    return distance


def scipy_enclosed_holes(unknown, max_cells):
    """The cells of parts of a mask, connected by sides, that have no more than ``max_cells``."""
    labels = np.empty(unknown.shape, np.int32)
    count = int(ndimage.label(unknown, output=labels))  # pyright: ignore[reportArgumentType]
    if not count:
        return unknown
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    small = sizes <= max_cells
    small[0] = False
    return small[labels]


def scipy_connected_components(links, num):
    """The component of each node."""
    matrix = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(num, num))
    return csgraph.connected_components(matrix, directed=False)[1].astype(np.int64)


def numpy_pool(state, low, shape, floor, cells, to, num_free, num_surface):
    """Pool a part of a voxel grid; as rows and columns in which cells have changed, or None.

    Args:
        state: of all voxels.
        low: layer, row and column of the part's first voxel, which may lie outside of the grid.
        shape: layers, rows and columns of its cells; the outermost rows and columns are looked at and not written.
        floor: which of its layers of cells holds the floor.
        cells: written to.
        to: layer, row and column of the first cell that is written.
        num_free: free cells of each layer; kept up.
        num_surface: occupied cells of each layer; kept up.
    """
    high = low + POOL * shape
    inside = tuple(slice(max(a, 0), min(b, n)) for a, b, n in zip(low, high, state.shape, strict=True))
    voxels = state[inside]
    pad = [(max(-int(a), 0), max(int(b - n), 0)) for a, b, n in zip(low, high, state.shape, strict=True)]
    voxels = np.pad(voxels, pad, constant_values=UNKNOWN)
    pooled, partly = _pooled(voxels)
    pooled[partly & dilate_mask(pooled == OCCUPIED)] = KNOWN
    pooled[:, _without_floor(pooled, floor)] = KNOWN
    pooled = pooled[:, 1:-1, 1:-1]
    where = tuple(slice(int(a), int(a + b)) for a, b in zip(to, pooled.shape, strict=True))
    changed = bounds((pooled != cells[where]).any(axis=0), (where[1], where[2]))
    if not changed:
        return None
    for counts, counted in ((num_free, FREE), (num_surface, OCCUPIED)):
        counts[where[0]] += np.count_nonzero(pooled == counted, axis=(1, 2))
        counts[where[0]] -= np.count_nonzero(cells[where] == counted, axis=(1, 2))
    cells[where] = pooled
    ((rows, cols),) = changed
    return rows.start, rows.stop, cols.start, cols.stop


def _without_floor(state, floor):
    """Columns that are seen free through the floor's layer and the one below: there the building has ended."""
    if not 1 <= floor < len(state):
        return np.zeros(state.shape[1:], bool)
    return (state[floor] == FREE) & (state[floor - 1] == FREE)


def _pooled(state):
    """State of cells of 2 x 2 x 2 voxels, and which of the unknown ones are not unknown throughout."""
    # Of -1, 0 and 1 this leaves 17, 0 and 1, so that one sum holds the unknown in its upper four bits and all that is
    # not free in its lower four.
    total = state.view(np.uint8) & np.uint8(17)
    total = total[0::2] + total[1::2]
    total = total[:, 0::2] + total[:, 1::2]
    # Neighbours in a row as the two halves of one number: no sum exceeds a byte.
    pairs = np.ascontiguousarray(total).view(np.uint16)
    total = (pairs + (pairs >> 8)).astype(np.uint8)
    num_unknown = total >> 4
    occupied = (total & np.uint8(15)) > num_unknown
    unknown = (num_unknown >= POOL**3 // 2) & ~occupied
    pooled = occupied.astype(np.int8)
    pooled[unknown] = UNKNOWN
    return pooled, unknown & (num_unknown < POOL**3)


def numpy_cast_rays(cells, offset, start, rows, rays):
    """Cast the rays of some rows again where the cells that they hit have another state now.

    Args:
        cells: the pooled occupancy.
        offset: of each sample of each ray from the cell that it starts in, as flat indices.
        start: the cell that the rays of each row start in, as a flat index.
        rows: which rows.
        rays: of all rows; changed in place.
    """
    places, rays_of = np.nonzero(cells.reshape(-1)[rays.hit[rows]] != rays.state[rows])
    for begin in range(0, len(places), RAYS_PER_BATCH):
        batch = slice(begin, begin + RAYS_PER_BATCH)
        row, ray = rows[places[batch]], rays_of[batch]
        along = offset.take(ray, axis=0)
        along += start[row, None]
        states = cells.reshape(-1).take(along)
        each = np.arange(len(row))
        first = (states != FREE).argmax(axis=1)
        state = states[each, first]
        rays.hit[row, ray], rays.sample[row, ray], rays.state[row, ray] = along[each, first], first, state
        # The extent of the unknown behind the hit tells a room from the back of a chair.
        unknown = np.flatnonzero(state == UNKNOWN)
        first = first[unknown]
        behind = np.arange(states.shape[1], dtype=np.uint8) > first.astype(np.uint8)[:, None]
        ends = (states[unknown] != UNKNOWN) & behind
        ends[:, -1] = True
        rays.depth[row[unknown], ray[unknown]] = ends.argmax(axis=1) - first


def numpy_ray_gains(rays, distance_m, layer_share, tried_from_m, rule):
    """Expected new surface of each ray [m2]; 0 where it does not end in the unknown.

    Args:
        rays: what they hit.
        distance_m: of each sample [m].
        layer_share: how likely it is that what is unknown in a layer holds surface.
        tried_from_m: nearest distance from which a view left each cell unknown; +inf where none did [m].
        rule: edge of a cell [m]; largest depth of surface in the unknown [m]; range of views [m]; a cell that was tried
            has gain from nearer than this share of the distance then; area of a ray at a distance of 1 m.
    """
    cell_m, max_depth_m, range_m, suppressed_share, solid_angle = (np.float32(number) for number in rule)
    gain_m2 = np.zeros(rays.hit.shape, np.float32)
    at = np.nonzero(rays.state == UNKNOWN)
    hit, here_m = rays.hit[at], distance_m[rays.sample[at]]
    # The surface may lie anywhere in the unknown behind the hit.
    behind_m = np.minimum(rays.depth[at] * cell_m, max_depth_m)
    squared = np.minimum(here_m + behind_m, range_m) ** 2
    _, rows, cols = tried_from_m.shape
    squared *= layer_share[hit // (rows * cols)]
    squared[here_m >= suppressed_share * tried_from_m.ravel()[hit]] = 0.0
    gain_m2[at] = squared * solid_angle
    return gain_m2


def numpy_first_closed(cells, frame, origin_m, direction, distance_m):
    """The first cell along each ray that is not free, as a flat index, and its sample; -1 where all are free.

    Args:
        cells: the pooled occupancy.
        frame: world x, y, z of its corner, edge of a cell, and heights at which rays end below and above [m].
        origin_m: of all rays [m].
        direction: of horizontal length 1.
        distance_m: horizontal distance of the samples [m].
    """
    corner_m, cell_m, low_m, high_m = frame[:3], *frame[3:]
    _, rows, cols = cells.shape
    cell, sample = np.full((2, len(direction)), -1)
    # Most rays end early, and their ends are not looked at.
    left = np.arange(len(direction))
    for begin in range(0, len(distance_m), SAMPLES_AT_ONCE):
        here_m = distance_m[begin : begin + SAMPLES_AT_ONCE]
        x, y, z = (origin_m[axis] + np.multiply.outer(direction[left, axis], here_m) for axis in range(3))
        col, row, layer = (
            np.floor((along_m - corner_m[axis]) / cell_m).astype(np.int64)
            for axis, along_m in enumerate((x, y, z.clip(low_m, high_m)))
        )
        index = (layer * rows + row) * cols + col
        closed = cells.reshape(-1)[index] != FREE
        first, ends = closed.argmax(axis=1), closed.any(axis=1)
        cell[left[ends]] = index[ends, first[ends]]
        sample[left[ends]] = begin + first[ends]
        left = left[~ends]
    return cell, sample
