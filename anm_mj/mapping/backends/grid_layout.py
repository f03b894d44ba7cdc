"""Where the multiresolution hash grid keeps what it knows about a place: cells, indices, and how the tables grow.

Every engine reads these numbers; :mod:`.torch_encoding` says what they mean. Imports no torch.
"""

import numpy as np
from jaxtyping import Float, Float32, Int64

from anm_mj.mapping.mapping_config import FieldConfig

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
    places share are copied, and from then on each learns for itself. Entries of all levels are level-major;
    ``log2_table_size`` of ``config`` is that before doubling.
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
