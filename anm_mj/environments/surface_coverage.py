"""Incremental surface coverage: the new fraction of the true surface per frame, by the evaluation's measure.

:class:`~anm_mj.evaluation.completion.Coverage` keeps the distance of every sample and processes frames in batches. A
reward is due after every frame and only needs to know which samples are closer than 5 cm; covered samples drop out.
Both count the same samples (a test compares them).
"""

import itertools
import math

import numpy as np
from jaxtyping import Float, Float32

from anm_mj import _native
from anm_mj.ground_truth.cache import cached_ground_truth
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.scene.folder import Scene
from anm_mj.types import Footprint, Intrinsics, Observation, Pose2

_RUN_PX = 256
"""Width and height of a run's images: visibility is computed for these, whatever the size of an episode's images, so
that runs and episodes count the same samples."""
_CELL_M = 0.1
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
        self.low_m = exact.min(axis=0) - _PAD_CELLS * _CELL_M
        """Corner of the first cell, world [m]."""
        x_y_z = np.floor((exact - self.low_m) * (1.0 / _CELL_M)).astype(np.int64).T
        shape = np.floor((exact.max(axis=0) - self.low_m) / _CELL_M).astype(np.int64) + 1 + _PAD_CELLS
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


class IncrementalCoverage:
    """Covered samples of a surface since the start of an episode (``native/sample_cells.h``)."""

    def __init__(self, grid: SampleGrid) -> None:
        """Start without coverage of the samples; episodes may share them."""
        self._grid = grid
        self._num_covered = 0
        self._covered = np.zeros(len(grid.samples), np.uint8)
        self._near = grid.num_near.copy()

    @property
    def fraction(self) -> float:
        """Fraction of the samples covered so far, in [0, 1]."""
        return self._num_covered / len(self._covered)

    def add(self, points: Float[np.ndarray, "m 3"]) -> float:
        """Add the points of a frame's reduced depth, world [m]. Returns the fraction of the samples that this frame is
        the first to cover within 5 cm, in [0, 1].
        """
        grid = self._grid
        new = _native.cover_samples(
            np.ascontiguousarray(points, np.float64),
            grid.samples,
            grid.level,
            grid.column_start,
            grid.low_m,
            _CELL_M,
            COVERED_M,
            self._covered,
            self._near,
        )
        self._num_covered += new
        return new / len(self._covered)


def observable_surface(scene: Scene, footprint: Footprint, view: Observation, start: Pose2) -> SampleGrid:
    """The samples that are visible from the robot's reachable area about ``start``, or all samples without Embree.

    The first call per scene and robot takes seconds; the user's cache folder keeps the result. ``view``, any view with
    true poses, tells the camera's pose on the robot. Raises SceneError if the scene has no surface, or too little
    floor.
    """
    fov_y_rad = 2.0 * math.atan(view.intrinsics.height / 2.0 / view.intrinsics.fy)
    width = round(_RUN_PX * view.intrinsics.width / view.intrinsics.height)
    intrinsics = Intrinsics.from_fov(width, _RUN_PX, fov_y_rad)
    camera = CameraExtrinsics.of_view(intrinsics, view.T_world_camera, view.pose, view.range_m)
    truth = cached_ground_truth(scene, footprint, camera, start)
    return SampleGrid(truth.samples if truth.observable is None else truth.samples[truth.observable])
