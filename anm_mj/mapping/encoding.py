"""Where a point is, as numbers a small network can read: a multiresolution hash grid and a one-blob code.

Both live in metric world coordinates and know no bounds: cell ``floor(x / cell size)`` of a level has the same entry
however large the map becomes, so nothing that was learnt moves when the robot opens a door to another room, and ground
truth never has to tell how large the world is. The one-blob code (Müller et al., Neural Importance Sampling, 2019)
spans a box in the original; here it is wound around a circle of a stated length per axis. Two places a period apart get
the same code, and the grid's coarse levels, whose periods differ, tell them apart.

The grid (Müller et al., Instant Neural Graphics Primitives, 2022) has ``num_levels`` tables of ``2^log2_table_size``
entries. Coarse levels index by position modulo a box, so no two cells of a flat collide; fine ones by the spatial hash
of that paper. One formula serves both: ``((x * ax) & mx) ^ ((y * ay) & my) ^ ((z * az) & mz)``. As the scene grows, the
tables can be doubled without moving what was learnt, see :func:`doubled_table`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32, Int64
from torch import Tensor

from anm_mj.mapping.config import FieldConfig

NUM_FEATURES = 2
"""Features per table entry."""
_PRIMES = (1, 2654435761, 805459861)
"""Factors of the spatial hash (Müller et al. 2022, eq. 4)."""


def cell_sizes_m(config: FieldConfig) -> Float[np.ndarray, " levels"]:
    """Edge of the cells on each level, coarse to fine [m]."""
    if config.num_levels == 1:
        return np.array([config.coarsest_cell_m])
    ratio = config.finest_cell_m / config.coarsest_cell_m
    return config.coarsest_cell_m * ratio ** (np.arange(config.num_levels) / (config.num_levels - 1))


def cells_per_m(config: FieldConfig) -> Float32[np.ndarray, " levels"]:
    """Cells to a metre on each level, as all engines have them [1/m]."""
    return (1.0 / cell_sizes_m(config)).astype(np.float32)


def bins_per_m(config: FieldConfig) -> Float32[np.ndarray, "3"]:
    """Bins of the one-blob code to a metre, per axis [1/m]."""
    return np.float32(config.blob_bins) / np.array(config.blob_period_m, np.float32)


def index_factors(config: FieldConfig) -> tuple[Int64[np.ndarray, "3 levels"], Int64[np.ndarray, "3 levels"]]:
    """Factors ``a`` and masks ``m`` of the index formula, per axis and level; all fit into 32 bits."""
    bits = config.log2_table_size
    shifts, widths = _torus_bits(bits)
    torus = cell_sizes_m(config) >= config.torus_min_cell_m
    table_mask = (1 << bits) - 1
    # Only the low bits of a product reach the index, so the factors can be cut to the table's size.
    hash_factors = np.array([p & table_mask for p in _PRIMES])
    factors = np.where(torus, (1 << shifts)[:, None], hash_factors[:, None])
    masks = np.where(torus, (((1 << widths) - 1) << shifts)[:, None], table_mask)
    return factors, masks


def _torus_bits(bits: int) -> tuple[Int64[np.ndarray, "3"], Int64[np.ndarray, "3"]]:
    """Lowest bit and number of bits of x, y and z in an index by position."""
    z_bits = bits // 4
    x_bits = (bits - z_bits + 1) // 2
    return np.array([0, x_bits, bits - z_bits]), np.array([x_bits, bits - z_bits - x_bits, z_bits])


def doubled_table(table: Float32[np.ndarray, "entries features"], config: FieldConfig) -> Float32[np.ndarray, "e f"]:
    """The table with twice the entries per level that gives every point in the world the features it has now.

    An index into the larger table, cut to the bits that the smaller one has, is the index into that: entries that two
    places share are copied, and from then on each learns for itself.

    Args:
        table: Entries of all levels, level-major.
        config: The field that the table belongs to; its ``log2_table_size`` is that before doubling.
    """
    bits = config.log2_table_size
    index = np.arange(1 << (bits + 1))
    hashed = index & ((1 << bits) - 1)
    by_position = np.zeros_like(index)
    for before, width, after in zip(*_torus_bits(bits), _torus_bits(bits + 1)[0], strict=True):
        by_position |= ((index >> after) & ((1 << width) - 1)) << before
    torus = cell_sizes_m(config) >= config.torus_min_cell_m
    levels = table.reshape(config.num_levels, 1 << bits, -1)
    doubled = [level[by_position if at else hashed] for level, at in zip(levels, torus, strict=True)]
    return np.concatenate(doubled)


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
        """Entries and trilinear weights of the eight cell corners about each point, for all levels.

        Args:
            points_m: World points [m].

        Returns:
            Indices into the whole table and weights, with ``m = levels * n``, level-major, so that one level's table
            stays in the cache while it is read.
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
