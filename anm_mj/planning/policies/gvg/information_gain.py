"""Information gain: the new surface that a view from a place is expected to show.

A ray that ends in an unknown cell expects surface there, with the area of the ray: distance^2 d_azimuth d_slope.
A 90-degree view covers a quarter of the azimuths, so that the gains of all headings are a sliding sum over the gains of
the sectors. Surface that was seen, even from far away, brings no gain: nearly all of it lies within 5 cm of a pixel.

Some unknown cells can never be resolved: the inside of a hull with a slit, a cell that every view only grazes. When a
view covers a cell and the cell stays unknown, its gain is suppressed for all but clearly nearer places.

Once the robot works for the quality of its map, a ray that ends in known surface has gain too: the area of the ray
times the share by which a view improves it (:mod:`anm_mj.planning.policies.gvg.improvement`).

:class:`InformationGain` is the one owner of what changes gains (occupancy and suppression), of the area in which they
have changed, and of both caches: single rays, and gains per place.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from anm_mj import _native
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.binding import unbound_shares
from anm_mj.planning.policies.gvg.gain_cache import GainCache
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.improvement import ExpectedImprovement
from anm_mj.planning.policies.gvg.place_kinds import KINDS, PlaceKinds
from anm_mj.planning.policies.gvg.pooled_occupancy import POOL, PooledOccupancy
from anm_mj.planning.policies.gvg.ray_cache import RayCache, Rays
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS, Viewpoint, view_sectors
from anm_mj.types import OCCUPIED, UNKNOWN, OccupancyGrid, Pose2, SurfaceErrors
from anm_mj.utils.arrays import Window

TRIAL_STEP = 0.9
"""A view suppresses a cell again only from nearer than this share of the nearest distance so far."""
PATCH_CELLS = 3
"""Edge of the patches in which views overlap [cells]."""
RIM_M = 1.0
"""The occupancy ends this much farther away than rays are long [m]."""


@dataclass(frozen=True)
class ExpectedView:
    """What a view from one place is expected to show."""

    cells: Int[np.ndarray, " n"]
    """Unknown cells with gain, as flat indices into the occupancy."""
    distance_m: Float[np.ndarray, " n"]
    """Their distances [m]."""
    gain_m2: float
    """New surface in the whole view [m2]."""
    of_kind_m2: Float[np.ndarray, " kinds"]
    """The same for each of ``KINDS`` of places [m2]."""


@dataclass(frozen=True)
class PromisedRays:
    """The rays from one place that a target is expected to look along."""

    xy_m: Float[np.ndarray, "2"]
    """The place."""
    gain_m2: Float32[np.ndarray, " rays"]
    """New surface that each ray is expected to show, ordered as those of a place; 0 for the others [m2]."""


class InformationGain:
    """Computes expected gains of places, and keeps those that no change of the map has made stale."""

    def __init__(self, config: GvgConfig, camera: FieldOfView) -> None:
        """Start with an empty map; the robot's camera is the same at every place."""
        self._config = config
        self.camera = camera
        self.view_side = camera.side_sectors
        """A view covers its middle sector and this many on either side."""
        self._width_rad = camera.width_rad
        self.range_m = min(config.gain_range_m, camera.range_m)
        """A view is expected to show surface up to this distance [m]."""
        self.occupancy = PooledOccupancy(self.range_m + RIM_M)
        self._rays = RayCache(self.occupancy, camera=camera, range_m=self.range_m, num_elevations=config.num_elevations)
        self._cache = GainCache(config.candidate_spacing_m)
        self.place_kinds = PlaceKinds()
        self._yield_of_kind = np.ones(len(KINDS), np.float32)
        self._improvement: ExpectedImprovement | None = None
        """What views improve of known surface; None as long as only new surface counts."""
        self._changed: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]] | None = None
        """Corners of the area in which cells have changed or were suppressed since the cache was last read [m]."""

    @property
    def seen_m2(self) -> float:
        """Surface seen so far [m2]."""
        return self.occupancy.seen_m2

    def update(self, grid: OccupancyGrid, window: Window | None) -> None:
        """Take over a window in which the occupancy grid changed; gains in range of changes become stale."""
        changed = self.occupancy.update(grid, window)
        if changed is not None:
            self._note_change(*changed)

    def expect_yields(self, of_kind: Float32[np.ndarray, " kinds"]) -> None:
        """Expect of each kind of place this share of the surface that its rays cover."""
        if not np.array_equal(of_kind, self._yield_of_kind):
            self._yield_of_kind = of_kind
            self._note_change(np.full(2, -np.inf), np.full(2, np.inf))

    def improve(
        self, errors: SurfaceErrors, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, focal_px: float
    ) -> None:
        """Count from now on what views improve of surface that is known already.

        The errors are those within ``radius_m`` of a place; elsewhere, what was known before stays.
        """
        if self._improvement is None:
            self._improvement = ExpectedImprovement()
            self._note_change(np.full(2, -np.inf), np.full(2, np.inf))
        voxel_m = self.occupancy.cell_m / POOL
        self._improvement.update(errors, centre_xy_m, radius_m, focal_px=focal_px, voxel_m=voxel_m)
        self._note_change(centre_xy_m - radius_m, centre_xy_m + radius_m)

    def suppress_view(self, pose: Pose2, hidden: Bool[np.ndarray, " azimuths"] | None = None) -> None:
        """Suppress the cells that a view from a pose has left unknown; the map must hold that view already. Sectors of
        azimuth that something which moves was in front of are left as they are; None = there were none.
        """
        rays = self._rays.cast(pose.xy_m[None])
        # Sectors are headings, as the yaw is: a camera that looks aside has its rays as far beside them as its axis.
        azimuth = np.arange(NUM_AZIMUTHS) * math.tau / NUM_AZIMUTHS
        off_axis = np.abs(np.mod(azimuth - pose.yaw_rad + math.pi, math.tau) - math.pi)
        in_view = off_axis < self._width_rad / 2
        if hidden is not None:
            in_view &= ~hidden
        in_view = np.repeat(in_view, self._config.num_elevations)
        self.suppress(rays.hit[0, in_view], self._rays.distance_m[rays.sample[0, in_view]])

    def suppress(self, cells: Int[np.ndarray, " n"], distance_m: Float[np.ndarray, " n"]) -> None:
        """Expect those of some cells that are unknown only from clearly nearer than given distances.

        Cells are flat indices into the occupancy; ``distance_m`` is from how far a view had each in sight, or should
        have had it.
        """
        tried = self.occupancy.tried_from_m.reshape(-1)
        nearer = (self.occupancy.state.ravel()[cells] == UNKNOWN) & (distance_m < TRIAL_STEP * tried[cells])
        if not nearer.any():
            return
        np.minimum.at(tried, cells[nearer], distance_m[nearer].astype(np.float32))
        xy = self.occupancy.centres(cells[nearer])[:, :2]
        self._note_change(xy.min(axis=0), xy.max(axis=0))

    @property
    def tried(self) -> Float[np.ndarray, "n 4"]:
        """Centres of the cells that views have left unknown, and from how near the nearest of them looked [m]."""
        tried_m = self.occupancy.tried_from_m.reshape(-1)
        cells = np.flatnonzero(np.isfinite(tried_m) & (self.occupancy.state.reshape(-1) == UNKNOWN))
        return np.column_stack((self.occupancy.centres(cells), tried_m[cells]))

    def take_tried(self, tried: Float[np.ndarray, "n 4"]) -> None:
        """Expect as little of cells as a prior run did (:attr:`tried`); the map must hold that run already."""
        inside = self.occupancy.contains(tried[:, :3])
        self.suppress(self.occupancy.flat_index(tried[inside, :3]), tried[inside, 3])

    def sector_gains(
        self, places_xy_m: Float[np.ndarray, "n 2"], *, fresh: bool = False
    ) -> Float[np.ndarray, "n azimuths"]:
        """Expected new surface in each azimuth sector of places [m2], for their squares from the cache where possible.

        With ``fresh``, all gains are recomputed, at exactly these places.
        """
        if self._changed is not None:
            low, high = self._changed
            self._cache.invalidate(low - self._config.gain_range_m, high + self._config.gain_range_m)
            self._changed = None
        gain_m2, known = self._cache.lookup(places_xy_m)
        stale = ~known | fresh
        rays = self._rays.cast(places_xy_m[stale])
        shape = (len(rays.hit), NUM_AZIMUTHS, self._config.num_elevations)
        gain_m2[stale] = self._ray_gains(rays).reshape(shape).sum(axis=2, dtype=float)
        self._cache.store(places_xy_m[stale], gain_m2[stale])
        return gain_m2

    def best_view_gains(self, places_xy_m: Float[np.ndarray, "n 2"], *, fresh: bool = False) -> Float[np.ndarray, " n"]:
        """Gain of the best view at each place [m2]; see :meth:`sector_gains`."""
        return view_gains(self.sector_gains(places_xy_m, fresh=fresh), 2 * self.view_side + 1).max(axis=1)

    def ray_gains(
        self, places_xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Int[np.ndarray, "n rays"], Float32[np.ndarray, "n rays"]]:
        """For each ray of each place the patch of space that it hits and its gain [m2].

        Views that hit the same patches show the same surface. Rays are ordered by azimuth, then by elevation.
        """
        rays = self._rays.cast(places_xy_m)
        _, rows, cols = self.occupancy.state.shape
        layer, rest = np.divmod(rays.hit, rows * cols)
        row, col = np.divmod(rest, cols)
        patch = layer // PATCH_CELLS * (rows // PATCH_CELLS + 1) + row // PATCH_CELLS
        return patch * (cols // PATCH_CELLS + 1) + col // PATCH_CELLS, self._ray_gains(rays)

    def unbound_shares(
        self, places_xy_m: Float[np.ndarray, "n 2"], bound_share: float
    ) -> Float[np.ndarray, "n azimuths"]:
        """How little the view from each place along each sector binds the position; see :mod:`~.binding`."""
        rays = self._rays.cast(places_xy_m)
        distance_m = self._rays.distance_m[rays.sample]
        return unbound_shares(rays, distance_m, self.occupancy, side=self.view_side, bound_share=bound_share)

    def expected_view(self, viewpoint: Viewpoint) -> ExpectedView:
        """What the view from a viewpoint is expected to show."""
        rays = self._rays.cast(viewpoint.xy_m[None])
        sectors = (viewpoint.heading + view_sectors(self.view_side)) % NUM_AZIMUTHS
        hit, gain_m2, sample, depth = (
            a.reshape(NUM_AZIMUTHS, -1)[sectors] for a in (rays.hit, self._ray_gains(rays), rays.sample, rays.depth)
        )
        counts = gain_m2 > 0.0
        cells, distance_m = hit[counts].astype(np.int64), self._rays.distance_m[sample[counts]].astype(float)
        # Without any cell, bincount gives integers.
        of_kind = np.bincount(self._kinds(cells, depth[counts]), gain_m2[counts], len(KINDS)).astype(float)
        return ExpectedView(cells, distance_m, float(gain_m2.sum()), of_kind)

    def promise(self, xy_m: Float[np.ndarray, "2"], sectors: Bool[np.ndarray, " azimuths"]) -> PromisedRays:
        """What views from a place that cover some azimuth sectors are expected to show of new surface."""
        rays = self._rays.cast(xy_m[None])
        counts = (rays.state[0] == UNKNOWN) & np.repeat(sectors, self._config.num_elevations)
        return PromisedRays(xy_m, np.where(counts, self._ray_gains(rays)[0], np.float32(0.0)))

    def done_m2(self, promised: PromisedRays, looked: Bool[np.ndarray, " azimuths"] | None = None) -> float:
        """The part of what rays promised that was looked at [m2].

        That is what is expected of them no more, because it was seen, or because a view left it unknown; and all of the
        azimuth sectors ``looked`` at from the place itself.
        """
        # By the map as it is: a remembered ray goes on through what has turned up before the cell that it hit.
        rays = self._rays.cast_afresh(promised.xy_m)
        left_m2 = np.where(rays.state[0] == UNKNOWN, self._ray_gains(rays)[0], np.float32(0.0))
        if looked is not None:
            left_m2[np.repeat(looked, self._config.num_elevations)] = 0.0
        return float(np.maximum(promised.gain_m2 - left_m2, np.float32(0.0)).sum())

    def _ray_gains(self, rays: Rays) -> Float32[np.ndarray, "n rays"]:
        """Expected new surface of each ray [m2]."""
        occupancy, config = self.occupancy, self._config
        limits = config.max_unknown_depth_m, self.range_m, config.suppressed_share
        rule = np.array([occupancy.cell_m, *limits, self._rays.solid_angle], np.float32)
        gain_m2 = np.empty(rays.hit.shape, np.float32)
        # Zero where a ray does not end in the unknown.
        _native.ray_gains(*rays, self._rays.distance_m, occupancy.layer_share, occupancy.tried_from_m, rule, gain_m2)
        at = np.nonzero(gain_m2)
        gain_m2[at] *= self._yield_of_kind[self._kinds(rays.hit[at], rays.depth[at])]
        if self._improvement is not None:
            at = np.nonzero(rays.state == OCCUPIED)
            distance_m = self._rays.distance_m[rays.sample[at]]
            share = self._improvement.share(occupancy.centres(rays.hit[at]), distance_m)
            gain_m2[at] = share * distance_m**2 * np.float32(self._rays.solid_angle)
        return gain_m2

    def _kinds(self, cells: Int[np.ndarray, " n"], depth: UInt8[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
        """Kinds of the places of unknown cells that go on for so many cells along a ray."""
        return self.place_kinds.of(cells, depth * self.occupancy.cell_m >= self._config.max_unknown_depth_m)

    def _note_change(self, low_xy_m: Float[np.ndarray, "2"], high_xy_m: Float[np.ndarray, "2"]) -> None:
        """Extend the area in which cells have changed to a box [m]."""
        if self._changed is not None:
            low_xy_m = np.minimum(low_xy_m, self._changed[0])
            high_xy_m = np.maximum(high_xy_m, self._changed[1])
        self._changed = low_xy_m, high_xy_m


def view_gains(sector_gain_m2: Float[np.ndarray, "n azimuths"], width: int) -> Float[np.ndarray, "n azimuths"]:
    """Gain of the view that begins at each azimuth sector and covers ``width`` of them [m2]."""
    start = np.zeros((len(sector_gain_m2), 1))
    total = np.cumsum(np.concatenate([start, sector_gain_m2, sector_gain_m2[:, : width - 1]], axis=1), axis=1)
    return np.maximum(total[:, width:] - total[:, :-width], 0.0)
