"""Which samples of a surface the points of a frame come close to, frame after frame; covered samples drop out."""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, Int64, UInt8

from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.nearest import nearest_search
from anm_mj.utils.native_functions import native_function

_CELL_M = 0.1
"""Cell size of the grid that pairs samples with points [m]; above ``COVERED_M``, so that adjacent cells suffice."""
_PAD_CELLS = 2
"""Cells around the samples: one for points near them, one so that every such cell has all its neighbours."""
_OPEN = 0x80
"""Of a cell with samples that are not covered (``native/sample_cells.h``)."""


class SampleGrid:
    """Samples of a surface, sorted into the cells of a grid; episodes share it."""

    def __init__(self, samples: Float32[np.ndarray, "n 3"]) -> None:
        """Assign the samples, world [m], to cells."""
        exact = samples.astype(np.float64)
        self.low_m = exact.min(axis=0) - _PAD_CELLS * _CELL_M
        """Corner of the first cell, world [m]."""
        self.shape = np.floor((exact.max(axis=0) - self.low_m) / _CELL_M).astype(np.int64) + 1 + _PAD_CELLS
        """Cells along x, y and z."""
        strides = np.array([self.shape[1] * self.shape[2], self.shape[2], 1])
        self._to_neighbours = np.array(list(itertools.product((-1, 0, 1), repeat=3))) @ strides
        _, cell = self.near(exact)
        order = np.argsort(cell, kind="stable")
        self.samples = exact[order]
        """World, in the order of their cells [m]."""
        self.cell = cell[order]
        """Flat cell index of each sample."""

    def near(self, points: Float[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "k 3"], Int64[np.ndarray, " k"]]:
        """The points that may be close to a sample, world [m], and their flat cell indices."""
        # One array per axis: numpy reduces the short axis of a long array slowly.
        x, y, z = np.floor((points - self.low_m) * (1.0 / _CELL_M)).astype(np.int64).T
        x_end, y_end, z_end = self.shape - 1
        inside = (x >= 1) & (x < x_end) & (y >= 1) & (y < y_end) & (z >= 1) & (z < z_end)
        kept = np.flatnonzero(inside)
        return points[kept], ((x * self.shape[1] + y) * self.shape[2] + z)[kept]

    def dilated(self, cells: Int64[np.ndarray, " k"]) -> Bool[np.ndarray, " all_cells"]:
        """Mask of these cells and their neighbours."""
        marked = np.zeros(int(np.prod(self.shape)), dtype=bool)
        seen = np.zeros(len(marked), dtype=bool)
        seen[cells] = True
        marked[(np.flatnonzero(seen)[:, None] + self._to_neighbours).ravel()] = True
        return marked

    @cached_property
    def level(self) -> Int32[np.ndarray, " n"]:
        """Index along z of each sample's cell."""
        return (self.cell % self.shape[2]).astype(np.int32)

    @cached_property
    def column_start(self) -> Int64[np.ndarray, " columns_and_one"]:
        """Of each column of cells its first sample, and the number of all samples."""
        return np.searchsorted(self.cell // self.shape[2], np.arange(self.shape[0] * self.shape[1] + 1))

    @cached_property
    def num_near(self) -> UInt8[np.ndarray, "x y z"]:
        """How many of the 27 cells about each cell hold samples, and ``_OPEN`` more where it does itself."""
        counts = np.zeros(int(np.prod(self.shape)), np.uint8)
        cells = np.unique(self.cell)
        counts[cells] = _OPEN
        for offset in self._to_neighbours:
            counts[cells + offset] += 1
        return counts.reshape(self.shape)


class ScipyCovering:
    """The samples that no frame covered yet, with NumPy and SciPy."""

    def __init__(self, grid: SampleGrid) -> None:
        """Start without coverage of the samples; others may share them."""
        self._grid = grid
        self._uncovered = np.arange(len(grid.samples))
        self._uncovered_cells = grid.cell

    def add(self, points: Float[np.ndarray, "m 3"]) -> int:
        """Cover what is closer than ``COVERED_M`` to one of these points, world [m], and say how much of it is new."""
        points, cells = self._grid.near(points)
        candidates = np.flatnonzero(self._grid.dilated(cells)[self._uncovered_cells])
        if not len(candidates):
            return 0
        distance_m = np.full(len(candidates), COVERED_M)
        nearest_search(self._grid.samples[self._uncovered[candidates]]).lower(distance_m, points)
        covered = candidates[distance_m < COVERED_M]
        kept = np.ones(len(self._uncovered), np.bool_)
        kept[covered] = False
        self._uncovered, self._uncovered_cells = self._uncovered[kept], self._uncovered_cells[kept]
        return len(covered)


class NativeCovering:
    """The same in C++ (``native/sample_cells.h``): points look into the few cells about them that hold such samples."""

    def __init__(self, grid: SampleGrid) -> None:
        """Start without coverage of the samples; others may share them."""
        function = native_function("cover_samples")
        assert function is not None  # Who chose it has looked.
        self._cover = function
        self._grid = grid
        self._covered = np.zeros(len(grid.samples), np.uint8)
        self._near = grid.num_near.copy()

    def add(self, points: Float[np.ndarray, "m 3"]) -> int:
        """Cover what is closer than ``COVERED_M`` to one of these points; see the reference."""
        return self._cover(
            np.ascontiguousarray(points, np.float64),
            self._grid.samples,
            self._grid.level,
            self._grid.column_start,
            self._grid.low_m,
            _CELL_M,
            COVERED_M,
            self._covered,
            self._near,
        )


def start_covering(grid: SampleGrid) -> ScipyCovering | NativeCovering:
    """Covering of samples from none on: the native one where it was built, else SciPy's."""
    return ScipyCovering(grid) if native_function("cover_samples") is None else NativeCovering(grid)
