"""Completion: how much of the true surface the depth images have covered so far (the paper's protocol).

Every sample of the true surface keeps its distance to the nearest back-projected depth point of any frame. The
completion ratio is the share of samples nearer than 5 cm; completion is the mean distance, each capped at 1 m.

Frames are searched in batches, because the minimum over frames of the distance to a frame is the distance to their
union. The distances equal those of a full search to the last digit (:mod:`anm_mj.ground_truth.nearest`).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt16

from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.nearest import NearestSearch, spatial_order
from anm_mj.ground_truth.reduced_depth import back_project_reduced
from anm_mj.types import Intrinsics

CAP_M = 1.0
"""Cap of each sample's distance in the mean [m] (paper's protocol)."""
BATCH_FRAMES = 10
"""Frames per batch: as many as steps between two rows of the curve. Smaller ones look at all samples more often."""


@dataclass(frozen=True)
class Completion:
    """Completion of the true surface: the share of its samples nearer than 5 cm to a depth point [%], the same among
    the observable ones (None if these are not known), and their mean distance to the nearest, each capped at 1 m [cm].
    """

    ratio_percent: float
    completion_cm: float
    observable_ratio_percent: float | None


class Coverage:
    """Running completion of a true surface, given by samples in the world [m], by depth frames.

    ``observable`` are those that are, if known, ``before_m`` the distance of each to the nearest point of earlier
    frames [m], if there were any. The distances do not depend on the number of threads, None = as many as usual.
    """

    REBUILT = ("_order", "_nearest", "_observable", "_distance_m", "_pending")

    def __init__(
        self,
        samples: Float32[np.ndarray, "n 3"],
        observable: Bool[np.ndarray, " n"] | None = None,
        before_m: Float32[np.ndarray, " n"] | None = None,
        num_threads: int | None = None,
    ) -> None:
        exact = samples.astype(np.float64)
        self._order = spatial_order(exact)
        self._nearest = NearestSearch(exact[self._order], num_threads)
        self._observable = observable
        self._distance_m = np.full(len(samples), np.inf)
        if before_m is not None:
            ordered_m = before_m[self._order].astype(np.float64)
            self._distance_m = np.where(ordered_m < CAP_M, ordered_m, np.inf)
        self._pending: list[Float[np.ndarray, "m 3"]] = []

    def add(
        self,
        depth_mm: UInt16[np.ndarray, "rows cols"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
    ) -> None:
        """Add a frame of :func:`~anm_mj.ground_truth.reduced_depth.reduce_depth`. ``intrinsics`` are those of the
        original, unreduced image; camera axes are CV.
        """
        self.add_points(back_project_reduced(depth_mm, intrinsics, T_world_camera))

    def add_points(self, points_world: Float[np.ndarray, "m 3"]) -> None:
        """Add the depth points of a frame, world [m]."""
        self._pending.append(points_world)
        if len(self._pending) >= BATCH_FRAMES:
            self._search()

    def get_state(self) -> dict[str, Any]:
        """Distances and frames not searched yet, for a checkpoint."""
        return {"distance_m": self._distance_m, "pending": self._pending}

    def set_state(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`get_state` gave, for the same samples."""
        self._distance_m, self._pending = state["distance_m"], state["pending"]

    def completion(self) -> Completion:
        """Completion by all frames so far."""
        distance_m = self.distance_m
        covered = distance_m < COVERED_M
        return Completion(
            ratio_percent=100.0 * float(np.mean(covered)),
            completion_cm=100.0 * float(np.mean(np.minimum(distance_m, CAP_M))),
            observable_ratio_percent=None if self._observable is None else _percent(covered[self._observable]),
        )

    @property
    def distance_m(self) -> Float[np.ndarray, " n"]:
        """Distance of every sample to the nearest depth point [m]; infinite from 1 m on."""
        self._search()
        distance_m = np.empty_like(self._distance_m)
        distance_m[self._order] = self._distance_m
        return distance_m

    def _search(self) -> None:
        points = np.concatenate(self._pending) if self._pending else np.empty((0, 3))
        self._pending = []
        if len(points) == 0:
            return
        capped_m = np.minimum(self._distance_m, CAP_M)
        self._nearest.lower(capped_m, points)
        self._distance_m = np.where(capped_m < CAP_M, capped_m, np.inf)


def _percent(flags: Bool[np.ndarray, " n"]) -> float:
    return 100.0 * float(np.mean(flags)) if len(flags) else 0.0


def uncapped_completion_cm(
    samples: Float32[np.ndarray, "n 3"],
    distance_m: Float[np.ndarray, " n"],
    clouds: Iterable[Float[np.ndarray, "m 3"]],
    before_m: Float32[np.ndarray, " n"] | None = None,
) -> float | None:
    """Completion without the cap at 1 m [cm], recomputed from the depth points of every frame, world [m]; None without
    any. The samples, their distances and ``before_m`` are those of :class:`Coverage`.
    """
    full_m = uncapped_m(samples, distance_m, clouds)
    mean_m = float(np.mean(full_m if before_m is None else np.minimum(full_m, before_m)))
    return 100.0 * mean_m if np.isfinite(mean_m) else None


def uncapped_m(
    samples: Float32[np.ndarray, "n 3"], distance_m: Float[np.ndarray, " n"], clouds: Iterable[Float[np.ndarray, "m 3"]]
) -> Float[np.ndarray, " n"]:
    """The distances of :class:`Coverage` also from 1 m on [m]; infinite without any depth point of every frame."""
    full_m, far = distance_m.copy(), np.flatnonzero(np.isinf(distance_m))
    if not len(far):
        return full_m
    points = samples[far].astype(np.float64)
    order = spatial_order(points)
    search, found_m = NearestSearch(points[order]), np.full(len(far), np.inf)
    remaining = iter(clouds)
    while batch := list(islice(remaining, BATCH_FRAMES)):
        search.lower(found_m, np.concatenate(batch))
    full_m[far[order]] = found_m
    return full_m
