"""One multi-layer perceptron as the whole map, as Active Neural Mapping (Yan et al., ICCV 2023) had it.

The network and its losses are those of iSDF (Ortiz et al., RSS 2022): a position is projected on the directions of an
icosahedron, coded at six octaves and taken to a signed distance; samples along rays are bounded by the distance to the
measured surface. It has no colours. It stands at the same border as the engines of the hash grid, so that replay,
occupancy, surface and mesh are the same code; it is here to compare with, and runs in torch alone.

Deviations: rays come from all keyframes evenly and from the frame at hand instead of a window of five frames chosen by
loss; the term on gradient directions (weight 0.018) is left out.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float, Float32
from torch import Tensor

from anm_mj.mapping.backends.backend import Parameters, RenderedRays, SampleDepths, StepLosses, Vectors
from anm_mj.mapping.backends.parameters import check_shapes
from anm_mj.mapping.backends.tensor_backend import CPU_CHUNK, Adam, TensorBackend
from anm_mj.mapping.backends.torch_losses import sdf_to_weight
from anm_mj.mapping.backends.torch_sampling import counter_uniform
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch

NUM_OCTAVES = 6
POSITION_SCALE = 0.0594
"""Metres to the input's unit."""
WIDTH = 256
NUM_HIDDEN = 4
"""Hidden layers; the input joins again in the middle."""
SOFTPLUS_BETA = 100.0
OUTPUT_SCALE = 0.14
"""The network's output to metres."""
TRUNCATION_M = 0.2937
"""Samples nearer to the surface than this are held to their bound, others are kept below it [m]."""
TRUNCATION_WEIGHT = 5.383
FREE_SPACE_FACTOR = 5.0
"""How steeply negative distances in free space are punished."""
EIKONAL_WEIGHT = 0.268
EIKONAL_FROM_M = 0.1
"""Samples farther from the surface than this must have a gradient of length one [m]."""
NUM_STRATIFIED, NUM_SURFACE = 5, 2
"""Samples per ray: over its length, and about the surface."""
SURFACE_STD_M = 0.1
NEAREST_M = 0.07
WEIGHT_DECAY = 0.012
GREY = 0.5
"""The colour of a map without colours."""


@dataclass
class _Layers:
    """What each layer is given, and what it sums up to."""

    inputs: list[Tensor] = field(default_factory=list)
    sums: list[Tensor] = field(default_factory=list)


