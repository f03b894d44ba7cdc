"""Where along a ray the field is asked: depth-guided, or uniform as in the paper.

The jitter comes from a hash of (seed, ray, sample), so that every engine draws the same samples from the same seed
without sharing a random number generator.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from anm_mj.mapping.mapping_config import SamplingConfig
from anm_mj.mapping.rays import spaced_depths

_MASK = 0xFFFFFFFF


def counter_uniform(seed: int, rows: int, cols: int, device: torch.device) -> Float[Tensor, "rows cols"]:
    """Uniform numbers in [0, 1) that depend on nothing but ``seed`` (its low 32 bits) and the position.

    Source: the 32-bit mixer "lowbias32" (C. Wellons, Prospecting for Hash Functions, 2018), applied twice; of its
    result the upper 24 bits are used, which a float32 holds exactly.
    """
    counter = torch.arange(rows * cols, dtype=torch.int64, device=device)
    key = _mix(torch.tensor(seed & _MASK, dtype=torch.int64, device=device))
    bits = _mix(_mix(counter) ^ key)
    return ((bits >> 8).to(torch.float32) * 2.0**-24).view(rows, cols)


def _mix(x: Tensor) -> Tensor:
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & _MASK
    x = ((x ^ (x >> 15)) * 0x846CA68B) & _MASK
    return x ^ (x >> 16)


def valid_depth(depth_m: Float[Tensor, " n"], config: SamplingConfig) -> Bool[Tensor, " n"]:
    """True for rays that end on a surface in range; NaN, zero and too far are not."""
    return (depth_m > 0.0) & (depth_m <= config.max_depth_m)


def sample_depths(
    depth_m: Float[Tensor, " n"], config: SamplingConfig, truncation_m: float, seed: int
) -> Float[Tensor, "n samples"]:
    """Planar depths of the samples along each ray, ascending [m]. ``depth_m`` is measured, NaN where it was not;
    ``truncation_m`` is half the width of the band about the surface; the jitter is derived from ``seed``.
    """
    valid = valid_depth(depth_m, config)
    jitter = counter_uniform(seed, len(depth_m), config.samples_per_ray, depth_m.device).to(depth_m.dtype)
    if config.scheme == "guided":
        return _guided(depth_m, valid, config, truncation_m, jitter)
    return _uniform(depth_m, valid, config, truncation_m, jitter)


def _guided(
    depth_m: Tensor, valid: Tensor, config: SamplingConfig, truncation_m: float, jitter: Tensor
) -> Float[Tensor, "n samples"]:
    """One sample in each of equal bins: over [0, d - tr], over d +- tr, and over [0, reach] where there is no depth."""
    device, dtype = depth_m.device, depth_m.dtype
    free = torch.arange(config.free_samples, device=device, dtype=dtype)
    near = torch.arange(config.near_samples, device=device, dtype=dtype)
    none = torch.arange(config.samples_per_ray, device=device, dtype=dtype)
    depth = depth_m[:, None]
    band_start = (depth - truncation_m).clamp_min(0.0)
    z_free = (free + jitter[:, : config.free_samples]) * (band_start / config.free_samples)
    band_width = depth + truncation_m - band_start
    z_near = band_start + (near + jitter[:, config.free_samples :]) * (band_width / config.near_samples)
    z_none = (none + jitter) * (config.reach_m / config.samples_per_ray)
    return torch.where(valid[:, None], torch.cat((z_free, z_near), dim=1), z_none)


def _uniform(
    depth_m: Tensor, valid: Tensor, config: SamplingConfig, truncation_m: float, jitter: Tensor
) -> Float[Tensor, "n samples"]:
    """Even samples over [0, reach] and over the band, sorted together, then each moved between its neighbours' middles.

    Source: Wang et al., Co-SLAM, 2023.
    """
    even, band, spare = (torch.from_numpy(part).to(depth_m) for part in spaced_depths(config, truncation_m))
    near = torch.where(valid[:, None], depth_m[:, None] + band, spare).clamp_min(0.0)
    z, _ = torch.sort(torch.cat((even.expand(len(depth_m), -1), near), dim=1), dim=1)
    middle = 0.5 * (z[:, 1:] + z[:, :-1])
    lower = torch.cat((z[:, :1], middle), dim=1)
    upper = torch.cat((middle, z[:, -1:]), dim=1)
    return lower + (upper - lower) * jitter
