"""The reference engine, in torch: runs anywhere, and is what the other engines are tested against."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.adam import Adam
from anm_mj.mapping.backends.backend import StepLosses
from anm_mj.mapping.config import MappingConfig
from anm_mj.mapping.field import (
    DECODER_NAMES,
    NeuralField,
    check_state,
    decode_color,
    decode_sdf,
    decoder_shapes,
    parameter_shapes,
    sdf_hidden,
    split_flat,
)
from anm_mj.mapping.losses import ray_losses, smoothness_lattice, smoothness_loss
from anm_mj.mapping.pixel_memory import HostPixels
from anm_mj.mapping.rays import RayBatch
from anm_mj.mapping.rendering import composite, sdf_to_weight
from anm_mj.mapping.sampling import sample_depths, valid_depth

_CPU_CHUNK = 8192
"""Points per query on a CPU: the temporaries of so many stay in the second-level cache's reach."""
_CUDA_CHUNK = 1 << 18
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


class TorchBackend:
    """Implements :class:`~anm_mj.mapping.backends.backend.MapperBackend` with autograd."""

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        self.config = config
        self._device = resolve_device(device)
        self._chunk = _CUDA_CHUNK if self._device.type == "cuda" else _CPU_CHUNK
        self.field = NeuralField(config.field, seed, self._device)
        self._optimizer = self._make_optimizer()

    @property
    def name(self) -> str:
        """Which engine it is: "torch"."""
        return "torch"

    @property
    def device(self) -> str:
        """Where it computes: "cpu" or "cuda"."""
        return self._device.type

    def _make_optimizer(self) -> Adam:
        return Adam(self.config.optimizer, list(self.field.planes), list(self.field.decoders.values()))

    def pixel_memory(self, count: int) -> HostPixels:
        """Room for so many pixels to replay; see the protocol."""
        return HostPixels(count)

    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration: sample, render, losses, gradients, Adam; see the protocol."""
        cfg = self.config
        depth = self._tensor(rays.depth_m)
        z = sample_depths(depth, cfg.sampling, cfg.field.truncation_m, seed)
        points = self._tensor(rays.origin_m)[:, None] + self._tensor(rays.direction)[:, None] * z[:, :, None]
        s, rgb = self._decode(points.view(-1, 3))
        s, rgb = s.view(z.shape), rgb.view(*z.shape, 3)
        weights = sdf_to_weight(s, z, cfg.field.truncation_m)
        terms = ray_losses(
            s,
            z,
            composite(weights, rgb),
            (weights * z).sum(dim=1),
            self._tensor(rays.rgb),
            depth,
            valid_depth(depth, cfg.sampling),
            cfg.field.truncation_m,
            cfg.loss,
        )
        total, smoothness = terms.total, terms.smoothness
        if smoothness_corner_m is not None:
            lattice = smoothness_lattice(self._tensor(smoothness_corner_m), cfg.loss)
            smoothness = smoothness_loss(self.field.grid_features(lattice), cfg.loss)
            total = total + cfg.loss.smoothness * smoothness
        self._optimizer.zero_grad()
        total.backward()
        self._optimizer.step()
        values = torch.stack((total, terms.rgb, terms.depth, terms.sdf, terms.free_space, smoothness)).detach()
        return StepLosses(*values.tolist())

    @torch.no_grad()
    def query_sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The SDF s at world points, in fractions of the truncation; see the protocol."""
        out = np.empty(len(points_m), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = self.field.decode_sdf(*self.field.encode(points))[:, 0].cpu().numpy()
        return out

    @torch.no_grad()
    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points; see the protocol."""
        out = np.empty((len(points_m), 3), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = self._decode(points)[1].cpu().numpy()
        return out

    @torch.no_grad()
    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours under ``k`` sets of decoder weights; see the protocol."""
        s_out = np.empty((len(decoders), len(points_m)), np.float32)
        rgb_out = np.empty((len(decoders), len(points_m), 3), np.float32)
        weight_sets = [self._split_decoders(row) for row in decoders]
        for rows, points in self._chunks(points_m):
            features, blob = self.field.encode(points)
            for k, (in_sdf, out_sdf, in_color, out_color) in enumerate(weight_sets):
                outputs = decode_sdf(in_sdf, out_sdf, features, blob)
                s_out[k, rows] = outputs[:, 0].cpu().numpy()
                rgb_out[k, rows] = decode_color(in_color, out_color, blob, outputs[:, 1:]).cpu().numpy()
        return s_out, rgb_out

    @torch.no_grad()
    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """The SDF decoder's hidden layer at world points; see the protocol."""
        weights = self.field.decoders["sdf_hidden"]
        out = np.empty((len(points_m), len(weights)), np.float32)
        for rows, points in self._chunks(points_m):
            out[rows] = sdf_hidden(weights, *self.field.encode(points)).cpu().numpy()
        return out

    @torch.no_grad()
    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared gradient norms by all decoder weights; see the protocol."""
        s_out = np.empty(len(points_m), np.float32)
        rgb_out = np.empty(len(points_m), np.float32)
        for rows, points in self._chunks(points_m):
            s, rgb = sensitivity(list(self.field.decoders.values()), *self.field.encode(points))
            s_out[rows], rgb_out[rows] = s.cpu().numpy(), rgb.cpu().numpy()
        return s_out, rgb_out

    @torch.no_grad()
    def render(
        self,
        origin_m: Float32[np.ndarray, "n 3"],
        direction: Float32[np.ndarray, "n 3"],
        z_m: Float32[np.ndarray, "n samples"],
    ) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, " n"]]:
        """Rendered colour and planar depth of rays; see the protocol."""
        rgb_out = np.empty((len(z_m), 3), np.float32)
        depth_out = np.empty(len(z_m), np.float32)
        chunk = max(1, self._chunk // z_m.shape[1])
        for start in range(0, len(z_m), chunk):
            rows = slice(start, start + chunk)
            z = self._tensor(z_m[rows])
            points = self._tensor(origin_m[rows])[:, None] + self._tensor(direction[rows])[:, None] * z[:, :, None]
            s, rgb = self._decode(points.view(-1, 3))
            weights = sdf_to_weight(s.view(z.shape), z, self.config.field.truncation_m)
            rgb_out[rows] = composite(weights, rgb.view(*z.shape, 3)).cpu().numpy()
            depth_out[rows] = (weights * z).sum(dim=1).cpu().numpy()
        return rgb_out, depth_out

    def get_state(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """Copies of all parameters by name."""
        state = {"table": np.stack([plane.detach().cpu().numpy() for plane in self.field.planes], axis=1)}
        for name in DECODER_NAMES:
            state[name] = self.field.decoders[name].detach().cpu().numpy().copy()
        return state

    @torch.no_grad()
    def set_state(self, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Take over parameters by name and start the optimiser afresh; see the protocol."""
        check_state(state, parameter_shapes(self.config.field))
        for plane, column in zip(self.field.planes, state["table"].T, strict=True):
            plane.copy_(torch.from_numpy(column.copy()))
        for name in DECODER_NAMES:
            self.field.decoders[name].copy_(torch.from_numpy(state[name]))
        self._optimizer = self._make_optimizer()

    def _decode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        features, blob = self.field.encode(points)
        outputs = self.field.decode_sdf(features, blob)
        return outputs[:, 0], self.field.decode_color(blob, outputs[:, 1:])

    def _chunks(self, points_m: Float[np.ndarray, "n 3"]) -> Iterator[tuple[slice, Float[Tensor, "m 3"]]]:
        for start in range(0, len(points_m), self._chunk):
            rows = slice(start, start + self._chunk)
            yield rows, self._tensor(points_m[rows])

    def _tensor(self, array: Float[np.ndarray, "..."]) -> Float[Tensor, "..."]:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32)).to(self._device)

    def _split_decoders(self, weights: Float32[np.ndarray, " weights"]) -> list[Tensor]:
        return [self._tensor(part) for part in split_flat(weights, decoder_shapes(self.config.field)).values()]


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
