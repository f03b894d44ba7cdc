"""Volume rendering of a signed distance field (paper, Eq. 1 and 2)."""

import torch
from jaxtyping import Float
from torch import Tensor

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
