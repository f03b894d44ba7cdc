"""Which pixels of a frame show something that moves, decided by what the occupancy grid knows, and what follows of it.

Space that was looked through often enough is surely free. What is measured there has come since, and so has what hangs
together with it in the image, unless the grid knows surface there (free space as evidence: Schmid et al., Dynablox,
RA-L 2023; growth in the image: Palazzolo et al., ReFusion, IROS 2019). No detector has to know what it is.

A pixel counts as moved only if all space that its depth may be too short by is free, too: by the noise learnt from the
images and by how unsure the pose is. Moved pixels mark no surface. They raise the log-odds of their voxels more slowly
than looking through lowers them, so that what stays becomes surface after a while. Where something moves, looking
through voxels counts as much as a hit: what was marked before it was known to move is freed.
"""

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float, Int64, UInt8
from scipy import ndimage

from anm_mj.mapping.depth_noise import EXACT_PER_M
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.mapping.occupancy_kernels import BLOCK, KNOWN_HITS, NOWHERE, VoxelArrays
from anm_mj.types import FREE, OCCUPIED, Observation
from anm_mj.utils.arrays import numbers_of

NOISE_REACH = 4.0
"""Depth may be too short by so many standard deviations."""
_HELD_M = 0.1, 1.5
"""Heights between which what is held is an obstacle, and below which what is left of a thing is one [m]."""
_THING_M = 0.05, 2.2
"""Heights between which things are that move [m]: feet stand right above the floor."""
_CONNECTED_M = 0.1
"""Surface that hangs together begins at this height [m]: the floor and its noise hold everything together."""
_LEAST_GONE, _GONE_SHARE = 6, 2
"""In columns, three by three, at least so many voxels must have gone, and so many for each that is left."""
_LEFT_M2 = 0.5
"""Surface that hangs together with no more than this may be left of a thing that moved [m2]: about the front of a
person. Furniture hangs together with more of itself, walls or the floor of a room with far more."""
_LIFTED = 0
"""Log-odds of surface that is doubted: those of a voxel that was never observed; any frame decides."""
_NO_DOUBT = np.zeros((0, 3), np.int64), np.zeros(0, np.int8)
"""Places and log-odds of nothing."""


