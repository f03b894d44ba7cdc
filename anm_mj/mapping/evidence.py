"""How sure the map is by the evidence it has: how densely a place was looked at, and how usual its features are.

Two things are known about a point beside the map's answer there. One is the number of looks: pixels that fell on it,
of all frames; near, frontal and repeated views all add to it. The variance of what is learnt from n looks falls as
1 / n. The other is the posterior of the decoder's last layer (Laplace's approximation; Daxberger et al., Laplace
Redux, NeurIPS 2021): with phi the hidden features at a point and A their mean outer product over all looks, the
variance of s is proportional to phi^T A^-1 phi. It is large where features are unlike those that training has seen.
Of A only the principal axes are kept: four rank real scenes as well as all 32 do, at an eighth of the price.

The product of the two is taken: the variance by the weights, over the looks that speak for this place. Only its order
and ratios mean something, not its scale.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.ndimage import map_coordinates

from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.field import DECODER_NAMES
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.types import OCCUPIED

PRIOR_LOOKS = 0.1
"""Looks that a place counts for when it was never seen, so that the uncertainty there is large but finite."""
_NUM_PLACES = 1024
"""Looks that the mean outer product is estimated from."""
_NUM_AXES = 4
"""Principal axes of it that are kept."""
_MIN_SPREAD = 1e-6
"""Axes along which the features' mean square is less than this share of the largest tell nothing and are left out."""
_CHUNK = 16384
"""Points per call to the engine, so that the outputs for all features stay small."""


def evidence_variance(
    backend: MapperBackend, occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"]
) -> Float32[np.ndarray, " n"]:
    """Variance of s at world points [m] by the looks at them and by their features, up to a constant factor."""
    leverage = last_layer_variance(backend, occupancy, points_m)
    return (leverage / (PRIOR_LOOKS + look_density(occupancy, points_m))).astype(np.float32)


def look_density(occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
    """Looks per voxel at world points [m], interpolated between voxel centres; 0 outside the grid."""
    if not occupancy.num_hits.size:
        return np.zeros(len(points_m))
    voxels = points_m / occupancy.config.voxel_m - occupancy.corner
    return map_coordinates(occupancy.num_hits, voxels[:, ::-1].T, np.float64, order=1, mode="constant")


def last_layer_variance(
    backend: MapperBackend, occupancy: OccupancyGrid, points_m: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, " n"]:
    """Variance of s at world points [m] under the posterior of the SDF decoder's last layer, for one look.

    Its mean over all looks is about the number of axes that are kept.
    """
    state = backend.get_state()
    places = _looked_at(occupancy)
    if not len(places):
        return (hidden_features(backend, state, points_m) ** 2).sum(axis=1)
    seen = hidden_features(backend, state, places)
    spread, axes = np.linalg.eigh(seen.T @ seen / len(seen))
    spread, axes = spread[-_NUM_AXES:], axes[:, -_NUM_AXES:]
    telling = spread > _MIN_SPREAD * spread[-1]
    whitening = axes[:, telling] / np.sqrt(spread[telling])
    return (_projected(backend, state, points_m, whitening.T) ** 2).sum(axis=1)


def hidden_features(
    backend: MapperBackend, state: dict[str, Float32[np.ndarray, "..."]], points_m: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n hidden"]:
    """What the SDF decoder's hidden layer gives at world points [m], after its activation."""
    return _projected(backend, state, points_m, np.eye(state["sdf_out"].shape[1]))


def _projected(
    backend: MapperBackend,
    state: dict[str, Float32[np.ndarray, "..."]],
    points_m: Float[np.ndarray, "n 3"],
    directions: Float64[np.ndarray, "k hidden"],
) -> Float64[np.ndarray, "n k"]:
    """The hidden features at world points [m] along given directions."""
    # A decoder whose last layer is a direction says what the features are along it: no engine needs a way of its own.
    decoders = np.stack([_decoders_with(state, direction) for direction in directions])
    out = np.empty((len(points_m), len(directions)))
    for start in range(0, len(points_m), _CHUNK):
        rows = slice(start, start + _CHUNK)
        out[rows] = backend.query_perturbed(points_m[rows], decoders)[0].T
    return out


def _decoders_with(
    state: dict[str, Float32[np.ndarray, "..."]], direction: Float64[np.ndarray, " hidden"]
) -> Float32[np.ndarray, " weights"]:
    """All decoder weights, but for a last layer of the SDF decoder that gives the features along a direction as s."""
    last = np.zeros_like(state["sdf_out"])
    last[0] = direction
    return np.concatenate([(last if name == "sdf_out" else state[name]).ravel() for name in DECODER_NAMES])


def _looked_at(occupancy: OccupancyGrid) -> Float64[np.ndarray, "n 3"]:
    """Centres of occupied voxels in the world [m], drawn at even intervals from all looks at such, in their order."""
    occupied = np.flatnonzero(occupancy.grid.state == OCCUPIED)
    if not len(occupied):
        return np.zeros((0, 3))
    looks = np.cumsum(occupancy.num_hits.reshape(-1)[occupied])
    drawn = np.searchsorted(looks, (np.arange(_NUM_PLACES) + 0.5) * (looks[-1] / _NUM_PLACES))
    voxels = np.stack(np.unravel_index(occupied[drawn], occupancy.num_hits.shape), axis=1)[:, ::-1]
    return (voxels + occupancy.corner) * occupancy.config.voxel_m
