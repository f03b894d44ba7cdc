"""Where a point is, as numbers a small network can read: a multiresolution hash grid and a one-blob code.

Both live in metric world coordinates and know no bounds: cell ``floor(x / cell size)`` of a level has the same entry
however large the map becomes, so nothing that was learnt moves when the robot opens a door to another room, and ground
truth never has to tell how large the world is. The one-blob code (Müller et al., Neural Importance Sampling, 2019)
spans a box in the original; here it is wound around a circle of a stated length per axis. Two places a period apart get
the same code, and the grid's coarse levels, whose periods differ, tell them apart.

The grid (Müller et al., Instant Neural Graphics Primitives, 2022) has ``num_levels`` tables of ``2^log2_table_size``
entries. Coarse levels index by position modulo a box, so no two cells of a flat collide; fine ones by the spatial hash
of that paper. One formula serves both: ``((x * ax) & mx) ^ ((y * ay) & my) ^ ((z * az) & mz)``. As the scene grows, the
tables can be doubled without moving what was learnt, see :func:`anm_mj.mapping.backends.parameters.doubled_table`.
"""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int32
from torch import Tensor

from anm_mj.mapping.backends.parameters import cells_per_m, index_factors
from anm_mj.mapping.mapping_config import FieldConfig


class _Interpolate(torch.autograd.Function):
    """Weighted sum of eight table entries per point and level.

    Autograd's own route through advanced indexing is an order of magnitude slower on a CPU, forwards (it moves whole
    rows) and backwards (it sorts); here each feature plane is gathered, and scattered, on its own.
    """

    @staticmethod
    def forward(
        ctx: Any, index: Int32[Tensor, "8 m"], weight: Float[Tensor, "8 m"], *planes: Float[Tensor, " entries"]
    ) -> Float[Tensor, "features m"]:
        ctx.save_for_backward(index, weight)
        ctx.entries = len(planes[0])
        return gather_corners(index, weight, *planes)

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, grad: Float[Tensor, "features m"]
    ) -> tuple[Tensor | None, ...]:
        index, weight = ctx.saved_tensors
        flat = index.reshape(-1)
        gradients = []
        for plane in grad:
            values = (weight * plane).reshape(-1)
            if values.is_cuda:
                gradients.append(values.new_zeros(ctx.entries).index_add_(0, flat, values))
            else:
                gradients.append(torch.bincount(flat, values, minlength=ctx.entries).to(values.dtype))
        return None, None, *gradients


def gather_corners(
    index: Int32[Tensor, "8 m"], weight: Float[Tensor, "8 m"], *planes: Float[Tensor, " entries"]
) -> Float[Tensor, "features m"]:
    """The forward pass of the interpolation, corner by corner so that the temporaries stay in the cache."""
    out = weight.new_zeros(len(planes), index.shape[1])
    for corner in range(8):
        for feature, plane in enumerate(planes):
            out[feature].addcmul_(plane.index_select(0, index[corner]), weight[corner])
    return out


class HashGrid:
    """Looks points up in the multiresolution grid; holds the constants of its levels, not the table itself."""

    def __init__(self, config: FieldConfig, device: torch.device) -> None:
        factors, masks = index_factors(config)
        entries = 1 << config.log2_table_size
        self.num_levels = config.num_levels
        self.num_entries = config.num_levels * entries
        self._cells_per_m = torch.from_numpy(cells_per_m(config)).to(device)[None, :, None]
        self._factors = torch.from_numpy(factors.astype(np.int32)).to(device)[:, :, None]
        self._masks = torch.from_numpy(masks.astype(np.int32)).to(device)[:, :, None]
        offsets = torch.arange(self.num_levels, dtype=torch.int32, device=device) * entries
        self._offsets = offsets[:, None]

    def corners(self, points_m: Float[Tensor, "n 3"]) -> tuple[Int32[Tensor, "8 m"], Float[Tensor, "8 m"]]:
        """Entries and trilinear weights of the eight cell corners about each point, for all levels. Returns indices
        into the whole table and weights, with ``m = levels * n``, level-major, so that one level's table stays in the
        cache while it is read.
        """
        n = points_m.shape[0]
        scaled = points_m.t()[:, None, :] * self._cells_per_m.to(points_m.dtype)
        cell = scaled.floor()
        high_weight = scaled - cell
        weights = (1.0 - high_weight, high_weight)
        low_key = cell.to(torch.int32) * self._factors
        keys = (low_key & self._masks, (low_key + self._factors) & self._masks)
        index = low_key.new_empty(8, self.num_levels, n)
        weight = high_weight.new_empty(8, self.num_levels, n)
        # Written corner by corner into one array: stacking them would move everything twice.
        for y in range(2):
            for z in range(2):
                key_yz = (keys[y][1] ^ keys[z][2]) + self._offsets
                weight_yz = weights[y][1] * weights[z][2]
                for x in range(2):
                    torch.bitwise_xor(keys[x][0], key_yz, out=index[4 * z + 2 * y + x])
                    torch.mul(weights[x][0], weight_yz, out=weight[4 * z + 2 * y + x])
        return index.view(8, self.num_levels * n), weight.view(8, self.num_levels * n)

    def features(self, points_m: Float[Tensor, "n 3"], *planes: Float[Tensor, " entries"]) -> Float[Tensor, "n values"]:
        """Interpolated features: the first of all levels, coarse to fine, then the second of all levels.

        Differentiable in the table's planes (one per feature), not in the points.

        Source: paper, section IV-B (the grid F of Eq. 8); Müller et al., 2022.
        """
        index, weight = self.corners(points_m)
        if torch.is_grad_enabled() and planes[0].requires_grad:
            out = _Interpolate.apply(index, weight, *planes)
        else:
            out = gather_corners(index, weight, *planes)
        return out.view(len(planes) * self.num_levels, points_m.shape[0]).t()


def one_blob(points_m: Float[Tensor, "n 3"], period_m: Float[Tensor, "3"], num_bins: int) -> Float[Tensor, "n codes"]:
    """Each coordinate as a bump over ``num_bins`` bins on a circle of length ``period_m``.

    The bump is the quartic kernel with a radius of one bin, integrated over each bin: three neighbouring bins are not
    zero, and their sum is one.

    Source: Müller et al., Neural Importance Sampling, 2019, section 4.3, wound around a circle.
    """
    position = points_m * (num_bins / period_m)
    centre = position.floor()
    right = position - centre
    below = _quartic_tail(right)
    above = _quartic_tail(1.0 - right)
    bins = centre.to(torch.int64)
    index = torch.stack((bins - 1, bins, bins + 1), dim=-1).remainder_(num_bins)
    value = torch.stack((below, 1.0 - below - above, above), dim=-1)
    code = value.new_zeros(points_m.shape[0], 3, num_bins).scatter_(-1, index, value)
    return code.view(points_m.shape[0], 3 * num_bins)


def _quartic_tail(distance: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Mass of the unit quartic kernel beyond ``distance`` in [0, 1] of its centre."""
    square = distance * distance
    return 0.5 - 0.9375 * distance * (1.0 + square * (-2.0 / 3.0 + square * 0.2))