class MovedVoxels:
    """Remembers where something moved lately, and what of it is taken for an obstacle."""

    def __init__(self, config: MovingConfig, occupancy: OccupancyConfig) -> None:
        self.config, self._occupancy = config, occupancy
        self._last: dict[tuple[int, int], int] = {}
        """Frame in which something moved in a column of blocks, by its x and y in blocks of the world."""
        self._newest: Int64[np.ndarray, "n 3"] = np.zeros((0, 3), np.int64)
        """Where something moved in the last frame that showed any, by x, y and z index."""
        self._seen = np.zeros(0, np.int64), np.zeros(0, np.int64)
        """Voxels in which something moved lately, as single numbers, and when last."""
        self._held: list[tuple[int, int, Float[np.ndarray, "n 3"], Int64[np.ndarray, "m 3"]]] = []
        """What is held: until which frame, for how many, around which discs, and the voxels."""
        self._ever: set[tuple[int, int]] = set()
        """Columns of blocks in which anything ever moved, likewise."""
        self._doubted = _NO_DOUBT
        """Surface that was doubted and not seen since, by x, y and z index, and the log-odds it had."""
        self._doubted_once = np.zeros(0, np.int64)
        """All that was doubted since the last time it was settled, as single numbers: nothing is doubted twice."""
        low, high = (round(height / occupancy.voxel_m) for height in _THING_M)
        self.heights = low, high
        """Lowest z index of what moves, and the one after the highest."""

    def take(self, voxels: VoxelArrays, places: Int64[np.ndarray, "n 3"], frame: int) -> None:
        """Note that something moved in voxels, given by x, y and z index; what stays there becomes surface."""
        self._newest = _distinct(places)
        columns = _distinct(self._newest[:, :2] // BLOCK).tolist()
        self._last |= {(x, y): frame for x, y in columns}
        self._ever |= self._last.keys()
        self._begin(voxels, frame)
        _, cells = voxels.cells_of(self._newest)
        raised = np.minimum(voxels.log_odds[cells].astype(np.int16) + self.config.stay, self._occupancy.limit)
        # What nobody has looked through holds no evidence to be outweighed.
        known = voxels.log_odds[cells] < 0
        cells = tuple(axis[known] for axis in cells)
        voxels.log_odds[cells] = raised[known].astype(np.int8)
        cells = tuple(axis[raised[known] >= 0] for axis in cells)
        voxels.change(cells, OCCUPIED, self._occupancy.hit, frame)
        voxels.block_stamp[tuple(axis // BLOCK for axis in cells)] = frame

    def _begin(self, voxels: VoxelArrays, frame: int) -> None:
        """Where something comes, what was looked through is surely free, however often it was looked at.

        Else what stays would become surface the sooner, the less often the place was seen before.
        """
        keys, (known, last) = numbers_of(self._newest), self._seen
        fresh = ~np.isin(keys, known, assume_unique=True)
        _, cells = voxels.cells_of(self._newest[fresh])
        free = voxels.log_odds[cells] < 0
        voxels.log_odds[tuple(axis[free] for axis in cells)] = -self._occupancy.limit
        kept = (last >= frame - self.config.memory_frames) & ~np.isin(known, keys, assume_unique=True)
        known = np.concatenate((known[kept], keys))
        last = np.concatenate((last[kept], np.full(len(keys), frame)))
        self._seen = known, last

    def free_left(self, voxels: VoxelArrays, frame: int) -> None:
        """Free what few frames have hit in columns that something which moved has left.

        A foot that is seen before the space about it is known counts as surface, and from nearby the camera looks over
        its place. Where most of what moved there was looked through since, this has gone, too. (Where the thing itself
        was hit, ``native/moved_pixels.h`` does the same.)
        """
        keys, _ = self._seen
        _, (layer, row, col) = voxels.cells_of(_places(keys))
        gone = voxels.log_odds[layer, row, col] == -self._occupancy.limit
        if not gone.any():
            return
        row, col = row[gone], col[gone]
        # A margin, since columns beside those that were left count, too.
        first_row, first_col = int(row.min()) - 2, int(col.min()) - 2
        num_rows, num_cols = int(row.max()) + 3 - first_row, int(col.max()) + 3 - first_col
        counts = np.bincount((row - first_row) * num_cols + col - first_col, minlength=num_rows * num_cols)
        went = ndimage.convolve(counts.reshape(num_rows, num_cols), np.ones((3, 3), np.int64), mode="constant")
        row, col = np.nonzero(went >= _LEAST_GONE)
        went, row, col = went[row, col], row + first_row, col + first_col
        inside = (row >= 0) & (row < voxels.state.shape[1]) & (col >= 0) & (col < voxels.state.shape[2])
        went, row, col = went[inside], row[inside], col[inside]
        low, high = (self._layer(voxels, height_m) for height_m in _THING_M)
        # Heads pass right below lintels, which few frames show.
        top = max(self._layer(voxels, _HELD_M[1]), low)
        log_odds = voxels.log_odds[low:top, row, col]
        weak = (voxels.state[low:top, row, col] == OCCUPIED) & (log_odds >= 0)
        weak &= log_odds <= KNOWN_HITS * self._occupancy.hit
        for k in np.flatnonzero(weak.any(axis=0)).tolist():
            about = slice(low, high), *(slice(max(i - 1, 0), i + 2) for i in (int(row[k]), int(col[k])))
            stays = np.count_nonzero((voxels.state[about] == OCCUPIED) & (voxels.log_odds[about] >= 0))
            weak[:, k] &= went[k] >= _GONE_SHARE * stays
        layer, which = np.nonzero(weak)
        layer, row, col = layer + low, row[which], col[which]
        voxels.change((layer, row, col), FREE, -self._occupancy.miss, frame)
        voxels.num_hits[layer, row, col] = 0

    def _layer(self, voxels: VoxelArrays, height_m: float) -> int:
        """The layer that begins at a height, or the nearest that the voxels have, or their number."""
        return min(max(round(height_m / self._occupancy.voxel_m) - int(voxels.corner[2]), 0), len(voxels.state))

    def hold(self, voxels: VoxelArrays, discs: Float[np.ndarray, "n 3"], frame: int) -> None:
        """Take what moved last for an obstacle, and discs about x and y with a radius [m].

        Looking through frees it, or time: what is held again about the same place is held for twice as long as before.
        """
        edge = self._occupancy.voxel_m
        low, high = (round(height / edge) for height in _HELD_M)
        held = [self._newest]
        for x, y, radius in discs / edge:
            reach = math.ceil(radius)
            column = np.mgrid[-reach : reach + 1, -reach : reach + 1, low : high + 1].reshape(3, -1).T
            held.append((column + np.rint([x, y, 0.0]).astype(np.int64))[np.hypot(*column[:, :2].T) <= radius])
        places = _distinct(np.concatenate(held))
        before = [frames for _, frames, old, _ in self._held if _meet(old, discs)]
        frames = 2 * max(before) if before else self.config.held_frames
        self._held.append((frame + frames, frames, discs, places))
        self._set(voxels, places, frame + 1, FREE, OCCUPIED)

    def expire(self, voxels: VoxelArrays, frame: int) -> None:
        """Take for free space again what was held for long enough."""
        over = [held[3] for held in self._held if held[0] == frame]
        if over:
            still = [numbers_of(held[3]) for held in self._held if held[0] > frame]
            places = np.concatenate(over)
            is_held = np.isin(numbers_of(places), np.concatenate([*still, np.zeros(0, np.int64)]))
            self._set(voxels, places[~is_held], frame, OCCUPIED, FREE)
        # How long it was held is remembered for as long again.
        self._held = [held for held in self._held if held[0] + held[1] > frame]

    def release(self, voxels: VoxelArrays, frame: int) -> bool:
        """Take what was held for an obstacle for free space; whether any was left."""
        found = [self._set(voxels, held[3], frame + 1, OCCUPIED, FREE) for held in self._held]
        self._held = []
        return any(found)

    def doubt(self, voxels: VoxelArrays, frame: int) -> bool:
        """Take surface for free space for now that may be left of what moved; whether there was any, not doubted yet.

        It lies about where something ever moved, and few frames have hit it, or it hangs together with little. The next
        frame that shows its place decides; what none shows is surface again after :meth:`settle`.
        """
        columns = self._columns(voxels, self._ever)
        if not columns.any():
            return False
        low, high = (self._layer(voxels, height_m) for height_m in _THING_M)
        solid = voxels.state == OCCUPIED
        # The floor holds everything together.
        solid[: self._layer(voxels, _CONNECTED_M)] = False
        label = np.empty(solid.shape, np.int32)
        ndimage.label(solid, np.ones((3, 3, 3)), output=label)  # pyright: ignore[reportArgumentType]
        is_small = np.bincount(label.ravel()) <= _LEFT_M2 / self._occupancy.voxel_m**2
        near = np.repeat(np.repeat(columns, BLOCK, axis=0), BLOCK, axis=1).astype(bool)
        part = slice(low, high)
        is_weak = voxels.log_odds[part] <= KNOWN_HITS * self._occupancy.hit
        layer, row, col = np.nonzero(solid[part] & near & (is_small[label[part]] | is_weak))
        places = np.stack((col, row, layer + low), axis=1) + voxels.corner
        places = places[~np.isin(numbers_of(places), self._doubted_once)]
        _, cells = voxels.cells_of(places)
        known, log_odds = self._doubted
        self._doubted = np.concatenate((known, places)), np.concatenate((log_odds, voxels.log_odds[cells]))
        self._doubted_once = np.concatenate((self._doubted_once, numbers_of(places)))
        voxels.change(cells, FREE, _LIFTED, frame + 1)
        return bool(len(places))

    def settle(self, voxels: VoxelArrays, frame: int) -> bool:
        """Take for surface again what was doubted and not seen since, and what is held for free space; whether any.
        Nothing is doubted afterwards.
        """
        released = self.release(voxels, frame)
        places, log_odds = self._doubted
        _, cells = voxels.cells_of(places)
        voxels.change(cells, OCCUPIED, log_odds, frame + 1)
        self._doubted, self._doubted_once = _NO_DOUBT, self._doubted_once[:0]
        return released or bool(len(log_odds))

    def look(self, voxels: VoxelArrays) -> None:
        """Leave to the frame that was just fused what it shows of what is doubted."""
        places, log_odds = self._doubted
        if len(places):
            # At once: a hit and looks through it may add up to what doubt has left.
            _, cells = voxels.cells_of(places)
            unseen = (voxels.log_odds[cells] == _LIFTED) & (voxels.state[cells] == FREE)
            self._doubted = places[unseen], log_odds[unseen]

    def is_pretended(self, voxels: VoxelArrays, indices: Int64[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether voxels, by their indices into the raveled grid, are held, or doubted and not seen since."""
        held = (voxels.state.reshape(-1)[indices] == OCCUPIED) & (voxels.log_odds.reshape(-1)[indices] < 0)
        places, _ = self._doubted
        if not len(places):
            return held
        _, cells = voxels.cells_of(places)
        return held | np.isin(indices, np.ravel_multi_index(cells, voxels.state.shape))

    @staticmethod
    def _set(voxels: VoxelArrays, places: Int64[np.ndarray, "n 3"], frame: int, old: int, state: int) -> bool:
        """Change the states of places whose log-odds say free, and keep those; whether there were any.

        ``frame`` is the first one with which readers find the change: the next one where they may have read this one.
        """
        _, cells = voxels.cells_of(places)
        chosen = (voxels.log_odds[cells] < 0) & (voxels.state[cells] == old)
        cells = tuple(axis[chosen] for axis in cells)
        voxels.change(cells, state, voxels.log_odds[cells], frame)
        return bool(chosen.any())

    def heavy(self, voxels: VoxelArrays, frame: int) -> UInt8[np.ndarray, "block_rows block_cols"]:
        """Columns of a grid's blocks in which something moved in the last frames; empty for none."""
        oldest = frame - self.config.memory_frames
        self._last = {place: last for place, last in self._last.items() if last >= oldest}
        return self._columns(voxels, self._last) if self._last else NOWHERE

    @staticmethod
    def _columns(voxels: VoxelArrays, places: Iterable[tuple[int, int]]) -> UInt8[np.ndarray, "block_rows block_cols"]:
        """Columns of a grid's blocks, given by x and y in blocks of the world, and those about them."""
        found = np.zeros(voxels.column_version.shape, np.uint8)
        for x, y in places:
            row, col = y - int(voxels.corner[1]) // BLOCK, x - int(voxels.corner[0]) // BLOCK
            # A step leads into the next block.
            found[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = 1
        return found


def _places(keys: Int64[np.ndarray, " n"]) -> Int64[np.ndarray, "n 3"]:
    """The voxels that have these :func:`numbers_of`."""
    z = ((keys + (1 << 20)) & ((1 << 21) - 1)) - (1 << 20)
    rest = (keys - z) >> 21
    y = ((rest + (1 << 20)) & ((1 << 21) - 1)) - (1 << 20)
    return np.stack(((rest - y) >> 21, y, z), axis=1)


def _meet(places: Float[np.ndarray, "n 3"], others: Float[np.ndarray, "m 3"]) -> bool:
    """Whether a disc of some, by x, y and radius, overlaps one of others."""
    apart = np.linalg.norm(places[:, None, :2] - others[None, :, :2], axis=2)
    return bool((apart <= places[:, None, 2] + others[None, :, 2]).any())


def _distinct(indices: Int64[np.ndarray, "n d"]) -> Int64[np.ndarray, "m d"]:
    """Each row once; a sort of single numbers takes a fraction of one of rows."""
    low = indices.min(axis=0, initial=0)
    shape = indices.max(axis=0, initial=0) + 1 - low
    keys = np.unique(np.ravel_multi_index(tuple((indices - low).T), tuple(shape.tolist())))
    return np.stack(np.unravel_index(keys, tuple(shape.tolist())), axis=1) + low


def depth_doubt(noise_per_m: float, observation: Observation) -> tuple[float, float, float]:
    """By how much a measured depth may be too short: a factor of its square [1/m], a length [m], and a factor of it.

    The first is the noise of the sensor, as :mod:`anm_mj.mapping.depth_noise` has it, infinite where nobody knows; the
    others are errors of the pose, of its position and its rotation.
    """
    noise = 0.0 if noise_per_m < EXACT_PER_M or not math.isfinite(noise_per_m) else noise_per_m
    deviations = noise, observation.position_deviation_m, observation.heading_deviation_rad
    noise, position_m, rotation = (NOISE_REACH * deviation for deviation in deviations)
    return noise, position_m, rotation