class MlpBackend(TensorBackend):
    """Implements :class:`~anm_mj.mapping.backends.backend.MapperBackend` by a network of its own."""

    name = "mlp"

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        """Start values are drawn from ``seed``. Raises MapError if the device is unknown or absent."""
        super().__init__(config, device, CPU_CHUNK)
        # Half of the 42 vertices of a subdivided icosahedron: the other half are their opposites.
        sphere = np.asarray(trimesh.creation.icosphere(subdivisions=1).vertices)
        order = np.lexsort(np.round(sphere, 6).T)
        self._directions = self._tensor(sphere[order][len(sphere) // 2 :].T)
        rng = np.random.default_rng([seed, 2])
        self._weights = [
            self._tensor(rng.uniform(-1.0, 1.0, shape) / math.sqrt(fan_in)).requires_grad_()
            for fan_in, shape in _shapes(3 + 2 * NUM_OCTAVES * self._directions.shape[1])
        ]
        self._optimizer = Adam(config.optimizer, [], self._weights)

    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration on the rays that have depth, without colours and a smoothness term; see the base class."""
        del smoothness_corner_m
        depth = self._tensor(rays.depth_m)
        valid = (depth > NEAREST_M) & (depth <= self.config.sampling.max_depth_m)
        if not bool(valid.any()):
            return StepLosses(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        direction, depth = self._tensor(rays.direction)[valid], depth[valid]
        z = _sample(depth, seed)
        points = (self._tensor(rays.origin_m)[valid][:, None] + direction[:, None] * z[:, :, None]).view(-1, 3)
        bound = ((depth[:, None] - z) * direction.norm(dim=1, keepdim=True)).view(-1)
        points.requires_grad_()
        distance = self._distance(points, self._weights)
        (gradient,) = torch.autograd.grad(distance.sum(), points, create_graph=True)
        near = bound < TRUNCATION_M
        too_low = torch.exp((-FREE_SPACE_FACTOR * distance).clamp_max(10.0)) - 1.0
        free = torch.maximum(too_low, distance - bound).clamp_min(0.0)
        surface = (distance - bound).abs()
        eikonal = (gradient.norm(dim=1) - 1.0).abs()
        terms = (
            TRUNCATION_WEIGHT * _mean_of(surface, near),
            _mean_of(free, ~near),
            EIKONAL_WEIGHT * _mean_of(eikonal, bound > EIKONAL_FROM_M),
        )
        total = terms[0] + terms[1] + terms[2]
        self._optimizer.zero_grad()
        total.backward()
        with torch.no_grad():
            for weight in self._weights:
                weight.mul_(1.0 - self.config.optimizer.decoder_learning_rate * WEIGHT_DECAY)
        self._optimizer.step()
        values = torch.stack((total, *terms)).detach().tolist()
        return StepLosses(values[0], 0.0, 0.0, values[1], values[2], values[3])

    @torch.no_grad()
    def query_sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The SDF s at world points, in fractions of the configuration's truncation; see the base class."""
        return self._ask(points_m, lambda points: self._s(points, self._weights))

    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Grey everywhere."""
        return np.full((len(points_m), 3), GREY, np.float32)

    @torch.no_grad()
    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s under ``k`` sets of all the network's weights, and grey; see the base class."""
        s = np.empty((len(decoders), len(points_m)), np.float32)
        for k, row in enumerate(decoders):
            ends = np.cumsum([weight.numel() for weight in self._weights])[:-1]
            parts = np.split(row, ends)
            weights = [self._tensor(p).view(w.shape) for p, w in zip(parts, self._weights, strict=True)]
            for rows, points in self._chunks(points_m):
                s[k, rows] = self._s(points, weights).cpu().numpy()
        return s, np.full((len(decoders), len(points_m), 3), GREY, np.float32)

    @torch.no_grad()
    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """What the last layer is given at world points; see the base class."""
        return self._ask(points_m, self._last_input, WIDTH)

    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared norm of the gradient of s by all weights, and zero for the colour it does not have."""
        out = np.empty(len(points_m), np.float32)
        for rows, points in self._chunks(points_m):
            layers = _Layers()
            s = self._s(points, self._weights, layers)
            back = torch.autograd.grad(s.sum(), layers.sums)
            # A layer's gradient is the outer product of what it is given and what comes back; the one is its bias.
            norms = [
                (b.square().sum(dim=1) * (i.square().sum(dim=1) + 1.0))
                for b, i in zip(back, layers.inputs, strict=True)
            ]
            out[rows] = torch.stack(norms).sum(dim=0).detach().cpu().numpy()
        return out, np.zeros(len(points_m), np.float32)

    @torch.no_grad()
    def render(self, origin_m: Vectors, direction: Vectors, z_m: SampleDepths) -> RenderedRays:
        """Grey, and the rendered planar depth of rays; see the base class."""
        points = origin_m[:, None] + direction[:, None] * z_m[:, :, None]
        s = self._tensor(self.query_sdf(points.reshape(-1, 3))).view(z_m.shape)
        z = self._tensor(z_m)
        depth = (sdf_to_weight(s, z, self.config.field.truncation_m) * z).sum(dim=1)
        return np.full((len(z_m), 3), GREY, np.float32), depth.cpu().numpy()

    def parameters(self) -> Parameters:
        """Copies of all weights by name, in the order of the layers."""
        return {n: w.detach().cpu().numpy().copy() for n, w in zip(_names(), self._weights, strict=True)}

    @torch.no_grad()
    def set_parameters(self, parameters: Parameters) -> None:
        """Take over weights by name and start the optimiser afresh; see the base class."""
        weights = dict(zip(_names(), self._weights, strict=True))
        check_shapes(parameters, {name: tuple(weight.shape) for name, weight in weights.items()})
        for name, weight in weights.items():
            weight.copy_(torch.from_numpy(parameters[name]))
        self._optimizer = Adam(self.config.optimizer, [], self._weights)

    def _last_input(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n width"]:
        layers = _Layers()
        self._s(points, self._weights, layers)
        return layers.inputs[-1]

    def _s(
        self, points: Float[Tensor, "n 3"], weights: list[Tensor], layers: _Layers | None = None
    ) -> Float[Tensor, " n"]:
        return self._distance(points, weights, layers) / self.config.field.truncation_m

    def _distance(
        self, points: Float[Tensor, "n 3"], weights: list[Tensor], layers: _Layers | None = None
    ) -> Float[Tensor, " n"]:
        """The signed distance [m]; records what happens in the layers, if asked to."""
        scaled = points * POSITION_SCALE
        octaves = 2.0 ** torch.arange(NUM_OCTAVES, device=points.device)
        angles = (scaled @ self._directions)[:, :, None] * octaves
        code = torch.cat((scaled, torch.sin(angles).flatten(1), torch.cos(angles).flatten(1)), dim=1)
        hidden = code
        for layer in range(NUM_HIDDEN + 1):
            given = torch.cat((hidden, code), dim=1) if layer == NUM_HIDDEN // 2 else hidden
            summed = torch.addmm(weights[2 * layer + 1], given, weights[2 * layer].t())
            if layers is not None:
                layers.inputs.append(given)
                layers.sums.append(summed)
            hidden = summed if layer == NUM_HIDDEN else torch.nn.functional.softplus(summed, beta=SOFTPLUS_BETA)
        return hidden[:, 0] * OUTPUT_SCALE


def _shapes(code: int) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Inputs and shape of every weight and bias, layer by layer."""
    for layer in range(NUM_HIDDEN + 1):
        fan_in = code if layer == 0 else WIDTH + (code if layer == NUM_HIDDEN // 2 else 0)
        width = 1 if layer == NUM_HIDDEN else WIDTH
        yield fan_in, (width, fan_in)
        yield fan_in, (width,)


def _names() -> list[str]:
    return [f"{part}_{layer}" for layer in range(NUM_HIDDEN + 1) for part in ("weight", "bias")]


def _sample(depth: Float[Tensor, " n"], seed: int) -> Float[Tensor, "n samples"]:
    """Planar depths along rays [m]: one in each of equal bins up to just behind the surface, and some about it."""
    jitter = counter_uniform(seed, len(depth), NUM_STRATIFIED + 2 * NUM_SURFACE, depth.device)
    bins = torch.arange(NUM_STRATIFIED, device=depth.device)
    span = (depth[:, None] + SURFACE_STD_M - NEAREST_M) / NUM_STRATIFIED
    stratified = NEAREST_M + (bins + jitter[:, :NUM_STRATIFIED]) * span
    radius, angle = jitter[:, NUM_STRATIFIED : NUM_STRATIFIED + NUM_SURFACE], jitter[:, NUM_STRATIFIED + NUM_SURFACE :]
    # Box and Muller's way from uniform to normal numbers.
    normal = torch.sqrt(-2.0 * torch.log1p(-radius)) * torch.cos(2.0 * math.pi * angle)
    return torch.cat((stratified, depth[:, None] + SURFACE_STD_M * normal), dim=1)


def _mean_of(values: Float[Tensor, " n"], chosen: Bool[Tensor, " n"]) -> Float[Tensor, ""]:
    """Sum over the chosen samples, as a share of all."""
    return (values * chosen).sum() / len(values)
