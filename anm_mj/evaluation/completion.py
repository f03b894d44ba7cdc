"""Completion: how much of the true surface the depth images have covered so far (the paper's protocol).

Every sample of the true surface keeps its distance to the nearest back-projected depth point of any frame. The
completion ratio is the share of samples nearer than 5 cm; completion is the mean distance, each capped at 1 m.

Frames are searched in batches, because the minimum over frames of the distance to a frame is the distance to their
union. A batch can only change samples that lie nearer to it than their present distance. A coarse grid around the batch
bounds that distance from below for all samples at once, so only few samples need a nearest-neighbour search, and their
present distance bounds each search. The distances equal those of a full search to the last digit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt16
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from anm_mj.evaluation.depth import back_project_reduced
from anm_mj.types import Intrinsics
from anm_mj.utils.threads import usual_num_threads

COVERED_M = 0.05
"""A sample nearer than this to a seen point counts as seen [m] (paper, section V-B)."""
CAP_M = 1.0
"""Cap of each sample's distance in the mean [m] (paper's protocol)."""
BATCH_FRAMES = 10
"""Frames per batch; larger batches delay results, smaller ones build more trees."""
GRID_CELL_M = 0.25
"""Cell of the pruning grid [m]; finer prunes more and costs more to fill."""
SEARCH_BOUNDS_M = (0.005, 0.01, 0.02, 0.05, 0.2, CAP_M)
"""Upper bounds of the present distances in each group of samples [m]; the tree takes one bound per search."""
LEAF_SIZE = 40
"""Points per leaf of the tree; a tree serves few searches, so its construction counts as well."""
MANY_SAMPLES = 3000
"""From so many on a search is worth the start of threads."""
BOUND_SLACK = 1.0 + 1e-9
"""Relative slack of search bounds: the tree compares squares, and rounding must not hide a neighbour at the bound."""


@dataclass(frozen=True)
class Completion:
    """Completion of the true surface."""

    ratio_percent: float
    """Share of the samples nearer than 5 cm to a depth point [%]."""
    completion_cm: float
    """Mean distance of the samples to the nearest depth point, each capped at 1 m [cm]."""
    observable_ratio_percent: float | None
    """The ratio among the observable samples alone [%]; None if these are not known."""


class DistanceBound:
    """Lower bounds on the distances of fixed samples to any cloud of points, from a coarse grid."""

    def __init__(self, samples: Float[np.ndarray, "n 3"]) -> None:
        self._low = samples.min(axis=0)
        self._shape = tuple(np.floor((samples.max(axis=0) - self._low) / GRID_CELL_M).astype(int) + 1)
        self.cell = self._cells(samples)

    def _cells(self, points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        # Moving a point to the grid's border brings it nearer to every sample, so the bound stays a lower bound.
        index = np.floor((points - self._low) / GRID_CELL_M).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(index.T), self._shape, mode="clip"))

    def per_cell(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " cells"]:
        """Lower bound on the distance between anything in a cell and the points, for every cell [m]."""
        empty = np.ones(self._shape, dtype=bool)
        empty.ravel()[self._cells(points)] = False
        between_centres = distance_transform_edt(empty, sampling=GRID_CELL_M)
        return np.maximum(np.asarray(between_centres).ravel() - np.sqrt(3.0) * GRID_CELL_M, 0.0)


class Coverage:
    """Running completion of a true surface by depth frames.

    Args:
        samples: Samples of the true surface, world [m].
        observable: Which of them are observable, if known.
        before_m: Distance of each to the nearest point of earlier frames [m], where there were any.
    """

    REBUILT = ("_order", "_samples", "_cell", "_bound", "_observable", "_distance_m", "_pending")

    def __init__(
        self,
        samples: Float32[np.ndarray, "n 3"],
        observable: Bool[np.ndarray, " n"] | None = None,
        before_m: Float32[np.ndarray, " n"] | None = None,
    ) -> None:
        exact = samples.astype(np.float64)
        bound = DistanceBound(exact)
        # Neighbouring samples are searched in a row, so that the tree's nodes stay in the processor's cache.
        self._order = np.argsort(bound.cell, kind="stable")
        self._samples = exact[self._order]
        self._cell = bound.cell[self._order]
        self._bound = bound
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
        """Add a frame of :func:`~anm_mj.evaluation.depth.reduce_depth`.

        Args:
            depth_mm: Reduced depth [mm].
            intrinsics: Of the original, unreduced image.
            T_world_camera: Camera to world, CV axes.
        """
        self.add_points(back_project_reduced(depth_mm, intrinsics, T_world_camera))

    def add_points(self, points_world: Float[np.ndarray, "m 3"]) -> None:
        """Add the depth points of a frame, world [m]."""
        self._pending.append(points_world)
        if len(self._pending) >= BATCH_FRAMES:
            self._search()

    def checkpoint_state(self) -> dict[str, Any]:
        """Distances and frames not searched yet, for a checkpoint."""
        return {"distance_m": self._distance_m, "pending": self._pending}

    def restore_state(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`checkpoint_state` gave, for the same samples."""
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
        present_m = np.minimum(self._distance_m, CAP_M)
        improvable = self._bound.per_cell(points)[self._cell] < present_m
        tree: KDTree | None = None
        lower_m = 0.0
        for upper_m in SEARCH_BOUNDS_M:
            group = np.flatnonzero(improvable & (present_m > lower_m) & (present_m <= upper_m))
            lower_m = upper_m
            if len(group) == 0:
                continue
            if tree is None:
                tree = KDTree(points, leafsize=LEAF_SIZE, balanced_tree=False, compact_nodes=False)
            # Samples are searched one by one, so that the distances do not depend on the number of threads.
            threads = usual_num_threads() if len(group) >= MANY_SAMPLES else 1
            bound_m = upper_m * BOUND_SLACK
            found_m, _ = tree.query(self._samples[group], distance_upper_bound=bound_m, workers=threads)
            self._distance_m[group] = np.minimum(self._distance_m[group], np.where(found_m < CAP_M, found_m, np.inf))


