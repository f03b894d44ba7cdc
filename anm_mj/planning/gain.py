"""What a view from a place would add: expected new surface, cast as rays through the tri-state grid.

From every place 36 azimuths times a few elevations are followed to the first voxel that is not free. Unknown there
means surface yet unseen; a surface that was only ever seen from far away means surface not yet covered at 5 cm. Each
ray stands for the wall area it would hit, rho^2 d_azimuth d_slope. A camera with a 90-degree field of view takes in a
quarter of the azimuths, so that the gain of all yaws is a sliding sum over one panorama.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.config import PlanningConfig
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, VoxelGrid

MAX_SLOPE = 0.95
"""Rise per metre of the steepest rays: just inside a 90-degree vertical field of view."""
BEYOND_M = 0.5
"""Surface behind the first unknown voxel is expected this much farther on [m]."""
NEARER = 0.75
"""A seen surface counts again only when it would be seen from this share of its former distance."""


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

    def panoramas(self, grid: VoxelGrid, places_xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n azimuths"]:
        """Expected new surface in each azimuth sector of each place [m2].

        Args:
            grid: the occupancy.
            places_xy_m: where to look from [m].
        """
        if not len(places_xy_m):
            return np.zeros((0, self.config.num_azimuths))
        state, seen, origin = self._crop(grid, places_xy_m)
        cell = self._offset / self.resolution_m
        layers, rows, cols = state.shape
        flat_state, flat_seen = state.ravel(), seen.ravel()
        gains = np.empty((len(places_xy_m), self.config.num_azimuths))
        for i, (x, y) in enumerate(places_xy_m):
            base = (np.array([self.camera_height_m, y, x]) - origin) / self.resolution_m
            index = np.floor(cell + base).astype(np.int32)
            level = np.clip(index[..., 0], 0, layers - 1)
            voxel = (level * rows + index[..., 1]) * cols + index[..., 2]
            gains[i] = self._gain(flat_state, flat_seen, voxel)
        return gains

    def _gain(
        self, state: np.ndarray, seen_range_m: np.ndarray, voxel: Int[np.ndarray, "az el rho"]
    ) -> Float[np.ndarray, " az"]:
        blocked = state[voxel] != FREE
        first = blocked.argmax(axis=-1)
        hit = np.take_along_axis(voxel, first[..., None], axis=-1)[..., 0]
        what = state[hit]  # FREE when nothing blocks the ray within range.
        rho = self.rho_m[first]
        unknown = (what == UNKNOWN) * np.minimum(rho + BEYOND_M, self.config.gain_range_m) ** 2
        surface = (
            (what == OCCUPIED) & (rho < NEARER * seen_range_m[hit]) & self._poorly_seen(seen_range_m[hit])
        ) * rho**2
        return (unknown + surface).sum(axis=-1) * self._ray_area

    def _poorly_seen(self, seen_range_m: Float[np.ndarray, "az el"]) -> Bool[np.ndarray, "az el"]:
        return seen_range_m > self.config.gain_range_m

    def _crop(
        self, grid: VoxelGrid, places_xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
        state = np.where((state == UNKNOWN) & _next_to(state == OCCUPIED), np.int8(OCCUPIED), state)
        origin = np.array(
            [
                grid.origin_m[2],
                grid.origin_m[1] + low[1] * self.resolution_m,
                grid.origin_m[0] + low[0] * self.resolution_m,
            ]
        )
        return state, seen, origin


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
