"""What a view is expected to improve of surface that is known badly, as an area of surface.

A patch of surface whose map is off by the completion distance (5 cm) is worth as much as the same area of surface that
was never seen; one that is off by less is worth its share. A view takes away the part of the error that its pixels
average out: the map tells how far off each place is expected to be, how many pixels fell on it so far, and by which
power of that number the error falls (:class:`anm_mj.types.SurfaceErrors`). A place that was looked at often, or from
near, therefore has nothing to offer any more, and the search for improvement ends by itself.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from anm_mj.types import SurfaceErrors, thinning_stride

WORTH_UNSEEN_M = 0.05
"""Surface off by this much counts like surface that was never seen [m]."""
PATCH_M = 0.3
"""Errors are averaged over cubes of this edge [m]: rays sample the surface no finer."""
FRAMES_PER_VIEW = 16
"""Frames of a place that a view brings, with those from the way to it and of later views. With the 4 in which the place
stays in view while the robot turns and leaves, runs end 28 (standard error 14) steps earlier, with the same map (16
runs).
"""
OFFSET = 1 << 20
"""Added to the indices of cubes, so that none is negative."""


class ExpectedImprovement:
    """Remembers the errors of the surface and answers how much of them a view takes away."""

    def __init__(self) -> None:
        """Start without any surface."""
        self._voxel_px_m = 0.0
        """A voxel spans this many of the counted pixels at a depth of 1 m."""
        self._exponent = 0.0
        self._key = np.zeros(0, np.int64)
        self._worth = np.zeros(0, np.float32)
        self._count = np.zeros(0, np.float32)
        self._xy_m = np.zeros((0, 2))

    def update(
        self,
        errors: SurfaceErrors,
        centre_xy_m: Float[np.ndarray, "2"],
        radius_m: float,
        *,
        focal_px: float,
        voxel_m: float,
    ) -> None:
        """Replace what is known within ``radius_m`` of a place [m]. ``focal_px`` is the camera's; observations are
        counted on voxels of edge ``voxel_m``.
        """
        self._exponent = errors.exponent
        self._voxel_px_m = focal_px / thinning_stride(focal_px, errors.counted_focal_px) * voxel_m
        key, member, size = np.unique(_keys(errors.xyz_m.astype(float)), return_inverse=True, return_counts=True)
        worth = np.minimum(errors.error_m / np.float32(WORTH_UNSEEN_M), np.float32(1.0))
        mean = [np.bincount(member, v, len(key)) / np.maximum(size, 1) for v in (worth, errors.num_observations)]
        xy = np.stack([np.bincount(member, errors.xyz_m[:, i], len(key)) / np.maximum(size, 1) for i in (0, 1)], axis=1)
        far = np.linalg.norm(self._xy_m - centre_xy_m, axis=1) > radius_m
        # A cube on the rim may be among the old ones, too; the first one counts.
        merged, first = np.unique(np.concatenate([key, self._key[far]]), return_index=True)
        self._key = merged
        self._worth = np.concatenate([mean[0], self._worth[far]])[first].astype(np.float32)
        self._count = np.concatenate([mean[1], self._count[far]])[first].astype(np.float32)
        self._xy_m = np.concatenate([xy, self._xy_m[far]])[first]

    def share(self, xyz_m: Float[np.ndarray, "n 3"], distance_m: Float[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
        """Unseen surface that a view of surface is worth per area [m2 per m2]; 0 where no error is known."""
        if not len(self._key):
            return np.zeros(len(xyz_m), np.float32)
        key = _keys(xyz_m)
        row = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
        known: Bool[np.ndarray, " n"] = self._key[row] == key
        added = FRAMES_PER_VIEW * (self._voxel_px_m / np.maximum(distance_m, 0.1)) ** 2
        before = self._count[row] + 1.0
        left = (before / (before + added)) ** self._exponent
        return np.where(known, self._worth[row] * (1.0 - left), 0.0).astype(np.float32)


def _keys(xyz_m: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """A number for the cube that holds each point."""
    x, y, z = (np.floor(xyz_m / PATCH_M).astype(np.int64) + OFFSET).T
    return (x << 42) + (y << 21) + z
