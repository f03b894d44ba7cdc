"""What the uniform sampling scheme is made of, the very same numbers for every engine. Imports no torch."""

import numpy as np
from jaxtyping import Float32

from anm_mj.mapping.mapping_config import SamplingConfig


def spaced_depths(
    config: SamplingConfig, truncation_m: float
) -> tuple[Float32[np.ndarray, " free"], Float32[np.ndarray, " near"], Float32[np.ndarray, " near"]]:
    """Depths over [0, far], offsets over the band, and depths where there is no surface to make a band about [m]."""
    return (
        _evenly(0.0, config.far_m, config.free_samples),
        _evenly(-truncation_m, truncation_m, config.near_samples),
        _evenly(0.0, config.far_m, config.near_samples),
    )


def _evenly(first: float, last: float, count: int) -> Float32[np.ndarray, " count"]:
    """Numbers from first to last, each half counted from its own end so that both ends are exact; as torch has them."""
    low, high = np.float32(first), np.float32(last)
    step = float((high - low) / np.float32(max(count - 1, 1)))
    k = np.arange(count)
    # Products and sums in double precision, rounded once.
    return np.where(k < count // 2, float(low) + step * k, float(high) - step * (count - 1 - k)).astype(np.float32)
