"""Parameters, moments and gradients of the Triton engine in device memory, and the kernels that read the field.

All parameters lie in one flat array in the order of :mod:`anm_mj.mapping.field`, and so do the moments. The arrays stay
where they are for as long as the engine lives, because captured CUDA graphs hold their addresses.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends import triton_kernels as kernels
from anm_mj.mapping.config import MappingConfig
from anm_mj.mapping.encoding import NUM_FEATURES, cell_sizes_m, index_factors
from anm_mj.mapping.field import decoder_shapes

_MAX_WIDTH = 128
"""Most neurons, outputs, features and samples per ray that fit a program's registers."""
_MIN_PRODUCT = 16
"""Smallest edge of a matrix in Triton's products."""
_ENCODE_POINTS = 128
"""Points per program of the encoding on a GPU."""
_DECODE_POINTS = 64
"""Points per program of the decoders on a GPU: what they hold per point nearly fills the registers."""
_INTERPRETED_POINTS = 4096
"""Points per program in the interpreter, where each operation costs the same for one point as for thousands."""


def padded(size: int) -> int:
    """The next power of two that a matrix product can work on."""
    return max(_MIN_PRODUCT, 1 << (size - 1).bit_length())


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
        self._shapes = {"table": (self.levels * self.entries, NUM_FEATURES), **decoder_shapes(field)}
        self.table_size = self.levels * self.entries * NUM_FEATURES
        size = sum(rows * columns for rows, columns in self._shapes.values())
        self.num_weights = size - self.table_size
        self.parameters = torch.zeros(size, device=device)
        self.first = torch.zeros(size, device=device)
        self.second = torch.zeros(size, device=device)
        self.table_gradient = torch.zeros(self.table_size, device=device)
        factors, masks = index_factors(field)
        self._grid_floats = torch.from_numpy((1.0 / cell_sizes_m(field)).astype(np.float32)).to(device)
        self._grid_ints = torch.from_numpy(np.concatenate((factors, masks)).astype(np.int32)).to(device)
        bins_per_m = np.float32(field.blob_bins) / np.array(field.blob_period_m, np.float32)
        self.bins_per_m = torch.from_numpy(bins_per_m).to(device)
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
        self._encode_points = _INTERPRETED_POINTS if kernels.INTERPRETED else _ENCODE_POINTS
        self._decode_points = _INTERPRETED_POINTS if kernels.INTERPRETED else _DECODE_POINTS

    @property
    def weights(self) -> Float[Tensor, " weights"]:
        """The decoders' part of the parameters; a view."""
        return self.parameters[self.table_size :]

    def get_state(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """Copies of all parameters by name."""
        return self.split(self.parameters.cpu().numpy())

    def set_state(self, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Take over parameters by name; moments become zero.

        Raises:
            MapError: If a name is missing or a shape differs from the configuration's.
        """
        for name, shape in self._shapes.items():
            if name not in state:
                raise MapError(f"The map's state lacks {name!r}; it has {sorted(state)}.")
            if state[name].shape != shape:
                raise MapError(f"The map's {name!r} has shape {state[name].shape}, but its configuration says {shape}.")
        flat = np.concatenate([np.asarray(state[name], np.float32).ravel() for name in self._shapes])
        self.parameters.copy_(torch.from_numpy(flat))
        self.first.zero_()
        self.second.zero_()
        self.table_gradient.zero_()

    def split(self, flat: Float32[np.ndarray, " size"]) -> dict[str, Float32[np.ndarray, "..."]]:
        """A flat array in the parameters' layout as copies by name."""
        parts, start = {}, 0
        for name, shape in self._shapes.items():
            end = start + shape[0] * shape[1]
            parts[name] = flat[start:end].reshape(shape).copy()
            start = end
        return parts

    def split_weights(self) -> list[Float[Tensor, "rows columns"]]:
        """The decoders' matrices in the order of the layout; views."""
        shapes = [shape for name, shape in self._shapes.items() if name != "table"]
        sizes = [rows * columns for rows, columns in shapes]
        return [part.view(shape) for part, shape in zip(self.weights.split(sizes), shapes, strict=True)]

    def encode_into(self, features: Float[Tensor, "features n"], points_m: Float[Tensor, "3 n"]) -> None:
        """Write the grid features of world points [m]."""
        count = points_m.shape[1]
        kernels.encode[(-(-count // self._encode_points), self.levels)](
            points_m,
            count,
            self.parameters,
            self.entries,
            features,
            self._grid_floats,
            self._grid_ints,
            LEVELS=self.levels,
            POINTS=self._encode_points,
            # So that cells are those of the other engines bit for bit.
            **kernels.EXACT,
        )

    def scatter(self, points_m: Float[Tensor, "3 n"], count: Tensor, gradient: Float[Tensor, "features n"]) -> None:
        """Add the gradients by the features of the first points, ``count`` in device memory, to the table's."""
        stride = points_m.shape[1]
        kernels.scatter[(-(-stride // self._encode_points), self.levels)](
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
            **kernels.EXACT,
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
        kernels.decode[(-(-count // self._decode_points), sets)](
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
            **kernels.FUSED,
        )
        return s, rgb