def _percent(flags: Bool[np.ndarray, " n"]) -> float:
    return 100.0 * float(np.mean(flags)) if len(flags) else 0.0


def uncapped_completion_cm(
    samples: Float32[np.ndarray, "n 3"],
    distance_m: Float[np.ndarray, " n"],
    clouds: Iterable[Float[np.ndarray, "m 3"]],
    before_m: Float32[np.ndarray, " n"] | None = None,
) -> float | None:
    """Completion without the cap at 1 m, recomputed from all frames [cm]; None without any depth point.

    Args:
        samples: Samples of the true surface, world [m].
        distance_m: Their distances below 1 m, infinite elsewhere, as :class:`~anm_mj.evaluation.completion.Coverage`
            has them.
        clouds: The depth points of every frame, world [m].
        before_m: Distances to the depth points of earlier runs [m], where there were any.
    """
    far = np.flatnonzero(np.isinf(distance_m))
    full_m = distance_m.copy()
    if len(far):
        full_m[far] = nearest_m(samples[far].astype(np.float64), clouds)
        if before_m is not None:
            full_m[far] = np.minimum(full_m[far], before_m[far])
    mean_m = float(np.mean(full_m))
    return 100.0 * mean_m if np.isfinite(mean_m) else None


def nearest_m(points: Float[np.ndarray, "n 3"], clouds: Iterable[Float[np.ndarray, "m 3"]]) -> Float[np.ndarray, " n"]:
    """Distance of points to the nearest point of any cloud [m]; infinite where there is none."""
    bound = DistanceBound(points)
    nearest = np.full(len(points), np.inf)
    remaining = iter(clouds)
    while batch := list(islice(remaining, BATCH_FRAMES)):
        seen = np.concatenate(batch)
        if len(seen) == 0:
            continue
        improvable = np.flatnonzero(bound.per_cell(seen)[bound.cell] < nearest)
        if len(improvable):
            tree = KDTree(seen, balanced_tree=False, compact_nodes=False)
            found_m, _ = tree.query(points[improvable], workers=usual_num_threads())
            nearest[improvable] = np.minimum(nearest[improvable], found_m)
    return nearest
