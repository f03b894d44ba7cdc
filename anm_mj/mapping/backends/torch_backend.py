"""The reference engine, in torch: runs anywhere, and is what the other engines are tested against."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.mapping.backends.adam import Adam
from anm_mj.mapping.backends.backend import StepLosses
from anm_mj.mapping.backends.parameters import DECODER_NAMES, check_state, decoder_shapes, parameter_shapes, split_flat
from anm_mj.mapping.backends.tensor_backend import HashGridBackend
from anm_mj.mapping.backends.torch_field import TorchField, decode_color, decode_sdf
from anm_mj.mapping.backends.torch_losses import ray_losses, smoothness_lattice, smoothness_loss
from anm_mj.mapping.backends.torch_sampling import sample_depths, valid_depth
from anm_mj.mapping.backends.volume_rendering import composite, sdf_to_weight
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch


class TorchBackend(HashGridBackend):
    """Implements :class:`~anm_mj.mapping.backends.backend.MapperBackend` with autograd."""

    name = "torch"

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        super().__init__(config, device)
        self.field = TorchField(config.field, seed, self._device)
        self._optimizer = self._make_optimizer()

    def _make_optimizer(self) -> Adam:
        return Adam(self.config.optimizer, list(self.field.planes), list(self.field.decoders.values()))

    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration: sample, render, losses, gradients, Adam; see the base class."""
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
        """The SDF s at world points, in fractions of the truncation; see the base class."""
        return self._ask(points_m, lambda points: self.field.decode_sdf(*self.field.encode(points))[:, 0])

    @torch.no_grad()
    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours under ``k`` sets of decoder weights; see the base class."""
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

    def get_state(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """Copies of all parameters by name."""
        state = {"table": np.stack([plane.detach().cpu().numpy() for plane in self.field.planes], axis=1)}
        for name in DECODER_NAMES:
            state[name] = self.field.decoders[name].detach().cpu().numpy().copy()
        return state

    @torch.no_grad()
    def set_state(self, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Take over parameters by name and start the optimiser afresh; see the base class."""
        check_state(state, parameter_shapes(self.config.field))
        for plane, column in zip(self.field.planes, state["table"].T, strict=True):
            plane.copy_(torch.from_numpy(column.copy()))
        for name in DECODER_NAMES:
            self.field.decoders[name].copy_(torch.from_numpy(state[name]))
        self._optimizer = self._make_optimizer()

    def get_optimizer(self) -> dict[str, np.ndarray]:
        """Adam's moments and steps; see the base class."""
        return self._optimizer.get_state()

    def set_optimizer(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_optimizer` gave; see the base class."""
        self._optimizer.set_state(state)

    def _encode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n blob"]]:
        return self.field.encode(points)

    def _decode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        features, blob = self.field.encode(points)
        outputs = self.field.decode_sdf(features, blob)
        return outputs[:, 0], self.field.decode_color(blob, outputs[:, 1:])

    def _decoders(self) -> list[Float[Tensor, "_ _"]]:
        return list(self.field.decoders.values())

    def _split_decoders(self, weights: Float32[np.ndarray, " weights"]) -> list[Tensor]:
        return [self._tensor(part) for part in split_flat(weights, decoder_shapes(self.config.field)).values()]
