"""The neural field: world point to signed distance and colour (paper, Eq. 8).

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

There are no biases. ``s`` is a fraction of the truncation distance: 1 in free space, 0 on the surface.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.config import FieldConfig
from anm_mj.mapping.encoding import NUM_FEATURES, HashGrid, one_blob

DECODER_NAMES = ("sdf_hidden", "sdf_out", "color_hidden", "color_out")
"""Names of the decoders' weights in the order of the parameter layout."""
_Flat = TypeVar("_Flat", np.ndarray, Tensor)
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


def check_state(state: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Say so if a state lacks a parameter, or has one of another shape.

    Raises:
        MapError: With the name of the first that does not fit.
    """
    for name, shape in shapes.items():
        if name not in state:
            raise MapError(f"The map's state lacks {name!r}; it has {sorted(state)}.")
        if state[name].shape != shape:
            raise MapError(f"The map's {name!r} has shape {state[name].shape}, but its configuration says {shape}.")


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


class NeuralField(torch.nn.Module):
    """Hash grid, one-blob code and two shallow decoders (Wang et al., Co-SLAM, 2023), in torch.

    The table is kept as one plane per feature, because gathering one float at a time is what a CPU does well.
    """

    def __init__(self, config: FieldConfig, seed: int, device: torch.device) -> None:
        super().__init__()
        self.config = config
        self._grid = HashGrid(config, device)
        self._period_m = torch.tensor(config.blob_period_m, device=device)
        arrays = initial_parameters(config, seed)
        self.planes = torch.nn.ParameterList([torch.from_numpy(p.copy()).to(device) for p in arrays["table"].T])
        self._decoders = torch.nn.ParameterList([torch.from_numpy(arrays[n]).to(device) for n in DECODER_NAMES])

    @property
    def decoders(self) -> dict[str, torch.nn.Parameter]:
        """The decoders' weights by name, in the order of the parameter layout."""
        return dict(zip(DECODER_NAMES, self._decoders, strict=True))

    def encode(self, points_m: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n blob"]]:
        """Grid features and one-blob code of world points [m]."""
        blob = one_blob(points_m, self._period_m.to(points_m.dtype), self.config.blob_bins)
        return self._grid.features(points_m, *self.planes), blob

    def grid_features(self, points_m: Float[Tensor, "n 3"]) -> Float[Tensor, "n features"]:
        """Grid features alone, for the smoothness term."""
        return self._grid.features(points_m, *self.planes)

    def decode_sdf(
        self, features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
    ) -> Float[Tensor, "n outputs"]:
        """The SDF s in column 0 and the geometry features in the others."""
        return decode_sdf(self.decoders["sdf_hidden"], self.decoders["sdf_out"], features, blob)

    def decode_color(
        self, blob: Float[Tensor, "n blob"], geometry: Float[Tensor, "n geometry"]
    ) -> Float[Tensor, "n 3"]:
        """Red, green, blue in [0, 1]."""
        return decode_color(self.decoders["color_hidden"], self.decoders["color_out"], blob, geometry)


def decode_sdf(
    hidden: Float[Tensor, "hidden inputs"],
    out: Float[Tensor, "outputs hidden"],
    features: Float[Tensor, "n features"],
    blob: Float[Tensor, "n blob"],
) -> Float[Tensor, "n outputs"]:
    """The SDF decoder with given weights."""
    return sdf_hidden(hidden, features, blob) @ out.t()


def sdf_hidden(
    hidden: Float[Tensor, "hidden inputs"], features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
) -> Float[Tensor, "n hidden"]:
    """The hidden layer of the SDF decoder with given weights."""
    # Two products instead of one on joined inputs: joining would copy them, at a tenth of a training step's cost.
    split = features.shape[1]
    return torch.relu(torch.addmm(features @ hidden[:, :split].t(), blob, hidden[:, split:].t()))


def decode_color(
    hidden: Float[Tensor, "hidden inputs"],
    out: Float[Tensor, "3 hidden"],
    blob: Float[Tensor, "n blob"],
    geometry: Float[Tensor, "n geometry"],
) -> Float[Tensor, "n 3"]:
    """The colour decoder with given weights; the sigmoid keeps colours in [0, 1]."""
    split = blob.shape[1]
    joined = torch.addmm(blob @ hidden[:, :split].t(), geometry, hidden[:, split:].t())
    return torch.sigmoid(torch.relu(joined) @ out.t())
