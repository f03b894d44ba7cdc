"""What the compiled functions of the map are compared with, in NumPy."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int64, Shaped
from scipy import ndimage

from anm_mj.mapping.field_blocks import DoubtRule
from anm_mj.mapping.keyframes import DEPTH_UNIT_M, NO_DEPTH
from anm_mj.mapping.lattice import corners_of
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.mapping.rays import RayBatch, part, rays_of_pixels
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, SdfQuery


def voxels_to_read(
    state: Int8[np.ndarray, "layers rows cols"],
    blocks: Int64[np.ndarray, "m 3"],
    agreed: Int8[np.ndarray, "layers rows cols"] | None = None,
) -> Int64[np.ndarray, " n"]:
    """The known voxels of blocks that are occupied, or have a face neighbour in their block that is."""
    known = blocks_of(state)[tuple(blocks.T)]
    beside = ndimage.binary_dilation(known == OCCUPIED, ndimage.generate_binary_structure(3, 1)[None]) & (
        known != UNKNOWN
    )
    block, *within = np.nonzero(beside)
    layer, row, col = blocks.T[:, block] * BLOCK + np.stack(within)
    _, rows, cols = state.shape
    voxels = (layer * rows + row) * cols + col
    if agreed is None:
        return voxels
    return voxels[state.reshape(-1)[voxels] != agreed.reshape(-1)[voxels]]


def write_blocks(
    state: Int8[np.ndarray, "layers rows cols"],
    blocks: Int64[np.ndarray, "m 3"],
    voxels: Int64[np.ndarray, " n"],
    read: Int8[np.ndarray, " n"],
    out: Int8[np.ndarray, "layers rows cols"],
) -> Bool[np.ndarray, " m"]:
    """Take over the states of blocks, and other ones for some voxels."""
    here, view = tuple(blocks.T), blocks_of(out)
    before = view[here]
    view[here] = blocks_of(state)[here]
    out.reshape(-1)[voxels] = read
    return (view[here] != before).any(axis=(1, 2, 3))


def voxel_centres(
    voxels: Int64[np.ndarray, " n"],
    shape: tuple[int, ...],
    corner: Int64[np.ndarray, "3"],
    resolution_m: float,
) -> Float32[np.ndarray, "n 3"]:
    """World places of the centres of voxels [m]."""
    points_m = np.empty((len(voxels), 3), np.float32)
    for axis, index in enumerate(np.unravel_index(voxels, shape)[::-1]):
        points_m[:, axis] = (index + corner[axis]) * resolution_m
    return points_m


def decide_voxels(
    state: Int8[np.ndarray, "layers rows cols"],
    seen_m: Float32[np.ndarray, "layers rows cols"],
    voxels: Int64[np.ndarray, " n"],
    sdf_m: Float[np.ndarray, " n"],
    rule: DoubtRule,
) -> Int8[np.ndarray, " n"]:
    """Free or occupied, for voxels that are known by depth."""
    sdf_m = sdf_m.astype(np.float32)
    seen, hit = seen_m.reshape(-1)[voxels], state.reshape(-1)[voxels] == OCCUPIED
    hit_m, half_m, noise_per_m, passed_m, ray_reach_m = (np.float32(number) for number in rule)
    # Only a hit has been seen from somewhere; a ray may have passed a voxel from as far away as it carves.
    explained_m = noise_per_m * np.where(hit, seen, np.float32(1.0)) ** 2
    passed = (sdf_m <= 0.0) & (passed_m - sdf_m <= ray_reach_m)
    solid = np.where(hit, (sdf_m <= hit_m) | (sdf_m - half_m > explained_m), passed)
    return np.where(solid, np.int8(OCCUPIED), np.int8(FREE))


def blocks_of(voxels: Shaped[np.ndarray, "layers rows cols"]) -> Shaped[np.ndarray, "bl br bc b b b"]:
    """A view of voxels by block: ``[block layer, block row, block col, layer, row, col]``."""
    layers, rows, cols = (n // BLOCK for n in voxels.shape)
    return voxels.reshape(layers, BLOCK, rows, BLOCK, cols, BLOCK).transpose(0, 2, 4, 1, 3, 5)


def touched_cells(state, corner, blocks, cells_per_voxel):
    """The lattice cells that touch an occupied voxel of some blocks, and the index of the first one."""
    places = (blocks - corner // BLOCK)[:, ::-1]
    voxel = blocks[:, :, None] * BLOCK + np.arange(BLOCK)
    spans = (
        np.floor((voxel - 0.5) * cells_per_voxel + 1e-6).astype(np.int64),
        np.floor((voxel + 0.5) * cells_per_voxel - 1e-6).astype(np.int64),
    )
    occupied = blocks_of(state)[tuple(places.T)] == OCCUPIED
    low, high = spans
    corner = low[:, :, 0]
    cell = corner[:, :, None, None] + np.arange((high[:, :, -1] - corner).max(initial=0) + 1)
    touched = ((low[..., None] <= cell) & (cell <= high[..., None])).astype(np.float32)
    # As counts, axis by axis: which voxels touch a cell along one axis does not depend on the others.
    count = occupied.astype(np.float32) @ touched[:, 0, None]
    count = touched[:, 1, None].swapaxes(-1, -2) @ count
    count = np.einsum("bzi,bzyx->biyx", touched[:, 2], count, optimize=True)
    block, z, y, x = np.nonzero(count > 0.0)
    if not len(block):
        return np.zeros((0, 0, 0), bool), np.zeros(3, np.int64)
    cell = corner[block] + np.stack((x, y, z), axis=1)
    first = cell.min(axis=0)
    cells = np.zeros(cell.max(axis=0) - first + 1, bool)
    cells[tuple((cell - first).T)] = True
    return cells, first


def crossings(
    sdf: SdfQuery, cells: Bool[np.ndarray, "x y z"], corner: Int64[np.ndarray, "3"], spacing_m: float
) -> Float[np.ndarray, "n 3"]:
    """The reference of :func:`crossings`."""
    needed = corners_of(cells)
    values = np.zeros(needed.shape, np.float32)
    values[needed] = sdf(((np.argwhere(needed) + corner) * spacing_m).astype(np.float32))
    positive = values > 0.0
    points = [np.zeros((0, 3))]
    for axis in range(3):
        below, above = (tuple(s if a == axis else slice(None) for a in range(3)) for s in (slice(-1), slice(1, None)))
        cross = needed[below] & needed[above] & (positive[below] != positive[above])
        low, high = values[below][cross], values[above][cross]
        point = (np.argwhere(cross) + corner).astype(float)
        point[:, axis] += low / (low - high)
        points.append(point * spacing_m)
    return np.concatenate(points)


def concatenate(*batches: RayBatch) -> RayBatch:
    """Batches as one."""
    return RayBatch(
        np.concatenate([rays.origin_m for rays in batches]),
        np.concatenate([rays.direction for rays in batches]),
        np.concatenate([rays.rgb for rays in batches]),
        np.concatenate([rays.depth_m for rays in batches]),
    )


def ray_batches(
    pixels: Shaped[np.ndarray, " p"],
    cameras: Float32[np.ndarray, "c 17"],
    place: Int64[np.ndarray, "k n"],
    keyframe: Int64[np.ndarray, "k n"],
    current: RayBatch,
) -> RayBatch:
    """The rays of :meth:`PixelMemory.batches`, batch after batch; the reference of the native function."""
    (num_batches, num_stored), num_current = place.shape, len(current) // len(place)
    drawn = pixels[place.ravel()]
    units = drawn["depth"]
    depth_m = np.where(units == NO_DEPTH, np.float32(np.nan), units * np.float32(DEPTH_UNIT_M))
    stored = rays_of_pixels(drawn["index"].astype(np.int64), drawn["rgb"], depth_m, cameras[keyframe.ravel()])
    return concatenate(
        *(
            share
            for k in range(num_batches)
            for share in (part(stored, k * num_stored, num_stored), part(current, k * num_current, num_current))
        )
    )


def pass_variance(
    s: Float32[np.ndarray, "passes n"], rgb: Float32[np.ndarray, "passes n 3"], color_weight: float
) -> Float32[np.ndarray, " n"]:
    """The reference of :func:`pass_variance`."""
    return s.var(axis=0, ddof=1) + np.float32(color_weight) * rgb.var(axis=0, ddof=1).mean(axis=-1)
