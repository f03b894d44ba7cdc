"""How much of the true surface each new frame adds to what has been seen: the evaluation's measure, step by step.

:class:`~anm_mj.evaluation.coverage.Coverage` keeps the distance of every sample, for which it takes frames in batches.
A reward is due after every frame, but it only asks whether a sample is nearer than 5 cm; a sample that is can be left
out from then on. Both count the same samples (a test compares them).
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64
from scipy.spatial import KDTree

from anm_mj.evaluation.coverage import BOUND_SLACK, COVERED_M
from anm_mj.evaluation.depth import back_project_reduced, reduce_depth
from anm_mj.types import Intrinsics

_CELL_M = 0.1
"""Cell of the grid that pairs samples with points [m]; more than ``COVERED_M``, so that neighbours suffice."""
_PAD_CELLS = 2
"""Cells about the samples: points farther off than one are left out, and no neighbour of a cell lies outside."""


class SampleGrid:
    """Fixed samples of a surface by grid cell; what does not change from episode to episode."""

    def __init__(self, samples: Float32[np.ndarray, "n 3"]) -> None:
        """Sort the samples into cells; ``samples``: world [m]."""
        exact = samples.astype(np.float64)
        self._low = exact.min(axis=0) - _PAD_CELLS * _CELL_M
        self._shape = np.floor((exact.max(axis=0) - self._low) / _CELL_M).astype(np.int64) + 1 + _PAD_CELLS
        strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        self._to_neighbours = np.array(list(itertools.product((-1, 0, 1), repeat=3))) @ strides
        self.samples = exact
        _, self.cell = self.near(exact)

    def near(self, points: Float[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "k 3"], Int64[np.ndarray, " k"]]:
        """The points that may be near a sample, and their cells."""
        # One array per axis: numpy is slow at reducing the short axis of a long array.
        x, y, z = np.floor((points - self._low) * (1.0 / _CELL_M)).astype(np.int64).T
        x_end, y_end, z_end = self._shape - 1
        inside = (x >= 1) & (x < x_end) & (y >= 1) & (y < y_end) & (z >= 1) & (z < z_end)
        kept = np.flatnonzero(inside)
        return points[kept], ((x * self._shape[1] + y) * self._shape[2] + z)[kept]

    def around(self, cells: Int64[np.ndarray, " k"]) -> Bool[np.ndarray, " all_cells"]:
        """Which cells are among these or next to them."""
        marked = np.zeros(int(np.prod(self._shape)), dtype=bool)
        marked[(np.unique(cells)[:, None] + self._to_neighbours).ravel()] = True
        return marked


class SeenSurface:
    """Which samples of a surface have been seen since the start of an episode."""

    def __init__(self, grid: SampleGrid) -> None:
        """Nothing has been seen; ``grid`` may be shared."""
        self._grid = grid
        self._unseen = np.arange(len(grid.samples))

    @property
    def share(self) -> float:
        """Share of the samples that have been seen, in [0, 1]."""
        return 1.0 - len(self._unseen) / len(self._grid.samples)

    def add(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
    ) -> float:
        """Take in a frame.

        Args:
            depth_m: planar depth [m]; NaN where nothing was hit.
            intrinsics: of this image.
            T_world_camera: camera to world.

        Returns:
            Share of the samples that are nearer than 5 cm to a point of this frame and to none before, in [0, 1].
        """
        points, cells = self._grid.near(back_project_reduced(reduce_depth(depth_m), intrinsics, T_world_camera))
        sample_cells = self._grid.cell[self._unseen]
        candidates = np.flatnonzero(self._grid.around(cells)[sample_cells])
        # Most of a view has been seen before: its points are near no sample that is left, and need no place in a tree.
        points = points[self._grid.around(sample_cells[candidates])[cells]]
        if not (len(candidates) and len(points)):
            return 0.0
        tree = KDTree(points, balanced_tree=False, compact_nodes=False)
        samples = self._grid.samples[self._unseen[candidates]]
        distance_m, _ = tree.query(samples, distance_upper_bound=COVERED_M * BOUND_SLACK)
        seen = candidates[distance_m < COVERED_M]
        self._unseen = np.delete(self._unseen, seen)
        return len(seen) / len(self._grid.samples)
