"""Samples of a surface in the cells of a grid, which says which of them the points of a frame may come close to."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float32

CELL_M = 0.1
"""Side of a cell [m]; above ``COVERED_M``, so that adjacent cells suffice."""
_PAD_CELLS = 2
"""Cells around the samples: one for points near them, one so that every such cell has all its neighbours."""
_OPEN = 0x80
"""Of a cell with samples that are not covered (``native/sample_cells.h``)."""


class SampleGrid:
    """Samples of a surface, sorted by cell; episodes share it."""

    def __init__(self, samples: Float32[np.ndarray, "n 3"]) -> None:
        """Assign the samples, world [m], to cells."""
        exact = samples.astype(np.float64)
        self.low_m = exact.min(axis=0) - _PAD_CELLS * CELL_M
        """Corner of the first cell, world [m]."""
        x_y_z = np.floor((exact - self.low_m) * (1.0 / CELL_M)).astype(np.int64).T
        shape = np.floor((exact.max(axis=0) - self.low_m) / CELL_M).astype(np.int64) + 1 + _PAD_CELLS
        cell = np.asarray(np.ravel_multi_index(tuple(x_y_z), tuple(shape)))
        order = np.argsort(cell, kind="stable")
        self.samples = exact[order]
        """World, in the order of their cells [m]."""
        self.level = (cell[order] % shape[2]).astype(np.int32)
        """Index along z of each sample's cell."""
        self.column_start = np.searchsorted(cell[order] // shape[2], np.arange(shape[0] * shape[1] + 1))
        """Of each column of cells its first sample, and the number of all samples."""
        cells = np.unique(cell)
        num_near = np.zeros(int(np.prod(shape)), np.uint8)
        num_near[cells] = _OPEN
        for x, y, z in itertools.product((-1, 0, 1), repeat=3):
            num_near[cells + (x * shape[1] + y) * shape[2] + z] += 1
        self.num_near = num_near.reshape(shape)
        """Of each cell [x, y, z], how many of the 27 about it hold samples; ``_OPEN`` more where it does itself."""
