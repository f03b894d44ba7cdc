"""Uncertainty of the map at a point: last-layer variance, or noise on the decoders' weights (paper, Eq. 4).

The paper's method: where training has flattened the loss about the present weights, noise on them changes little; where
it has not, the outputs scatter (Yan et al., Active Neural Mapping, ICCV 2023). Both decoders are perturbed, so geometry
and appearance both count. To first order the variance is the noise's variance times the squared norm of the outputs'
gradient by the weights, which has a cheap closed form; on a trained map it ranks points as 400 passes do (rank
correlation 0.98; 20 passes: 0.87).

That measures how strongly features act on the output. It counts no observations: surface that no view showed does not
stand out (it is even a little lower there, because its features are untouched). :mod:`anm_mj.mapping.last_layer` counts
them; ``scripts/bench_uncertainty.py`` measures which method predicts the map's true error best.
"""

import functools

import numpy as np
from jaxtyping import Float, Float32

from anm_mj import _native
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.last_layer import last_layer_variance
from anm_mj.mapping.mapping_config import MappingConfig, UncertaintyConfig

_CHUNK = 16384
"""Points per call to the engine, so that the outputs of all passes stay small."""


def uncertainty_at(
    backend: MapperBackend,
    occupancy: DepthOccupancy,
    points_m: Float[np.ndarray, "n 3"],
    config: MappingConfig,
    seed: int,
) -> Float32[np.ndarray, " n"]:
    """Uncertainty at world points [m] by the configured method; comparable within one method only. The noise of
    perturbations is derived from ``seed``. Returns the variance of Eq. 4 in squared truncations plus ``color_weight``
    times squared colour units, or, for "last_layer_variance", a variance of s up to a constant factor.
    """
    method = config.uncertainty.method
    if method == "last_layer_variance":
        return last_layer_variance(backend, occupancy, points_m, config.schedule.density_exponent)
    if method == "closed_form":
        return closed_form_variance(backend, points_m, config.uncertainty)
    return perturbed_variance(backend, points_m, config.uncertainty, seed)


def closed_form_variance(
    backend: MapperBackend, points_m: Float[np.ndarray, "n 3"], config: UncertaintyConfig
) -> Float32[np.ndarray, " n"]:
    """The limit of :func:`perturbed_variance` for many passes and little noise, at world points [m]."""
    s_square, rgb_square = backend.query_sensitivity(points_m)
    scale = np.float32(config.noise_std**2)
    return scale * (s_square + np.float32(config.color_weight) * rgb_square)


def perturbed_variance(
    backend: MapperBackend, points_m: Float[np.ndarray, "n 3"], config: UncertaintyConfig, seed: int
) -> Float32[np.ndarray, " n"]:
    """Sample variance over noisy decoders of s plus the weighted mean one of the colours, at world points [m]."""
    decoders = noisy_decoders(backend.parameters(), config, seed)
    out = np.empty(len(points_m), np.float32)
    for start in range(0, len(points_m), _CHUNK):
        rows = slice(start, start + _CHUNK)
        s, rgb = backend.query_perturbed(points_m[rows], decoders)
        out[rows] = _native.pass_variance(s, rgb, config.color_weight)
    return out


def noisy_decoders(
    state: dict[str, Float32[np.ndarray, "..."]], config: UncertaintyConfig, seed: int
) -> Float32[np.ndarray, "passes weights"]:
    """Weights of all passes, the hash table left out: the present ones plus Gaussian noise, always that of the seed."""
    weights = np.concatenate([values.ravel() for name, values in state.items() if name != "table"])
    return weights + np.float32(config.noise_std) * _noise(seed, config.num_passes, weights.size)


@functools.lru_cache(maxsize=2)
def _noise(seed: int, num_passes: int, num_weights: int) -> Float32[np.ndarray, "passes weights"]:
    """Standard normal noise on all weights; drawn once, as it is always the same."""
    return np.random.default_rng(seed).standard_normal((num_passes, num_weights), dtype=np.float32)
