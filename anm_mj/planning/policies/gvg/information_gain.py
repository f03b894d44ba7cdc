"""What a view from a place would add: expected new surface, cast as rays through the tri-state grid.

From every place 36 azimuths times a few elevations are followed to the first cell that is not free. Unknown there
means surface yet unseen. Each ray stands for the wall area it would hit, rho^2 d_azimuth d_slope. A camera with a
90-degree field of view takes in a quarter of the azimuths, so that the gain of all yaws is a sliding sum over one
panorama. Surface that was seen, however far away, is not counted again: nearly all of it is within 5 cm of a pixel.

GainCache are remembered as the cell each ray meets. What a ray is worth is looked up anew at every decision; it is cast
anew only where the cell it met has changed since.

Some unknown can never be resolved: the inside of a hull with a slit, a cell that every view only grazes. What the robot
has looked straight at and still does not know is expected from clearly nearer only.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.types import FREE, UNKNOWN, Pose2

MAX_SLOPE = 0.95
"""Rise per metre of the steepest rays: just inside a 90-degree vertical field of view."""
NEAREST_M = 0.25
"""Rays begin this far from the camera's axis [m]: the robot's own body is free."""
BEYOND_M = 1.5
"""Surface is expected behind as much unknown as there is, at most this far behind where it begins [m]."""
MUCH_NEARER = 0.6
"""Unknown that a view left unknown counts again only from this share of that view's distance."""
CLEARLY_NEARER = 0.9
"""Trials from nearer than this share of the nearest one so far are noted."""
CAST_TOGETHER = 16_384
"""Rays followed at once: what they meet stays in the cache."""
MIN_ROWS = 256
"""Places that there is room for at first."""
MAX_ROWS = 32_768
"""Before more places than these are remembered, all are forgotten: they take 100 to 200 MB."""
NEVER_MET = -3
"""Stands for what a ray met before it was first cast: the state of no cell."""
PATCH_CELLS = 3
"""Edge of the patches in which views overlap [cells]."""


