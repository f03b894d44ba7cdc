"""The parameters of the neural field, by name, and where its hash grid keeps what it knows about a place.

Every engine reads these numbers; :mod:`.torch_encoding` says what those of the grid mean. Imports no torch.

Parameter layout, the same for every engine and in every checkpoint, all float32 and C-contiguous, in this order:

======================  ================================  =====================================================
name                    shape                             meaning
======================  ================================  =====================================================
``table``               (levels * 2^log2_table_size, 2)   hash grid entries, level-major, coarse to fine
``sdf_hidden``          (hidden, 2 * levels + 3 * bins)   inputs: first grid feature of all levels, the second, blobs
``sdf_out``             (1 + geometry, hidden)            output 0 is s, the rest feeds the colour decoder
``color_hidden``        (hidden, 3 * bins + geometry)     inputs: one-blob x, y, z, then geometry features
``color_out``           (3, hidden)                       red, green, blue before the sigmoid
======================  ================================  =====================================================
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from jaxtyping import Float, Float32, Int64

from anm_mj.errors import MapError
from anm_mj.mapping.mapping_config import FieldConfig

if TYPE_CHECKING:
    from torch import Tensor

    _Flat = TypeVar("_Flat", np.ndarray, Tensor)
else:
    _Flat = TypeVar("_Flat")

NUM_FEATURES = 2
"""Features per table entry."""
_PRIMES = (1, 2654435761, 805459861)
"""Factors of the spatial hash (Müller et al. 2022, eq. 4)."""
DECODER_NAMES = ("sdf_hidden", "sdf_out", "color_hidden", "color_out")
"""Names of the decoders' weights in the order of the parameter layout."""
_TABLE_INIT = 1e-4
"""Bound of the table's uniform start values (Müller et al., 2022)."""


def decoder_shapes(config: FieldConfig) -> dict[str, tuple[int, ...]]:
    """Shapes of the decoders' weights by name, in the order of the parameter layout."""
    blob = 3 * config.blob_bins
    hidden, geometry = config.hidden_width, config.geometry_features
    return {
        "sdf_hidden": (hidden, NUM_FEATURES * config.num_levels + blob),
        "sdf_out": (1 + geometry, hidden),
        "color_hidden": (hidden, blob + geometry),
        "color_out": (3, hidden),
    }


def parameter_shapes(config: FieldConfig) -> dict[str, tuple[int, ...]]:
    """Shapes of all parameters by name, in the order of the parameter layout."""
    return {"table": (config.num_levels << config.log2_table_size, NUM_FEATURES), **decoder_shapes(config)}


def check_shapes(arrays: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raises MapError with the name of the first array that is missing, or has another shape."""
    for name, shape in shapes.items():
        if name not in arrays:
            raise MapError(f"The map's state lacks {name!r}; it has {sorted(arrays)}.")
        if arrays[name].shape != shape:
            raise MapError(f"The map's {name!r} has shape {arrays[name].shape}, but its configuration says {shape}.")


def split_flat(flat: _Flat, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, _Flat]:
    """Parameters that lie one behind the other in a flat array or tensor, by name; views of it."""
    parts, start = {}, 0
    for name, shape in shapes.items():
        end = start + math.prod(shape)
        parts[name] = flat[start:end].reshape(shape)
        start = end
    return parts


def initial_parameters(config: FieldConfig, seed: int) -> dict[str, Float32[np.ndarray, "rows cols"]]:
    """Start values of all parameters, drawn on the host so that every engine starts from the same ones."""
    rng = np.random.default_rng(seed)
    parameters = {}
    for name, shape in parameter_shapes(config).items():
        bound = _TABLE_INIT if name == "table" else 1.0 / math.sqrt(shape[1])
        parameters[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
    return parameters


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
