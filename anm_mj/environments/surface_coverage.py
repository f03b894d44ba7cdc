"""Incremental surface coverage: the new fraction of the true surface per frame, by the evaluation's measure.

:class:`~anm_mj.evaluation.completion.Coverage` keeps the distance of every sample and processes frames in batches. A
reward is due after every frame and only needs to know which samples are closer than 5 cm; covered samples drop out.
Both count the same samples (a test compares them).
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from anm_mj.evaluation.completion import COVERED_M
from anm_mj.evaluation.depth import back_project_reduced, reduce_depth
from anm_mj.evaluation.ground_truth_cache import cached_ground_truth
from anm_mj.evaluation.nearest import nearest_search
from anm_mj.evaluation.pixel_rays import CameraExtrinsics
from anm_mj.scene.folder import Scene
from anm_mj.types import Footprint, Intrinsics, Observation, Pose2

_CELL_M = 0.1
"""Cell size of the grid that pairs samples with points [m]; above ``COVERED_M``, so that adjacent cells suffice."""
_PAD_CELLS = 2
"""Cells around the samples: one for points near them, one so that every such cell has all its neighbours."""
_RUN_PX = 256
"""Width and height of a run's images: visibility is computed for these, whatever the size of an episode's images, so
that runs and episodes count the same samples."""


class SampleGrid:
    """Samples of a surface, sorted into the cells of a grid; episodes share it."""

    def __init__(self, samples: Float32[np.ndarray, "n 3"]) -> None:
        """Assign the samples, world [m], to cells."""
        exact = samples.astype(np.float64)
        self._low = exact.min(axis=0) - _PAD_CELLS * _CELL_M
        self._shape = np.floor((exact.max(axis=0) - self._low) / _CELL_M).astype(np.int64) + 1 + _PAD_CELLS
        strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        self._to_neighbours = np.array(list(itertools.product((-1, 0, 1), repeat=3))) @ strides
        self.samples = exact
        _, self.cell = self.near(exact)

    def near(self, points: Float[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "k 3"], Int64[np.ndarray, " k"]]:
        """The points that may be close to a sample, world [m], and their flat cell indices."""
        # One array per axis: numpy reduces the short axis of a long array slowly.
        x, y, z = np.floor((points - self._low) * (1.0 / _CELL_M)).astype(np.int64).T
        x_end, y_end, z_end = self._shape - 1
        inside = (x >= 1) & (x < x_end) & (y >= 1) & (y < y_end) & (z >= 1) & (z < z_end)
        kept = np.flatnonzero(inside)
        return points[kept], ((x * self._shape[1] + y) * self._shape[2] + z)[kept]

    def dilated(self, cells: Int64[np.ndarray, " k"]) -> Bool[np.ndarray, " all_cells"]:
        """Mask of these cells and their neighbours."""
        marked = np.zeros(int(np.prod(self._shape)), dtype=bool)
        seen = np.zeros(len(marked), dtype=bool)
        seen[cells] = True
        marked[(np.flatnonzero(seen)[:, None] + self._to_neighbours).ravel()] = True
        return marked


class IncrementalCoverage:
    """Covered samples of a surface since the start of an episode."""

    def __init__(self, grid: SampleGrid) -> None:
        """Start without coverage of the samples; episodes may share them."""
        self._grid = grid
        self._uncovered = np.arange(len(grid.samples))
        self._uncovered_cells = grid.cell

    @property
    def fraction(self) -> float:
        """Fraction of the samples covered so far, in [0, 1]."""
        return 1.0 - len(self._uncovered) / len(self._grid.samples)

    def add(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
    ) -> float:
        """Add a frame.

        Args:
            depth_m: planar depth [m]; NaN without a hit.
            intrinsics: of this image.
            T_world_camera: camera to world.

        Returns:
            Fraction of the samples that this frame is the first to cover within 5 cm, in [0, 1].
        """
        points, cells = self._grid.near(back_project_reduced(reduce_depth(depth_m), intrinsics, T_world_camera))
        candidates = np.flatnonzero(self._grid.dilated(cells)[self._uncovered_cells])
        if not len(candidates):
            return 0.0
        distance_m = np.full(len(candidates), COVERED_M)
        nearest_search(self._grid.samples[self._uncovered[candidates]]).lower(distance_m, points)
        covered = candidates[distance_m < COVERED_M]
        kept = np.ones(len(self._uncovered), np.bool_)
        kept[covered] = False
        self._uncovered, self._uncovered_cells = self._uncovered[kept], self._uncovered_cells[kept]
        return len(covered) / len(self._grid.samples)


def observable_surface(scene: Scene, footprint: Footprint, view: Observation, start: Pose2) -> SampleGrid:
    """The samples that are visible from the robot's reachable area, or all samples without Embree.

    The first call per scene and robot takes seconds; the user's cache folder keeps the result.

    Args:
        scene: the world.
        footprint: of the robot.
        view: any view with true poses; it tells the camera's pose on the robot.
        start: a pose in the reachable area.

    Raises:
        SceneError: the scene has no surface, or too little floor.
    """
    fov_y_rad = 2.0 * math.atan(view.intrinsics.height / 2.0 / view.intrinsics.fy)
    width = round(_RUN_PX * view.intrinsics.width / view.intrinsics.height)
    intrinsics = Intrinsics.from_fov(width, _RUN_PX, fov_y_rad)
    camera = CameraExtrinsics.of_view(intrinsics, view.T_world_camera, view.pose, view.range_m)
    truth = cached_ground_truth(scene, footprint, camera, start)
    return SampleGrid(truth.samples if truth.observable is None else truth.samples[truth.observable])
