"""The parameters of the neural field, by name. Imports no torch.

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
from jaxtyping import Float32

from anm_mj.errors import MapError
from anm_mj.mapping.backends.grid_layout import NUM_FEATURES
from anm_mj.mapping.mapping_config import FieldConfig

if TYPE_CHECKING:
    from torch import Tensor

    _Flat = TypeVar("_Flat", np.ndarray, Tensor)
else:
    _Flat = TypeVar("_Flat")

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
