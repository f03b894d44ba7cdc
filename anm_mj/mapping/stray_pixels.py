"""Whether single pixels of a sensor stray: speckle, or pixels that fly at edges between two surfaces."""

import math

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from scipy.spatial import KDTree

from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.occupancy_kernels import VoxelArrays

_USUAL_FRAMES, _USUAL_SHARE = 3.0, 0.03
"""So many images, and this share of all, hold a pixel alone in space known to be free although the depth is exact:
none in three scenes, 2.5 % at most by poses that drift, and 8 to 40 % if one pixel in 3000 is speckle, or one in ten at
edges flies."""
_SURE_MISSES, _STRAY_RANGE_M = 10, 3.5
"""A pixel up to this depth [m] strays where so many frames more looked through its voxel than hit it: farther ones may
lie in a voxel beside theirs by noise that is no stray's."""
_ALONE_VOXELS = 3
"""A pixel is single if no other one of its image hits a voxel within so many along every axis."""


class Strays:
    """Whether a sensor's images hold pixels that lie where nothing is: speckle, or edges that fly.

    Such a pixel is off by any amount, which no standard deviation tells. It shows where space is known to be free, and
    by lying there alone: a wrong pose puts whole surfaces there.
    """

    def __init__(self) -> None:
        self._num_images = 0
        self._num_straying = 0

    @property
    def are_known(self) -> bool:
        """Whether more images hold such pixels than those of an exact sensor do."""
        return self._num_straying > _USUAL_FRAMES + _USUAL_SHARE * self._num_images

    def add(self, strays: bool) -> None:
        """Take in one image, by whether a pixel of it lies alone in space known to be free before."""
        self._num_images += 1
        self._num_straying += strays

    def array(self) -> Float64[np.ndarray, "2"]:
        """Numbers of images, and of those with such pixels."""
        return np.array([self._num_images, self._num_straying], np.float64)

    def set_array(self, array: Float64[np.ndarray, "2"]) -> None:
        """Take over what :meth:`array` gave."""
        self._num_images, self._num_straying = int(array[0]), int(array[1])


def is_straying(
    voxels: VoxelArrays, config: OccupancyConfig, places: Int64[np.ndarray, "n 3"], depth_m: Float32[np.ndarray, " n"]
) -> bool:
    """Whether a single pixel, from near enough to tell, hit a voxel known to be free before. Surface is hit by many
    side by side: where such are in free space, the pose is wrong, or something moved. ``places`` are the voxels that
    pixels of an image hit, by x, y, z, and ``depth_m`` is that of these pixels [m].
    """
    near = np.flatnonzero(depth_m < _STRAY_RANGE_M)
    inside, cells = voxels.cells_of(places[near])
    doubted = near[inside][voxels.log_odds[cells] <= -_SURE_MISSES * config.miss]
    # On surface, the pixel before or after lies next to it, as a rule: that spares the search among all.
    beside = [np.abs(places[doubted] - places[(doubted + side) % len(places)]).max(axis=1) for side in (-1, 1)]
    alone = places[doubted[np.minimum(*beside) > _ALONE_VOXELS]]
    return bool(len(alone) and _are_single(alone, places).any())


def are_single_outside(
    voxels: VoxelArrays, places: Int64[np.ndarray, "n 3"], apart: Float32[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Which pixels of an image hit voxels (``places``, by x, y, z) outside of the grid, with no other pixel of it
    nearby; ``apart`` is how far from each the next one hits a surface that faces the camera [voxels].
    """
    inside, _ = voxels.cells_of(places)
    single = ~inside
    if single.any():
        single[single] = _are_single(places[single], places, 2.0 * apart[single])
    return single


def _are_single(
    some: Int64[np.ndarray, "k 3"], places: Int64[np.ndarray, "n 3"], apart: Float32[np.ndarray, " k"] | float = 0.0
) -> Bool[np.ndarray, " k"]:
    """Which of some voxels that pixels hit have no hit of another pixel nearby, or as near as ``apart`` [voxels]."""
    away, _ = KDTree(places).query(some, k=2, p=math.inf)
    return np.asarray(away)[:, 1] > np.maximum(apart, _ALONE_VOXELS + 0.5)  # Each finds itself first.
