"""Parameters, moments and gradients of the Triton engine in device memory, and the kernels that read the field.

All parameters lie in one flat array in the order of :mod:`anm_mj.mapping.parameters`, and so do the moments. The arrays
stay where they are for as long as the engine lives, because captured CUDA graphs hold their addresses.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.triton.decoders import decode_kernel
from anm_mj.mapping.backends.triton.encoding import encode_kernel, scatter_kernel
from anm_mj.mapping.backends.triton.launch import EXACT, FUSED, block, num_blocks, padded
from anm_mj.mapping.config import MappingConfig
from anm_mj.mapping.grid_layout import NUM_FEATURES, bins_per_m, cells_per_m, index_factors
from anm_mj.mapping.parameters import check_state, decoder_shapes, parameter_shapes, split_flat

_MAX_WIDTH = 128
"""Most neurons, outputs, features and samples per ray that fit a program's registers."""
_ENCODE_POINTS = 128
"""Points per program of the encoding on a GPU."""
_DECODE_POINTS = 64
"""Points per program of the decoders on a GPU: what they hold per point nearly fills the registers."""
_INTERPRETED_POINTS = 4096
"""Points per program in the interpreter, where each operation costs the same for one point as for thousands."""


class TritonField:
    """The flat arrays, the constants of the encoding, and the launches of encoding and decoders."""

    def __init__(self, config: MappingConfig, device: torch.device) -> None:
        """Arrays of zeros on ``device``.

        Raises:
            MapError: If a layer or a ray's samples are too many for the kernels.
        """
        field = config.field
        features, outputs, blob = NUM_FEATURES * field.num_levels, 1 + field.geometry_features, 3 * field.blob_bins
        widest = max(field.hidden_width, outputs, blob, config.sampling.samples_per_ray)
        if widest > _MAX_WIDTH:
            raise MapError(
                f"The Triton engine holds at most {_MAX_WIDTH} neurons, outputs, blob values or samples, but {widest} "
                "are configured; use engine 'torch'."
            )
        self.device = device
        self.levels = field.num_levels
        self.entries = 1 << field.log2_table_size
        self._shapes = parameter_shapes(field)
        self._decoder_shapes = decoder_shapes(field)
        self.table_size = math.prod(self._shapes["table"])
        size = sum(math.prod(shape) for shape in self._shapes.values())
        self.num_weights = size - self.table_size
        self.parameters = torch.zeros(size, device=device)
        self.first = torch.zeros(size, device=device)
        self.second = torch.zeros(size, device=device)
        self.table_gradient = torch.zeros(self.table_size, device=device)
        factors, masks = index_factors(field)
        self._grid_floats = torch.from_numpy(cells_per_m(field)).to(device)
        self._grid_ints = torch.from_numpy(np.concatenate((factors, masks)).astype(np.int32)).to(device)
        self.bins_per_m = torch.from_numpy(bins_per_m(field)).to(device)
        self.sizes = {
            "FEATURES": features,
            "BINS": field.blob_bins,
            "HIDDEN": field.hidden_width,
            "OUTPUTS": outputs,
            "FEATURES_PAD": padded(features),
            "BLOB_PAD": padded(blob),
            "HIDDEN_PAD": padded(field.hidden_width),
            "OUTPUTS_PAD": padded(outputs),
        }
        self._encode_points = block(_ENCODE_POINTS, _INTERPRETED_POINTS)
        self._decode_points = block(_DECODE_POINTS, _INTERPRETED_POINTS)

    @property
    def weights(self) -> Float[Tensor, " weights"]:
        """The decoders' part of the parameters; a view."""
        return self.parameters[self.table_size :]

    def get_state(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """Copies of all parameters by name."""
        return self.split(self.parameters)

    def set_state(self, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Take over parameters by name; moments become zero.

        Raises:
            MapError: If a name is missing or a shape differs from the configuration's.
        """
        check_state(state, self._shapes)
        flat = np.concatenate([np.asarray(state[name], np.float32).ravel() for name in self._shapes])
        self.parameters.copy_(torch.from_numpy(flat))
        self.first.zero_()
        self.second.zero_()
        self.table_gradient.zero_()

    def split(self, flat: Float[Tensor, " size"]) -> dict[str, Float32[np.ndarray, "..."]]:
        """What lies in the parameters' layout, as arrays of the host by name."""
        return {name: part.copy() for name, part in split_flat(flat.cpu().numpy(), self._shapes).items()}

    def split_weights(self) -> list[Float[Tensor, "rows columns"]]:
        """The decoders' matrices in the order of the layout; views."""
        return list(split_flat(self.weights, self._decoder_shapes).values())

    def encode_into(self, features: Float[Tensor, "features n"], points_m: Float[Tensor, "3 n"]) -> None:
        """Write the grid features of world points [m]."""
        count = points_m.shape[1]
        encode_kernel[(num_blocks(count, self._encode_points), self.levels)](
            points_m,
            count,
            self.parameters,
            self.entries,
            features,
            self._grid_floats,
            self._grid_ints,
            LEVELS=self.levels,
            POINTS=self._encode_points,
            **EXACT,
        )

    def scatter(self, points_m: Float[Tensor, "3 n"], count: Tensor, gradient: Float[Tensor, "features n"]) -> None:
        """Add the gradients by the features of the first points, ``count`` in device memory, to the table's."""
        stride = points_m.shape[1]
        scatter_kernel[(num_blocks(stride, self._encode_points), self.levels)](
            points_m,
            stride,
            count,
            gradient,
            self.table_gradient,
            self.entries,
            self._grid_floats,
            self._grid_ints,
            LEVELS=self.levels,
            POINTS=self._encode_points,
            **EXACT,
        )

    def features(self, points_m: Float[Tensor, "3 n"]) -> Float[Tensor, "features n"]:
        """The grid features of world points [m]."""
        out = torch.empty(NUM_FEATURES * self.levels, points_m.shape[1], device=self.device)
        self.encode_into(out, points_m)
        return out

    def decode(
        self, points_m: Float[Tensor, "3 n"], weights: Float[Tensor, "k weights"], *, color: bool = True
    ) -> tuple[Float[Tensor, "k n"], Float[Tensor, "_ 3 n"]]:
        """The SDF s and colour at world points [m] under sets of decoder weights; no colour unless asked for."""
        count, sets = points_m.shape[1], len(weights)
        s = torch.empty(sets, count, device=self.device)
        rgb = torch.empty(sets if color else 0, 3, count, device=self.device)
        decode_kernel[(num_blocks(count, self._decode_points), sets)](
            points_m,
            self.features(points_m),
            count,
            self.bins_per_m,
            weights,
            self.num_weights,
            s,
            rgb if color else s,
            COLOR=color,
            POINTS=self._decode_points,
            **self.sizes,
            **FUSED,
        )
        return s, rgb
