"""Volume rendering of a signed distance field (paper, Eq. 1 and 2), and the five loss terms (Eq. 9 to 12), with the
normalisation of Co-SLAM's released code.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from anm_mj.mapping.mapping_config import LossConfig

WEIGHT_SCALE = 0.1
"""The threshold of Eq. 2 in the unit of s, a fraction of the truncation: the weights fall off within about 1 cm."""


def sdf_to_weight(
    s: Float[Tensor, "n samples"], z_m: Float[Tensor, "n samples"], truncation_m: float
) -> Float[Tensor, "n samples"]:
    """Rendering weights of Eq. 2, summing to one along each ray.

    Samples further than the truncation behind the first sign change are left out, so that a second surface behind the
    first one does not shine through. A ray without a sign change keeps all its samples.
    """
    weight = torch.sigmoid(s / WEIGHT_SCALE) * torch.sigmoid(-s / WEIGHT_SCALE)
    crossing = (s[:, 1:] * s[:, :-1]) < 0.0
    first = torch.argmax(crossing.to(torch.uint8), dim=1, keepdim=True)
    limit = torch.where(crossing.any(dim=1, keepdim=True), z_m.gather(1, first) + truncation_m, torch.inf)
    weight = weight * (z_m < limit)
    return weight / (weight.sum(dim=1, keepdim=True) + 1e-8)


def composite(
    weights: Float[Tensor, "n samples"], values: Float[Tensor, "n samples channels"]
) -> Float[Tensor, "n channels"]:
    """Weighted sum of values along each ray (Eq. 1)."""
    return (weights[:, :, None] * values).sum(dim=1)


class LossTerms(NamedTuple):
    """Unweighted terms and their weighted sum; scalar tensors."""

    total: Tensor
    rgb: Tensor
    depth: Tensor
    sdf: Tensor
    free_space: Tensor
    smoothness: Tensor


def ray_losses(
    s: Float[Tensor, "n samples"],
    z_m: Float[Tensor, "n samples"],
    rendered_rgb: Float[Tensor, "n 3"],
    rendered_depth_m: Float[Tensor, " n"],
    rgb: Float[Tensor, "n 3"],
    depth_m: Float[Tensor, " n"],
    valid: Bool[Tensor, " n"],
    truncation_m: float,
    config: LossConfig,
) -> LossTerms:
    """Colour, depth, SDF and free-space terms of a batch of rays.

    Both SDF terms are means over all samples of the batch, and each is weighted by the other's share of the supervised
    samples. On a ray without depth, all samples are free or none is, as ``config.no_depth_is_free`` says. Returns the
    terms, without smoothness. ``s`` is predicted, in fractions of the truncation; depths are planar [m], colours in [0,
    1]. Rays with a surface in range are ``valid``; ``depth_m`` may be anything on the others.
    """
    depth = torch.where(valid, depth_m, 0.0)[:, None]
    hit = valid[:, None]
    in_front = z_m < depth - truncation_m
    in_band = hit & ~in_front & (z_m <= depth + truncation_m)
    free = (hit & in_front) | (~hit if config.no_depth_is_free else hit & ~hit)
    num_free = free.sum()
    num_band = in_band.sum()
    total_samples = (num_free + num_band).clamp_min(1)
    free_loss = (num_band / total_samples) * ((s - 1.0) * free).square().mean()
    sdf_loss = (num_free / total_samples) * ((z_m + s * truncation_m - depth) * in_band).square().mean()
    factor = torch.where(valid, 1.0, config.no_depth_rgb).to(rgb.dtype)[:, None]
    rgb_loss = ((rendered_rgb - rgb) * factor).square().mean()
    depth_loss = ((rendered_depth_m - depth[:, 0]) * valid).square().sum() / valid.sum().clamp_min(1)
    total = config.rgb * rgb_loss + config.depth * depth_loss + config.sdf * sdf_loss + config.free_space * free_loss
    return LossTerms(total, rgb_loss, depth_loss, sdf_loss, free_loss, torch.zeros_like(total))


def smoothness_lattice(corner_m: Float[Tensor, "3"], config: LossConfig) -> Float[Tensor, "points 3"]:
    """World points of the lattice that the smoothness term is taken on, x slowest [m]."""
    steps = torch.arange(config.smoothness_points, device=corner_m.device, dtype=corner_m.dtype)
    axes = torch.meshgrid(steps, steps, steps, indexing="ij")
    return corner_m + torch.stack(axes, dim=-1).view(-1, 3) * config.smoothness_spacing_m


def smoothness_loss(features: Float[Tensor, "points features"], config: LossConfig) -> Float[Tensor, ""]:
    """Squared differences of neighbouring grid features, summed, per lattice point (paper, Eq. 12)."""
    k = config.smoothness_points
    lattice = features.view(k, k, k, -1)
    x, y, z = (lattice.diff(dim=axis).square().sum() for axis in range(3))
    return (x + y + z) / (k + 1) ** 3
