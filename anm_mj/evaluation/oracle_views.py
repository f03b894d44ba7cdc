"""What each view of a known scene would show: places times yaws, and the samples that they cover."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from anm_mj.evaluation.coverage import COVERED_M
from anm_mj.evaluation.pixel_rays import NUM_YAWS, PixelRays

STEEP = 0.76
"""Samples are counted for a place if their height above or below the camera is at most this share of their distance in
the plane, so that they are in the picture wherever in it their column is."""
NEAR_MISS_M = 0.25
"""A sample that a ray misses by less than this may be covered at another yaw [m]."""
FAR_M = 10.5
"""Samples farther than this in the plane are not looked for [m]; few pixels come near them."""


class Views:
    """Which samples are covered from which place at which yaw, and which of them nothing has covered so far.

    A yaw shows the directions within half the camera's angle of it: nine columns of 10 degrees for 90 degrees.

    Args:
        samples: Samples that are to be covered, world [m].
        places_m: Places to look from.
        rays: The camera.
    """

    def __init__(
        self, samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"], rays: PixelRays
    ) -> None:
        self._num_aside = len(rays.yaws_aside) // 2
        at_place, of_sample, column = [], [], []
        for place, xy_m in enumerate(places_m.astype(np.float32)):
            which, towards = _seen(samples, xy_m, rays)
            at_place.append(np.full(len(which), place, np.int32))
            of_sample.append(which)
            column.append(towards)
        place = np.concatenate(at_place) if at_place else np.zeros(0, np.int32)
        sample = np.concatenate(of_sample) if of_sample else np.zeros(0, np.int32)
        columns = np.concatenate(column) if column else np.zeros(0, np.int32)
        self._shape = (len(places_m), NUM_YAWS)
        order = np.argsort(sample, kind="stable")
        self._cells = (place * np.int32(NUM_YAWS) + columns)[order]
        """Place and column of every pair of place and sample, by sample."""
        self._first = np.searchsorted(sample[order], np.arange(len(samples) + 1))
        self._by_place = (sample, columns, np.searchsorted(place, np.arange(len(places_m) + 1)))
        self.coverable = np.zeros(len(samples), bool)
        """Which samples any of the views covers."""
        self.coverable[sample] = True

    def counts(self, wanted: Bool[np.ndarray, " n"]) -> Int[np.ndarray, "p yaws"]:
        """How many wanted samples each place has in each column of 10 degrees."""
        pairs = np.repeat(wanted, np.diff(self._first))
        return np.bincount(self._cells[pairs], minlength=self._shape[0] * NUM_YAWS).reshape(self._shape)

    def arc_gains(
        self, counts: Int[np.ndarray, "p yaws"], from_yaw: Int[np.ndarray, " p"]
    ) -> Int[np.ndarray, "p yaws"]:
        """How many of the counted samples each place shows while the camera turns from a yaw to each other yaw.

        The turn goes the shorter way; on it the picture sweeps over all columns between.
        """
        turn = (np.arange(NUM_YAWS)[None] - from_yaw[:, None] + NUM_YAWS // 2) % NUM_YAWS - NUM_YAWS // 2
        low = np.minimum(turn, 0) - self._num_aside
        columns = np.minimum(np.abs(turn) + 2 * self._num_aside + 1, NUM_YAWS)
        # Three times round, so that no sum has to begin anew at the seam.
        sums = np.concatenate([np.zeros((len(counts), 1), counts.dtype), np.cumsum(np.tile(counts, 3), axis=1)], axis=1)
        first = (from_yaw[:, None] + low) % NUM_YAWS
        return np.take_along_axis(sums, first + columns, axis=1) - np.take_along_axis(sums, first, axis=1)

    def covered(self, place: int, from_yaw: int, to_yaw: int) -> Int32[np.ndarray, " k"]:
        """The samples that one place shows while the camera turns from a yaw to another the shorter way."""
        sample, columns, first = self._by_place
        here = slice(first[place], first[place + 1])
        turn = (to_yaw - from_yaw + NUM_YAWS // 2) % NUM_YAWS - NUM_YAWS // 2
        low = from_yaw + min(turn, 0) - self._num_aside
        inside = (columns[here] - low) % NUM_YAWS <= abs(turn) + 2 * self._num_aside
        return sample[here][inside]

    def without(self, counts: Int[np.ndarray, "p yaws"], samples: Int[np.ndarray, " k"]) -> Int[np.ndarray, "p yaws"]:
        """Counts after some of the counted samples have been covered."""
        gone = np.zeros(len(self._first) - 1, bool)
        gone[samples] = True
        return counts - self.counts(gone)


def _seen(
    samples: Float32[np.ndarray, "n 3"], place_m: Float32[np.ndarray, "2"], rays: PixelRays
) -> tuple[Int32[np.ndarray, " k"], Int32[np.ndarray, " k"]]:
    """Samples covered by the pixel nearest to each when the camera looks towards it, and the yaws towards them."""
    delta = samples[:, :2] - place_m
    distance_m = np.hypot(delta[:, 0], delta[:, 1])
    near = (distance_m < FAR_M) & (np.abs(samples[:, 2] - rays.eye_z_m) <= STEEP * distance_m)
    which = np.flatnonzero(near).astype(np.int32)
    towards = rays.yaw_towards(delta[which])
    miss_m = np.full(len(which), np.inf)
    again = np.arange(len(which))
    # A robot turns and moves while it looks: what the pixels of one yaw just miss, those of the next one hit.
    for turn in rays.yaws_aside[np.argsort(np.abs(rays.yaws_aside), kind="stable")]:
        targets = samples[which[again]]
        places_m = np.broadcast_to(place_m, (len(again), 2))
        miss_m[again] = np.linalg.norm(
            rays.hits(targets, places_m, (towards[again] + turn) % NUM_YAWS) - targets, axis=1
        )
        again = again[(miss_m[again] >= COVERED_M) & (miss_m[again] < NEAR_MISS_M)]
    hit = miss_m < COVERED_M
    return which[hit], towards[hit]
