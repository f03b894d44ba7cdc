"""What a view from a place would add: expected new surface, cast as rays through the tri-state grid.

From every place 36 azimuths times a few elevations are followed to the first voxel that is not free. Unknown there
means surface yet unseen; a surface that was only ever seen from far away means surface not yet covered at 5 cm. Each
ray stands for the wall area it would hit, rho^2 d_azimuth d_slope. A camera with a 90-degree field of view takes in a
quarter of the azimuths, so that the gain of all yaws is a sliding sum over one panorama.

Some unknown can never be resolved: the inside of a hull with a slit, a voxel that every view only grazes. What the
robot has looked straight at and still does not know is noted, and after a few such views expected no more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8

from anm_mj.planning.config import PlanningConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Pose2, VoxelGrid

MAX_SLOPE = 0.95
"""Rise per metre of the steepest rays: just inside a 90-degree vertical field of view."""
BEYOND_M = 0.5
"""Surface behind the first unknown voxel is expected this much farther on [m]."""
MAX_TRIES = 3
"""Unknown that stays unknown through this many views is expected no more."""
TRIED_CELL_M = 0.1
"""Size of the cells in which views are noted [m]."""
TRIED_BITS = 22
"""Views are noted in a table of two to the power of this many cells, found by a hash: it never has to grow."""
NEARER = 0.75
"""A seen surface counts again only when it would be seen from this share of its former distance."""


@dataclass(frozen=True)
class _Crop:
    """Part of a voxel grid."""

    state: Int8[np.ndarray, "layers rows cols"]
    seen_range_m: Float32[np.ndarray, "layers rows cols"]
    origin_m: Float[np.ndarray, 3]
    """World z, y, x of the outer corner."""


@dataclass(frozen=True)
class _Hits:
    """Where each ray first meets something that is not free; its first sample where it never does."""

    voxel: Int[np.ndarray, "az el"]
    """Flat index into the crop."""
    what: Int8[np.ndarray, "az el"]
    rho_m: Float[np.ndarray, "az el"]
    """Horizontal distance [m]."""


class GainCaster:
    """Casts panoramas of expected gain from places in the plane."""

    def __init__(self, config: PlanningConfig, resolution_m: float, camera_height_m: float):
        """Lay out the rays once.

        Args:
            config: range and ray counts.
            resolution_m: the grid's voxel size [m]; rays are sampled at this spacing.
            camera_height_m: height that places are looked from [m].
        """
        self.config = config
        self.resolution_m = resolution_m
        self.camera_height_m = camera_height_m
        num_az, num_el = config.num_azimuths, config.num_elevations
        azimuth = np.arange(num_az) * math.tau / num_az
        edges = np.linspace(-MAX_SLOPE, MAX_SLOPE, num_el + 1)
        slope = (edges[:-1] + edges[1:]) / 2
        self.rho_m = np.arange(0.2, config.gain_range_m, resolution_m)
        dx = np.cos(azimuth)[:, None, None] * self.rho_m
        dy = np.sin(azimuth)[:, None, None] * self.rho_m
        dz = slope[None, :, None] * self.rho_m
        shape = (num_az, num_el, len(self.rho_m))
        self._offset = np.stack([np.broadcast_to(d, shape) for d in (dz, dy, dx)], axis=-1)
        self._ray_area = (math.tau / num_az) * (edges[1] - edges[0])
        self._tries = np.zeros(1 << TRIED_BITS, np.uint8)

    def panoramas(self, grid: VoxelGrid, places_xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n azimuths"]:
        """Expected new surface in each azimuth sector of each place [m2].

        Args:
            grid: the occupancy.
            places_xy_m: where to look from [m].
        """
        gains = np.zeros((len(places_xy_m), self.config.num_azimuths))
        if len(places_xy_m):
            crop = self._crop(grid, places_xy_m)
            for i, xy in enumerate(places_xy_m):
                gains[i] = self._gain(crop, self._first_hits(crop, xy))
        return gains

    def note_view(self, grid: VoxelGrid, pose: Pose2, fov_rad: float = math.pi / 2) -> None:
        """Note what is still unknown in a view that the grid already holds, as tried once more.

        Args:
            grid: the occupancy, the view from ``pose`` included.
            pose: where the robot stands and looks along.
            fov_rad: horizontal field of view [rad].
        """
        crop = self._crop(grid, pose.xy_m[None])
        hits = self._first_hits(crop, pose.xy_m)
        azimuth = np.arange(self.config.num_azimuths) * math.tau / self.config.num_azimuths
        off_axis = np.abs(np.mod(azimuth - pose.yaw_rad + math.pi, math.tau) - math.pi)
        tried = (off_axis < fov_rad / 2)[:, None] & (hits.what == UNKNOWN)
        cells = np.unique(self._tried_cell(crop, hits.voxel[tried]))
        self._tries[cells] = np.minimum(self._tries[cells] + 1, MAX_TRIES)

    def _first_hits(self, crop: _Crop, xy_m: Float[np.ndarray, 2]) -> _Hits:
        base = (np.array([self.camera_height_m, xy_m[1], xy_m[0]]) - crop.origin_m) / self.resolution_m
        index = np.floor(self._offset / self.resolution_m + base).astype(np.int32)
        layers, rows, cols = crop.state.shape
        level = np.clip(index[..., 0], 0, layers - 1)
        voxel = (level * rows + index[..., 1]) * cols + index[..., 2]
        state = crop.state.ravel()
        first = (state[voxel] != FREE).argmax(axis=-1)
        hit = np.take_along_axis(voxel, first[..., None], axis=-1)[..., 0]
        return _Hits(hit, state[hit], self.rho_m[first])

    def _gain(self, crop: _Crop, hits: _Hits) -> Float[np.ndarray, " az"]:
        seen = crop.seen_range_m.ravel()[hits.voxel]
        open_to_view = self._tries[self._tried_cell(crop, hits.voxel)] < MAX_TRIES
        beyond = np.minimum(hits.rho_m + BEYOND_M, self.config.gain_range_m) ** 2
        unknown = ((hits.what == UNKNOWN) & open_to_view) * beyond
        poorly_seen = (seen > self.config.gain_range_m) & (hits.rho_m < NEARER * seen)
        surface = ((hits.what == OCCUPIED) & poorly_seen) * hits.rho_m**2
        return (unknown + surface).sum(axis=-1) * self._ray_area

    def _tried_cell(self, crop: _Crop, voxel: Int[np.ndarray, "*k"]) -> Int[np.ndarray, "*k"]:
        index = np.stack(np.unravel_index(voxel, crop.state.shape), axis=-1)
        cell = np.floor((crop.origin_m + (index + 0.5) * self.resolution_m) / TRIED_CELL_M).astype(np.int64)
        # Teschner et al., Optimized spatial hashing, VMV 2003: primes that spread neighbouring cells.
        mixed = (cell[..., 0] * 73856093) ^ (cell[..., 1] * 19349663) ^ (cell[..., 2] * 83492791)
        return mixed & ((1 << TRIED_BITS) - 1)

    def _crop(self, grid: VoxelGrid, places_xy_m: Float[np.ndarray, "n 2"]) -> _Crop:
        """The part of the grid that any ray can touch, padded with unknown."""
        reach = self.config.gain_range_m + 2 * self.resolution_m
        low = np.floor((places_xy_m.min(axis=0) - reach - grid.origin_m[:2]) / self.resolution_m).astype(int)
        high = np.ceil((places_xy_m.max(axis=0) + reach - grid.origin_m[:2]) / self.resolution_m).astype(int)
        _, rows, cols = grid.state.shape
        pad = [(0, 0)]
        slices = [slice(None)]
        for lo, hi, size in ((low[1], high[1], rows), (low[0], high[0], cols)):
            pad.append((max(-lo, 0), max(hi - size, 0)))
            slices.append(slice(max(lo, 0), min(hi, size)))
        state = np.pad(grid.state[tuple(slices)], pad, constant_values=UNKNOWN)
        seen = np.pad(grid.seen_range_m[tuple(slices)], pad, constant_values=np.inf)
        skin = (state == UNKNOWN) & _next_to(state == OCCUPIED)
        state[skin], seen[skin] = OCCUPIED, 0.0
        origin = np.array(
            [
                grid.origin_m[2],
                grid.origin_m[1] + low[1] * self.resolution_m,
                grid.origin_m[0] + low[0] * self.resolution_m,
            ]
        )
        return _Crop(state, seen, origin)


def best_view(panorama: Float[np.ndarray, " azimuths"], fov_rad: float = math.pi / 2) -> tuple[float, float]:
    """Gain and yaw [rad] of the best view of a camera with this horizontal field of view."""
    n = len(panorama)
    width = max(round(fov_rad / math.tau * n), 1)
    wrapped = np.concatenate([panorama, panorama[: width - 1]])
    sums = np.convolve(wrapped, np.ones(width), mode="valid")
    start = int(np.argmax(sums))
    return float(sums[start]), (start + (width - 1) / 2) * math.tau / n


def _next_to(mask: Bool[np.ndarray, "layers rows cols"]) -> Bool[np.ndarray, "layers rows cols"]:
    """Voxels with a face neighbour in the mask: the unseen skin that cautious carving leaves on surfaces."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    grown[:, :, 1:] |= mask[:, :, :-1]
    grown[:, :, :-1] |= mask[:, :, 1:]
    return grown
