"""Whether the Triton engine computes on this machine what the torch engine does."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.backends.triton.backend import TritonBackend
from anm_mj.mapping.config import default_mapping
from anm_mj.mapping.rays import RayBatch

_STEPS = 3
"""The first compiles, the second captures and replays, the third replays."""
_TOLERANCE = 1e-3
"""How far losses may be apart after them, as a share."""


@functools.cache
def self_check() -> str | None:
    """What is wrong with the engine's results on the device at hand; None if nothing is.

    The first call trains a few steps on a small table and compares them with the torch engine; this compiles the
    kernels of the default configuration.
    """
    config = default_mapping()
    config = replace(config, field=replace(config.field, log2_table_size=10))
    rng = np.random.default_rng(0)
    direction = rng.uniform(-1.0, 1.0, (48, 3)).astype(np.float32)
    depth = np.where(np.arange(48) % 4 == 0, np.nan, rng.uniform(0.5, 3.0, 48)).astype(np.float32)
    rays = RayBatch(np.zeros_like(direction), direction, np.abs(direction), depth)
    # Whatever a compiler or a driver may raise, torch can do the work.
    try:
        backend = TritonBackend(config, seed=0)
        losses = [backend.step(rays, seed) for seed in range(_STEPS)]
    except Exception as err:
        return f"its kernels do not run ({type(err).__name__}: {_first_line(err)})"
    reference = TorchBackend(config, seed=0, device="cpu")
    expected = [reference.step(rays, seed) for seed in range(_STEPS)]
    # Without smoothness, which is zero here.
    ours, theirs = np.array(losses)[:, :5], np.array(expected)[:, :5]
    error = np.max(np.abs(ours / theirs - 1.0))
    if not error < _TOLERANCE:
        return f"its losses differ from the torch engine's by {error:.1e} after {_STEPS} steps"
    return None


def _first_line(err: Exception) -> str:
    return next(iter(str(err).splitlines()), "")
