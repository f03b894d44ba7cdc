"""Uncertainty and expected error from the posterior of the decoder's last layer and from the observation count.

The observation count of a place is the number of pixels of all frames that fell on it; near, frontal and repeated views
all add to it. The variance of an estimate from n pixels falls as 1 / n, and training uses n^(1 - density_exponent) of
the n pixels of a place (``mapping.schedule``). The posterior of the last layer (Laplace's
approximation; Daxberger et al., Laplace Redux, NeurIPS 2021) gives the leverage: with phi the hidden features at a
point and A their mean outer product over the training data, the variance of s is proportional to phi^T A^-1 phi. It is
large where features are unlike those of the training data.

The uncertainty is the leverage over the number of pixels that training uses. Only order and ratios have a meaning, not
the scale.

How far the map's surface is expected to lie from the true one is a constant plus a power of it, fitted to the distance
between the zero-crossings and the true surface in three scenes after whole runs with the default preset
(``scripts/fit_expected_error.py``; docs/experiments/improvement.md). The constant stays, however often a place is
looked at. The rest falls as observations are added.
"""

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.ndimage import map_coordinates

from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.depth_occupancy import HIT_FOCAL_PX, DepthOccupancy
from anm_mj.types import OCCUPIED, SurfaceErrors

PRIOR_OBSERVATIONS = 0.1
"""Added to every observation count, so that the uncertainty is finite where nothing was observed."""
USUAL_VOXEL_M = 0.05
"""Observations count on surface as large as a face of such a voxel, by which the expected error was fitted [m]."""
SCALE_M = 0.0014
"""Reducible part of the expected error at a variance of 1 [m]."""
CONSTANT_M = np.float32(0.0018)
"""The part beside it that stays [m]."""
EXPONENT = 0.54
"""The reducible part grows with this power of the variance."""
_NUM_PLACES = 1024
"""Places that the mean outer product is estimated from."""
_MIN_SPREAD = 1e-6
"""Axes with less than this share of the largest mean square of the features carry no information and are left out."""
_MAX_VOXELS = 4_000_000
"""About how many voxels the places are chosen among."""


def last_layer_variance(
    backend: MapperBackend, occupancy: DepthOccupancy, points_m: Float[np.ndarray, "n 3"], density_exponent: float
) -> Float32[np.ndarray, " n"]:
    """Variance of s at world points [m] by leverage and observation count, up to a constant factor.
    ``density_exponent`` is that of the schedule that the map was trained by.
    """
    per_voxel = observation_density(occupancy, points_m)
    count = PRIOR_OBSERVATIONS + per_voxel * (USUAL_VOXEL_M / occupancy.config.voxel_m) ** 2
    return (leverage(backend, occupancy, points_m, density_exponent) / count ** (1.0 - density_exponent)).astype(
        np.float32
    )


def observation_density(occupancy: DepthOccupancy, points_m: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """Observations per voxel at world points [m], interpolated between voxel centres; 0 outside the grid."""
    if not occupancy.voxels.num_hits.size:
        return np.zeros(len(points_m))
    voxels = points_m / occupancy.config.voxel_m - occupancy.voxels.corner
    return map_coordinates(occupancy.voxels.num_hits, voxels[:, ::-1].T, np.float64, order=1, mode="constant")


def expected_errors(
    backend: MapperBackend, occupancy: DepthOccupancy, points_m: Float[np.ndarray, "n 3"], density_exponent: float
) -> SurfaceErrors:
    """The part of the expected error at surface points [m] that more observations can take away.

    It comes from the last-layer variance, whatever method the map is configured for: that predicts the error best.
    ``density_exponent`` is that of the schedule that the map was trained by.
    """
    variance = last_layer_variance(backend, occupancy, points_m, density_exponent)
    error_m = (SCALE_M * variance**EXPONENT).astype(np.float32)
    count = observation_density(occupancy, points_m).astype(np.float32)
    xyz_m, exponent = points_m.astype(np.float32, copy=False), (1.0 - density_exponent) * EXPONENT
    return SurfaceErrors(xyz_m, error_m, count, exponent, HIT_FOCAL_PX)


def leverage(
    backend: MapperBackend, occupancy: DepthOccupancy, points_m: Float[np.ndarray, "n 3"], density_exponent: float
) -> Float64[np.ndarray, " n"]:
    """Variance of s at world points [m] under the posterior of the SDF decoder's last layer, for one pixel.

    Its mean over the training data is the number of axes along which the features vary.
    """
    hidden = backend.query_hidden(points_m).astype(np.float64)
    places = _trained_on(occupancy, density_exponent)
    if not len(places):
        return (hidden**2).sum(axis=1)
    seen = backend.query_hidden(places).astype(np.float64)
    spread, axes = np.linalg.eigh(seen.T @ seen / len(seen))
    telling = spread > _MIN_SPREAD * spread[-1]
    return ((hidden @ (axes[:, telling] / np.sqrt(spread[telling]))) ** 2).sum(axis=1)


def _trained_on(occupancy: DepthOccupancy, density_exponent: float) -> Float64[np.ndarray, "n 3"]:
    """World centres of occupied voxels [m], at even intervals of the training data in the grid's order."""
    # A large grid is subsampled; an odd interval takes voxels from all rows and columns.
    every = occupancy.voxels.num_hits.size // _MAX_VOXELS | 1
    occupied = np.flatnonzero(occupancy.grid.state.reshape(-1)[::every] == OCCUPIED) * every
    if not len(occupied):
        return np.zeros((0, 3))
    count = occupancy.voxels.num_hits.reshape(-1)[occupied].astype(np.float64)
    ends = np.cumsum(count ** (1.0 - density_exponent))
    drawn = np.searchsorted(ends, (np.arange(_NUM_PLACES) + 0.5) * (ends[-1] / _NUM_PLACES))
    voxels = np.stack(np.unravel_index(occupied[drawn], occupancy.voxels.num_hits.shape), axis=1)[:, ::-1]
    return (voxels + occupancy.voxels.corner) * occupancy.config.voxel_m
