"""How sure the map is: the variance of its outputs under noise on the decoders' weights (paper, eq. 5).

Where training has flattened the loss about the present weights, noise on them changes little; where it has not, the
outputs scatter (Yan et al., Active Neural Mapping, ICCV 2023). Both decoders are perturbed, so geometry and appearance
both count.

To first order the variance is the noise's variance times the squared norm of the outputs' gradient by the weights,
which is cheap in closed form. On a trained map it ranks 20 000 points as 400 passes do (rank correlation 0.98; 20
passes: 0.87). What it measures is how strongly features act on the output. It counts no observations: surface that was
never seen does not stand out by it (it is even a little lower there, its features being untouched), so what is unseen
must be read from the occupancy grid.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.config import UncertaintyConfig
from anm_mj.mapping.field import DECODER_NAMES

_CHUNK = 16384
"""Points per call to the engine, so that the outputs of all passes stay small."""


def noisy_decoders(
    state: dict[str, Float32[np.ndarray, "..."]], config: UncertaintyConfig, seed: int
) -> Float32[np.ndarray, "passes weights"]:
    """Decoder weights of all passes: the present ones plus Gaussian noise, the same for the same seed."""
    weights = np.concatenate([state[name].ravel() for name in DECODER_NAMES])
    noise = np.random.default_rng(seed).standard_normal((config.num_passes, weights.size), dtype=np.float32)
    return weights + np.float32(config.noise_std) * noise


def predictive_variance(
    backend: MapperBackend, points_m: Float[np.ndarray, "n 3"], config: UncertaintyConfig, seed: int
) -> Float32[np.ndarray, " n"]:
    """Variance of s plus the weighted mean variance of the colour channels at world points.

    Args:
        backend: The engine that holds the parameters.
        points_m: World points [m].
        config: Method, noise and weights.
        seed: What the noise is derived from (unused by the closed form).

    Returns:
        Variance, in squared truncations plus ``color_weight`` times squared colour units.
    """
    if config.method == "closed_form":
        s_square, rgb_square = backend.query_sensitivity(points_m)
        scale = np.float32(config.noise_std**2)
        return scale * (s_square + np.float32(config.color_weight) * rgb_square)
    decoders = noisy_decoders(backend.get_state(), config, seed)
    out = np.empty(len(points_m), np.float32)
    for start in range(0, len(points_m), _CHUNK):
        rows = slice(start, start + _CHUNK)
        s, rgb = backend.query_perturbed(points_m[rows], decoders)
        color_variance = rgb.var(axis=0, ddof=1).mean(axis=-1)
        out[rows] = s.var(axis=0, ddof=1) + np.float32(config.color_weight) * color_variance
    return out
