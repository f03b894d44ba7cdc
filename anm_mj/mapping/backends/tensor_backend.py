"""What the engines that compute with torch tensors share: numpy at the border, and queries in chunks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend, RenderedRays, SampleDepths, Vectors
from anm_mj.mapping.backends.torch_field import sdf_hidden
from anm_mj.mapping.backends.volume_rendering import composite, sdf_to_weight
from anm_mj.mapping.mapping_config import MappingConfig

CPU_CHUNK = 8192
"""Points per query on a CPU: the temporaries of so many stay in the second-level cache's reach."""
CUDA_CHUNK = 1 << 18
"""Points per query on a GPU."""


def resolve_device(device: str) -> torch.device:
    """The torch device for "auto", "cpu" or "cuda".

    Raises:
        MapError: If the name is another one, or CUDA is asked for and not there.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise MapError(f"The mapping device is {device!r}, but it must be 'auto', 'cpu' or 'cuda'.")
    if device == "cuda" and not torch.cuda.is_available():
        raise MapError("The mapping device is 'cuda', but torch finds no CUDA device; use 'auto' or 'cpu'.")
    use_cuda = device == "cuda" or (device == "auto" and torch.cuda.is_available())
    return torch.device("cuda" if use_cuda else "cpu")


class TensorBackend(MapperBackend):
    """Base of engines that compute with torch tensors on one device."""

    def __init__(self, config: MappingConfig, device: str, chunk: int | None = None) -> None:
        """Choose the device.

        Args:
            config: The mapping configuration.
            device: "auto", "cpu" or "cuda".
            chunk: Points per query; None for what suits the device.

        Raises:
            MapError: If the device is unknown or absent.
        """
        self.config = config
        self._device = resolve_device(device)
        self.device = self._device.type
        self._chunk = chunk or (CUDA_CHUNK if self.device == "cuda" else CPU_CHUNK)

    def _tensor(self, array: Float[np.ndarray, "..."]) -> Float[Tensor, "..."]:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self._device)

    def _chunks(
        self, points_m: Float[np.ndarray, "n 3"], chunk: int | None = None
    ) -> Iterator[tuple[slice, Float[Tensor, "m 3"]]]:
        """Points in pieces of ``chunk`` (the engine's own by default), each with its rows."""
        chunk = chunk or self._chunk
        for start in range(0, len(points_m), chunk):
            rows = slice(start, start + chunk)
            yield rows, self._tensor(points_m[rows])

    def _ask(
        self, points_m: Float[np.ndarray, "n 3"], answer: Callable[[Tensor], Tensor], *width: int
    ) -> Float32[np.ndarray, "n ..."]:
        """What ``answer`` says about each point, in arrays of shape ``width``; asked chunk by chunk."""
        out = np.empty((len(points_m), *width), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = answer(points).cpu().numpy()
        return out


class HashGridBackend(TensorBackend):
    """Base of engines that hold the hash grid and its decoders as tensors."""

    @abstractmethod
    def _encode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n blob"]]:
        """Grid features and one-blob code of world points [m]."""

    @abstractmethod
    def _decode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        """The SDF s and colour at world points [m]."""

    @abstractmethod
    def _decoders(self) -> Sequence[Float[Tensor, "_ _"]]:
        """The decoders' matrices in the order of the parameter layout."""

    @torch.no_grad()
    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points; see the base class."""
        return self._ask(points_m, lambda points: self._decode(points)[1], 3)

    @torch.no_grad()
    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """The SDF decoder's hidden layer at world points; see the base class."""
        weights = self._decoders()[0]
        return self._ask(points_m, lambda points: sdf_hidden(weights, *self._encode(points)), len(weights))

    @torch.no_grad()
    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared gradient norms by all decoder weights; see the base class."""
        both = self._ask(
            points_m, lambda points: torch.stack(sensitivity(self._decoders(), *self._encode(points)), dim=1), 2
        )
        return both[:, 0].copy(), both[:, 1].copy()

    @torch.no_grad()
    def render(self, origin_m: Vectors, direction: Vectors, z_m: SampleDepths) -> RenderedRays:
        """Rendered colour and planar depth of rays; see the base class."""
        rgb_out = np.empty((len(z_m), 3), np.float32)
        depth_out = np.empty(len(z_m), np.float32)
        chunk = max(1, self._chunk // z_m.shape[1])
        for start in range(0, len(z_m), chunk):
            rows = slice(start, start + chunk)
            z = self._tensor(z_m[rows])
            points = self._tensor(origin_m[rows])[:, None] + self._tensor(direction[rows])[:, None] * z[:, :, None]
            s, rgb = self._decode(points.view(-1, 3))
            weights = sdf_to_weight(s.view(z.shape), z, self.config.field.truncation_m)
            rgb_out[rows] = composite(weights, rgb.reshape(*z.shape, 3)).cpu().numpy()
            depth_out[rows] = (weights * z).sum(dim=1).cpu().numpy()
        return rgb_out, depth_out


def sensitivity(
    decoders: Sequence[Float[Tensor, "_ _"]], features: Float[Tensor, "n features"], blob: Float[Tensor, "n blob"]
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Squared norms of the gradients by all decoder weights, of s and of the colour (mean of the three channels).

    Each layer's weight gradient is an outer product, so its squared norm is a product of two squared norms and no
    gradient has to be formed.

    Args:
        decoders: The decoders' matrices in the order of the parameter layout.
        features: Grid features.
        blob: One-blob codes.
    """
    sdf_hidden, sdf_out, color_hidden, color_out = decoders
    geometry_columns = color_hidden[:, blob.shape[1] :]
    sdf_input = torch.cat((features, blob), dim=1)
    hidden = torch.relu(sdf_input @ sdf_hidden.t())
    active = hidden > 0.0
    outputs = hidden @ sdf_out.t()
    input_norm, hidden_norm = _square_norm(sdf_input), _square_norm(hidden)
    of_s = hidden_norm + _square_norm(active * sdf_out[0]) * input_norm
    color_input = torch.cat((blob, outputs[:, 1:]), dim=1)
    color_hid = torch.relu(color_input @ color_hidden.t())
    color = torch.sigmoid(color_hid @ color_out.t())
    total = torch.zeros_like(input_norm)
    for channel in range(3):
        back_color = (color_hid > 0.0) * color_out[channel]
        back_geometry = back_color @ geometry_columns
        back_hidden = active * (back_geometry @ sdf_out[1:])
        squares = _square_norm(color_hid) + _square_norm(back_color) * _square_norm(color_input)
        squares += _square_norm(back_geometry) * hidden_norm + _square_norm(back_hidden) * input_norm
        slope = color[:, channel] * (1.0 - color[:, channel])
        total += slope.square() * squares
    return of_s, total / 3.0


def _square_norm(rows: Float[Tensor, "n width"]) -> Float[Tensor, " n"]:
    return rows.square().sum(dim=1)
