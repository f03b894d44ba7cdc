"""The reference engine, in torch: runs anywhere, and is what the other engines are tested against."""

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.mapping.backends.backend import Parameters, RenderedRays, SampleDepths, StepLosses, Vectors
from anm_mj.mapping.backends.parameters import check_shapes, decoder_shapes, parameter_shapes, split_flat
from anm_mj.mapping.backends.tensor_backend import Adam, TensorBackend
from anm_mj.mapping.backends.torch_field import TorchField, decode_color, decode_sdf, sdf_hidden, sensitivity
from anm_mj.mapping.backends.torch_losses import (
    composite,
    ray_losses,
    sdf_to_weight,
    smoothness_lattice,
    smoothness_loss,
)
from anm_mj.mapping.backends.torch_sampling import sample_depths, valid_depth
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch


class TorchBackend(TensorBackend):
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
        return self._ask(points_m, lambda points: decode_sdf(self.field.decoders, *self.field.encode(points))[:, 0])

    @torch.no_grad()
    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points; see the base class."""
        return self._ask(points_m, lambda points: self._decode(points)[1], 3)

    @torch.no_grad()
    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """The SDF decoder's hidden layer at world points; see the base class."""
        weights = self.field.decoders["sdf_hidden"]
        return self._ask(points_m, lambda points: sdf_hidden(weights, *self.field.encode(points)), len(weights))

    @torch.no_grad()
    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared gradient norms by all decoder weights; see the base class."""
        decoders = list(self.field.decoders.values())
        both = self._ask(
            points_m, lambda points: torch.stack(sensitivity(decoders, *self.field.encode(points)), dim=1), 2
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

    @torch.no_grad()
    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours under ``k`` sets of decoder weights; see the base class."""
        s_out = np.empty((len(decoders), len(points_m)), np.float32)
        rgb_out = np.empty((len(decoders), len(points_m), 3), np.float32)
        shapes = decoder_shapes(self.config.field)
        weight_sets = [{n: self._tensor(part) for n, part in split_flat(row, shapes).items()} for row in decoders]
        for rows, points in self._chunks(points_m):
            features, blob = self.field.encode(points)
            for k, weights in enumerate(weight_sets):
                outputs = decode_sdf(weights, features, blob)
                s_out[k, rows] = outputs[:, 0].cpu().numpy()
                rgb_out[k, rows] = decode_color(weights, blob, outputs[:, 1:]).cpu().numpy()
        return s_out, rgb_out

    def parameters(self) -> Parameters:
        """Copies of all parameters by name."""
        table = np.stack([plane.detach().cpu().numpy() for plane in self.field.planes], axis=1)
        decoders = {name: weight.detach().cpu().numpy().copy() for name, weight in self.field.decoders.items()}
        return {"table": table, **decoders}

    @torch.no_grad()
    def set_parameters(self, parameters: Parameters) -> None:
        """Take over parameters by name and start the optimiser afresh; see the base class."""
        check_shapes(parameters, parameter_shapes(self.config.field))
        for plane, column in zip(self.field.planes, parameters["table"].T, strict=True):
            plane.copy_(torch.from_numpy(column.copy()))
        for name, weight in self.field.decoders.items():
            weight.copy_(torch.from_numpy(parameters[name]))
        self._optimizer = self._make_optimizer()

    def _decode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        features, blob = self.field.encode(points)
        outputs = decode_sdf(self.field.decoders, features, blob)
        return outputs[:, 0], decode_color(self.field.decoders, blob, outputs[:, 1:])