class GainCaster:
    """Casts panoramas of expected gain from places in the plane and remembers them."""

    def __init__(self, config: GvgConfig, camera_height_m: float):
        """Start without any panorama.

        Args:
            config: range and ray counts.
            camera_height_m: height that places are looked from [m].
        """
        self.config = config
        self.view = PooledOccupancy(config.gain_range_m + 1.0)
        self.camera_height_m = camera_height_m
        self.changed_xy_m: tuple[Float[np.ndarray, 2], Float[np.ndarray, 2]] | None = None
        """Corners of where panoramas may have changed since this was last set to None [m]."""
        self._num_rays = config.num_azimuths * config.num_elevations
        edges = np.linspace(-MAX_SLOPE, MAX_SLOPE, config.num_elevations + 1)
        self._slope = (edges[:-1] + edges[1:]) / 2
        self._ray_area_m2 = (math.tau / config.num_azimuths) * float(edges[1] - edges[0])
        self._epoch = -1
        self._distance_m = np.zeros(0, np.float32)
        self._offset = np.zeros((0, 0), np.int64)
        self._row_of = np.zeros(0, np.int32)
        """Row of each cell of the camera's layer in the memory; -1 where nothing was cast from there."""
        self._num_rows = 0
        self._base = np.zeros(0, np.int64)
        self._hit = np.zeros((0, self._num_rays), np.int32)
        self._reach = np.zeros((0, self._num_rays), np.uint8)
        self._depth = np.zeros((0, self._num_rays), np.uint8)
        self._met = np.zeros((0, self._num_rays), np.int8)

    def panoramas(self, places_xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n azimuths"]:
        """Expected new surface in each azimuth sector of each place [m2]."""
        shape = (len(places_xy_m), self.config.num_azimuths, self.config.num_elevations)
        return self.rays(places_xy_m)[1].reshape(shape).sum(axis=2, dtype=float)

    def rays(
        self, places_xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Int32[np.ndarray, "n rays"], Float32[np.ndarray, "n rays"]]:
        """For each ray of each place the cell it meets, as a flat index into the view grid, and its worth [m2].

        Rays are ordered by azimuth, then by elevation. A place stands for the cell that it lies in.
        """
        rows = self._cast_from(places_xy_m)
        return self._hit[rows], self._worth(rows)

    def expectation(
        self, place_xy_m: Float[np.ndarray, 2], sectors: Int[np.ndarray, " k"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"], float]:
        """What a view over some azimuth sectors would show of the unknown.

        Returns:
            The unknown cells by flat index, their distances [m], and the worth of the whole view [m2].
        """
        rows = self._cast_from(place_xy_m[None])
        rho_m = self._distance_m[self._reach[rows]]
        hit, worth, rho_m = (
            a.reshape(self.config.num_azimuths, -1)[sectors] for a in (self._hit[rows], self._worth(rows), rho_m)
        )
        counts = worth > 0.0
        return hit[counts].astype(np.int64), rho_m[counts].astype(float), float(worth.sum())

    def note_view(self, pose: Pose2, fov_rad: float = math.pi / 2) -> None:
        """Note what is still unknown in a view that the grid already holds, as tried from there.

        Args:
            pose: where the robot stands and looks along.
            fov_rad: horizontal field of view [rad].
        """
        (row,) = self._cast_from(pose.xy_m[None])
        azimuth = np.arange(self.config.num_azimuths) * math.tau / self.config.num_azimuths
        off_axis = np.abs(np.mod(azimuth - pose.yaw_rad + math.pi, math.tau) - math.pi)
        in_view = np.repeat(off_axis < fov_rad / 2, self.config.num_elevations)
        self.give_up(self._hit[row, in_view], self._distance_m[self._reach[row, in_view]])

    def give_up(self, cells: Int[np.ndarray, " n"], rho_m: Float[np.ndarray, " n"]) -> None:
        """Expect what is still unknown of some cells from clearly nearer than ``rho_m`` only.

        Args:
            cells: flat indices into the view grid.
            rho_m: distance they were looked at from, or should have been [m].
        """
        tried = self.view.tried_from_m.reshape(-1)
        news = (self.view.state.ravel()[cells] == UNKNOWN) & (rho_m < CLEARLY_NEARER * tried[cells])
        if not news.any():
            return
        np.minimum.at(tried, cells[news], rho_m[news].astype(np.float32))
        xy = self.view.centres(cells[news])[:, :2]
        self.note_change(xy.min(axis=0), xy.max(axis=0))

    def note_change(self, low_xy_m: Float[np.ndarray, 2], high_xy_m: Float[np.ndarray, 2]) -> None:
        """Note that the worth of rays between two corners in the plane has changed [m]."""
        if self.changed_xy_m is not None:
            low_xy_m = np.minimum(low_xy_m, self.changed_xy_m[0])
            high_xy_m = np.maximum(high_xy_m, self.changed_xy_m[1])
        self.changed_xy_m = low_xy_m, high_xy_m

    def patches(self, hit: Int32[np.ndarray, "*rays"]) -> Int[np.ndarray, "*rays"]:
        """The patch of space each cell belongs to: views that meet the same patches show the same things."""
        _, rows, cols = self.view.state.shape
        layer, rest = np.divmod(hit, rows * cols)
        row, col = np.divmod(rest, cols)
        return (
            layer // PATCH_CELLS * (rows // PATCH_CELLS + 1) + row // PATCH_CELLS
        ) * (cols // PATCH_CELLS + 1) + col // PATCH_CELLS  # fmt: skip

    def _cast_from(self, places_xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """Rows of places in the memory, with all rays as they are now."""
        self._follow_growth()
        rows = self._rows(self.view.flat_index(np.insert(places_xy_m, 2, self.camera_height_m, axis=1)))
        place, ray = np.nonzero(self.view.state.ravel()[self._hit[rows]] != self._met[rows])
        for begin in range(0, len(place), CAST_TOGETHER):
            some = slice(begin, begin + CAST_TOGETHER)
            self._cast(rows[place[some]], ray[some])
        return rows

    def _rows(self, base: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Rows of places in the memory, made where there are none."""
        cell = base % len(self._row_of)
        new = np.unique(cell[self._row_of[cell] < 0])
        if self._num_rows + len(new) > MAX_ROWS:
            self._forget()
            new = np.unique(cell)
        self._row_of[new] = np.arange(self._num_rows, self._num_rows + len(new))
        self._num_rows += len(new)
        if self._num_rows > len(self._base):
            capacity = max(2 * self._num_rows, MIN_ROWS)
            for name in ("_base", "_hit", "_reach", "_depth", "_met"):
                old = getattr(self, name)
                larger = np.full((capacity, *old.shape[1:]), NEVER_MET if name == "_met" else 0, old.dtype)
                larger[: len(old)] = old
                setattr(self, name, larger)
        rows = self._row_of[cell]
        self._base[rows] = base
        return rows

    def _cast(self, row: Int[np.ndarray, " n"], ray: Int[np.ndarray, " n"]) -> None:
        """Follow rays of places, given by row, to what they meet now."""
        cells = self._offset.take(ray, axis=0)
        cells += self._base[row, None]
        met = self.view.state.reshape(-1).take(cells)
        each = np.arange(len(row))
        first = (met != FREE).argmax(axis=1)
        what = met[each, first]
        self._hit[row, ray], self._reach[row, ray], self._met[row, ray] = cells[each, first], first, what
        # How far the unknown goes on behind: that tells a room from the back of a chair.
        unknown = np.flatnonzero(what == UNKNOWN)
        first = first[unknown]
        ends = (met[unknown] != UNKNOWN) & (np.arange(met.shape[1], dtype=np.uint8) > first.astype(np.uint8)[:, None])
        ends[:, -1] = True
        self._depth[row[unknown], ray[unknown]] = ends.argmax(axis=1) - first

    def _worth(self, rows: Int[np.ndarray, " n"]) -> Float32[np.ndarray, "n rays"]:
        """What the rays of places, given by row, would add [m2]."""
        worth = np.zeros((len(rows), self._num_rays), np.float32)
        place, ray = np.nonzero(self._met[rows] == UNKNOWN)
        at = rows[place], ray
        hit, rho = self._hit[at], self._distance_m[self._reach[at]]
        beyond = np.minimum(self._depth[at] * np.float32(self.view.cell_m), np.float32(BEYOND_M))
        squared = np.minimum(rho + beyond, np.float32(self.config.gain_range_m)) ** 2
        squared *= self.view.layer_share[hit // len(self._row_of)]
        squared[rho >= MUCH_NEARER * self.view.tried_from_m.ravel()[hit]] = 0.0
        worth[place, ray] = squared * np.float32(self._ray_area_m2)
        return worth

    def _follow_growth(self) -> None:
        """Lay the rays out in the array as it is now; what was remembered of another array is forgotten."""
        if self._epoch == self.view.epoch:
            return
        self._epoch = self.view.epoch
        layers, rows, cols = self.view.state.shape
        cell = self.view.cell_m
        rho_m = np.arange(NEAREST_M, self.config.gain_range_m, cell)
        azimuth = np.arange(self.config.num_azimuths) * math.tau / self.config.num_azimuths
        # From a cell's centre, so that a place may be anywhere in it.
        dx = np.rint(np.cos(azimuth)[:, None, None] * rho_m / cell)
        dy = np.rint(np.sin(azimuth)[:, None, None] * rho_m / cell)
        dz = np.rint(self._slope[None, :, None] * rho_m / cell)
        level = math.floor((self.camera_height_m - self.view.origin_m[2]) / cell)
        # Steep rays end in the floor's own layer or in the highest one there is.
        floor = max(math.floor(-self.view.origin_m[2] / cell), 0)
        dz = np.clip(dz, floor - level, layers - 1 - level)
        self._offset = ((dz * rows + dy) * cols + dx).astype(np.int64).reshape(self._num_rays, len(rho_m))
        self._distance_m = rho_m.astype(np.float32)
        self._row_of = np.full(rows * cols, -1, np.int32)
        self._forget()

    def _forget(self) -> None:
        """Begin the memory anew: what it held is written over, row by row."""
        self._row_of[:] = -1
        self._num_rows = 0
        self._met[:] = NEVER_MET


def view_sums(
    panoramas: Float[np.ndarray, "n azimuths"], fov_rad: float = math.pi / 2
) -> Float[np.ndarray, "n azimuths"]:
    """Gain of the views that begin at each azimuth and take in the next ones within the field of view."""
    n = panoramas.shape[1]
    width = max(round(fov_rad / math.tau * n), 1)
    total = np.cumsum(
        np.concatenate([np.zeros((len(panoramas), 1)), panoramas, panoramas[:, : width - 1]], axis=1), axis=1
    )
    return np.maximum(total[:, width:] - total[:, :-width], 0.0)
