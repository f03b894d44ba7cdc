"""How sure the map is by the evidence it has: how densely a place was looked at, and how usual its features are.

Two things are known about a point beside the map's answer there. One is the number of looks: pixels that fell on it,
of all frames; near, frontal and repeated views all add to it. The variance of what is learnt from n pixels falls as
1 / n, and of a place that was looked at n times, n^(1 - evenness) are trained on
(:class:`~anm_mj.mapping.config.ScheduleConfig`). The other is the posterior of the decoder's last layer (Laplace's
approximation; Daxberger et al., Laplace Redux, NeurIPS 2021): with phi the hidden features at a point and A their mean
outer product over all that was trained on, the variance of s is proportional to phi^T A^-1 phi. It is large where
features are unlike those that training has seen.

The product of the two is taken: the variance by the weights, over the pixels that speak for this place. Only its order
and ratios mean something, not its scale.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.ndimage import map_coordinates

from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.types import OCCUPIED

PRIOR_LOOKS = 0.1
"""Looks that a place counts for when it was never seen, so that the uncertainty there is large but finite."""
_NUM_PLACES = 1024
"""Places that the mean outer product is estimated from."""
_MIN_SPREAD = 1e-6
"""Axes along which the features' mean square is less than this share of the largest tell nothing and are left out."""
_MAX_VOXELS = 4_000_000
"""Voxels that looks are searched among, about."""


def evidence_variance(
    backend: MapperBackend, occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"], evenness: float
) -> Float32[np.ndarray, " n"]:
    """Variance of s at world points [m] by the looks at them and by their features, up to a constant factor.

    Args:
        backend: The engine that holds the parameters.
        occupancy: What was seen, and how densely.
        points_m: World points [m].
        evenness: As in the schedule that the map was trained by.
    """
    leverage = last_layer_variance(backend, occupancy, points_m, evenness)
    looks = PRIOR_LOOKS + look_density(occupancy, points_m)
    return (leverage / looks ** (1.0 - evenness)).astype(np.float32)


def look_density(occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """Looks per voxel at world points [m], interpolated between voxel centres; 0 outside the grid."""
    if not occupancy.num_hits.size:
        return np.zeros(len(points_m))
    voxels = points_m / occupancy.config.voxel_m - occupancy.corner
    return map_coordinates(occupancy.num_hits, voxels[:, ::-1].T, np.float64, order=1, mode="constant")


def last_layer_variance(
    backend: MapperBackend, occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"], evenness: float
) -> Float64[np.ndarray, " n"]:
    """Variance of s at world points [m] under the posterior of the SDF decoder's last layer, for one pixel.

    Its mean over all that was trained on is the number of axes along which the features vary.
    """
    hidden = backend.query_hidden(points_m).astype(np.float64)
    places = _trained_on(occupancy, evenness)
    if not len(places):
        return (hidden**2).sum(axis=1)
    seen = backend.query_hidden(places).astype(np.float64)
    spread, axes = np.linalg.eigh(seen.T @ seen / len(seen))
    telling = spread > _MIN_SPREAD * spread[-1]
    return ((hidden @ (axes[:, telling] / np.sqrt(spread[telling]))) ** 2).sum(axis=1)


def _trained_on(occupancy: OccupancyGrid, evenness: float) -> Float64[np.ndarray, "n 3"]:
    """Centres of occupied voxels in the world [m], at even intervals of what is trained on, in the grid's order."""
    # Of a large grid only some voxels are gone through; an odd interval takes them from all its rows and columns.
    every = occupancy.num_hits.size // _MAX_VOXELS | 1
    occupied = np.flatnonzero(occupancy.grid.state.reshape(-1)[::every] == OCCUPIED) * every
    if not len(occupied):
        return np.zeros((0, 3))
    looks = occupancy.num_hits.reshape(-1)[occupied].astype(np.float64)
    ends = np.cumsum(looks ** (1.0 - evenness))
    drawn = np.searchsorted(ends, (np.arange(_NUM_PLACES) + 0.5) * (ends[-1] / _NUM_PLACES))
    voxels = np.stack(np.unravel_index(occupied[drawn], occupancy.num_hits.shape), axis=1)[:, ::-1]
    return (voxels + occupancy.corner) * occupancy.config.voxel_m
