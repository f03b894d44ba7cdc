"""One training step of the Triton engine: the launches, their buffers, and their capture in a CUDA graph.

A batch arrives in one copy: a header of 16 words (number of rays, seed and number of samples as integers; step sizes
and the smoothness lattice's corner as floats), then ten rows of rays. The number of rays is read from it by the
kernels, so one captured graph serves all batches that need buffers of the same capacity.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.mapping.backends import triton_kernels as kernels
from anm_mj.mapping.backends.backend import StepLosses
from anm_mj.mapping.backends.triton_field import TritonField, padded
from anm_mj.mapping.config import MappingConfig, OptimizerConfig
from anm_mj.mapping.encoding import NUM_FEATURES
from anm_mj.mapping.keyframes import RayBatch
from anm_mj.mapping.losses import smoothness_lattice

_HEADER = 16
"""Words before the rays."""
_RATES, _CORNER = 4, 8
"""Where step sizes and lattice corner stand in the header."""
_ROWS = 10
"""Rows of rays: origin, direction, colour, depth."""
_GRANULE = 64
"""Capacities are multiples of this many rays."""
_TILE_POINTS = 64
"""Samples that a program of the training kernel holds at a time on a GPU, at least one ray's."""
_INTERPRETED_POINTS = 1024
"""The same in the interpreter, where each operation costs the same for a few values as for thousands."""
_SAMPLE_RAYS = 8
"""Rays per program of the sampling, in the guided scheme; the uniform one compares all pairs, so takes one ray."""
_ONE_STAGE = {"num_stages": 1}
"""Launch option: fetching the next tile ahead would need twice the shared memory."""
_PROGRAMS_PER_CORE = 2
"""Programs of the training kernel per multiprocessor; each goes through many tiles."""
_ADAM_BLOCK = 1024
"""Parameters per program of Adam on a GPU."""
_INTERPRETED_ADAM_BLOCK = 1 << 18
"""The same in the interpreter."""


def capacity_for(num_rays: int) -> int:
    """The capacity of buffers that hold so many rays."""
    return -(-num_rays // _GRANULE) * _GRANULE


class TrainingStep:
    """Buffers for batches up to a capacity, with or without the smoothness term, and the launches that use them."""

    def __init__(self, config: MappingConfig, field: TritonField, capacity: int, *, smooth: bool) -> None:
        self.capacity = capacity
        self.smooth = smooth
        self._config = config
        self._field = field
        sampling, device = config.sampling, field.device
        cuda = device.type == "cuda"
        self._samples = sampling.samples_per_ray
        self._samples_pad = 1 << (self._samples - 1).bit_length()
        points = capacity * self._samples
        words = _HEADER + _ROWS * capacity
        self._host = torch.zeros(words, pin_memory=cuda)
        self._batch = torch.zeros(words, device=device)
        self._words = self._batch.view(torch.int32)
        self._rays = self._batch[_HEADER:]
        self._z = torch.zeros(points, device=device)
        self._points = torch.zeros(3, points, device=device)
        self._features = torch.zeros(NUM_FEATURES * field.levels, points, device=device)
        self._counts = torch.zeros(3, dtype=torch.int32, device=device)
        self._results = torch.zeros(8, device=device)
        tile = _INTERPRETED_POINTS if kernels.INTERPRETED else _TILE_POINTS
        # No product works on fewer than 16 rows.
        self._tile_rays = max(1, max(tile, padded(1)) // self._samples_pad)
        self._sample_rays = _SAMPLE_RAYS if sampling.scheme == "guided" else 1
        if kernels.INTERPRETED:
            self._sample_rays = _GRANULE
        # Two in the interpreter, so that sums over programs are tested too.
        limit = _PROGRAMS_PER_CORE * torch.cuda.get_device_properties(device).multi_processor_count if cuda else 2
        self._programs = min(limit, -(-capacity // self._tile_rays))
        self._partial = torch.zeros(self._programs, field.num_weights + 4, device=device)
        # By torch on the host, so that the very same numbers come out as in its engine.
        truncation = config.field.truncation_m
        self._spaced = torch.cat(
            (
                torch.linspace(0.0, sampling.far_m, sampling.free_samples),
                torch.linspace(-truncation, truncation, sampling.near_samples),
                torch.linspace(0.0, sampling.far_m, sampling.near_samples),
            )
        ).to(device)
        if smooth:
            self._offsets = smoothness_lattice(torch.zeros(3), config.loss).t().contiguous().to(device)
            count = self._offsets.shape[1]
            self._lattice = torch.zeros_like(self._offsets)
            self._lattice_features = torch.zeros(NUM_FEATURES * field.levels, count, device=device)
            self._lattice_count = torch.tensor([count], dtype=torch.int32, device=device)
        self._graph: torch.cuda.CUDAGraph | None = None
        self._compiled = False

    def load(self, rays: RayBatch, seed: int, corner_m: Float[np.ndarray, "3"] | None, step: int) -> None:
        """Copy a batch, and what depends on the number of the step (from 1), to the device."""
        num_rays = len(rays.depth_m)
        host = self._host.numpy()
        words = host.view(np.uint32)
        words[:3] = num_rays, seed & 0xFFFFFFFF, num_rays * self._samples
        host[_RATES : _RATES + 3] = _rates(self._config.optimizer, step)
        if corner_m is not None:
            host[_CORNER : _CORNER + 3] = corner_m
        rows = host[_HEADER:].reshape(_ROWS, self.capacity)
        rows[0:3, :num_rays] = rays.origin_m.T
        rows[3:6, :num_rays] = rays.direction.T
        rows[6:9, :num_rays] = rays.rgb.T
        rows[9, :num_rays] = rays.depth_m
        self._batch.copy_(self._host, non_blocking=True)

    def run(self) -> None:
        """Gradients and update for the batch at hand.

        On a GPU the first run compiles, the second captures what the later ones replay.
        """
        if self._field.device.type == "cuda" and self._compiled:
            if self._graph is None:
                self._graph = torch.cuda.CUDAGraph()
                # Capturing records the launches and runs none.
                with torch.cuda.graph(self._graph):
                    self._launch()
            self._graph.replay()
        else:
            self._launch()
            self._compiled = True

    def _launch(self) -> None:
        self.compute_gradients()
        self._update()

    def compute_gradients(self) -> None:
        """Add gradients to the table's, write those of the decoders, and the sums that losses are made of."""
        field, loss = self._field, self._config.loss
        self.draw_samples()
        field.encode_into(self._features, self._points)
        kernels.train[(self._programs,)](
            self._words,
            self._rays,
            self.capacity,
            self._z,
            self._points,
            self._features,
            self._counts,
            field.bins_per_m,
            field.weights,
            self._partial,
            field.num_weights,
            self._config.sampling.max_depth_m,
            loss.rgb,
            loss.depth,
            loss.sdf,
            loss.free_space,
            loss.no_depth_rgb,
            SAMPLES=self._samples,
            SAMPLES_PAD=self._samples_pad,
            TRUNCATION=self._config.field.truncation_m,
            NO_DEPTH_IS_FREE=loss.no_depth_is_free,
            RAYS=self._tile_rays,
            **field.sizes,
            **kernels.FUSED,
            **_ONE_STAGE,
        )
        field.scatter(self._points, self._words[2:3], self._features)
        torch.sum(self._partial[:, field.num_weights :], dim=0, out=self._results[:4])
        self._results[4:7].copy_(self._counts)
        if self.smooth:
            self._smoothness()

    def draw_samples(self) -> None:
        """Depths and points of the samples, and how many are free and in the band."""
        config, sampling = self._config, self._config.sampling
        self._counts.zero_()
        kernels.sample[(-(-self.capacity // self._sample_rays),)](
            self._words,
            self._rays,
            self.capacity,
            self._spaced,
            self._z,
            self._points,
            self._counts,
            sampling.far_m / self._samples,
            sampling.max_depth_m,
            GUIDED=sampling.scheme == "guided",
            FREE=sampling.free_samples,
            NEAR=sampling.near_samples,
            SAMPLES_PAD=self._samples_pad,
            TRUNCATION=config.field.truncation_m,
            NO_DEPTH_IS_FREE=config.loss.no_depth_is_free,
            RAYS=self._sample_rays,
            **kernels.EXACT,
        )

    def _smoothness(self) -> None:
        """The smoothness term and its gradient; in torch, as differences of neighbours leave a kernel little to win."""
        loss = self._config.loss
        k = loss.smoothness_points
        torch.add(self._offsets, self._batch[_CORNER : _CORNER + 3, None], out=self._lattice)
        self._field.encode_into(self._lattice_features, self._lattice)
        lattice = self._lattice_features.view(-1, k, k, k)
        gradient = torch.zeros_like(lattice)
        total = torch.zeros((), device=self._field.device)
        for axis in range(1, 4):
            difference = lattice.diff(dim=axis)
            total += difference.square().sum()
            gradient.narrow(axis, 1, k - 1).add_(difference)
            gradient.narrow(axis, 0, k - 1).sub_(difference)
        gradient *= 2.0 * loss.smoothness / (k + 1) ** 3
        self._results[7] = total / (k + 1) ** 3
        self._field.scatter(self._lattice, self._lattice_count, gradient.view_as(self._lattice_features))

    def _update(self) -> None:
        field, optimizer = self._field, self._config.optimizer
        rates = self._batch[_RATES:]
        split, size = field.table_size, field.num_weights
        block = _INTERPRETED_ADAM_BLOCK if kernels.INTERPRETED else _ADAM_BLOCK
        betas = {"BETA1": optimizer.beta1, "BETA2": optimizer.beta2}
        kernels.adam_table[(-(-split // block),)](
            rates,
            field.parameters,
            field.first,
            field.second,
            field.table_gradient,
            split,
            optimizer.epsilon,
            **betas,
            BLOCK=block,
            **kernels.FUSED,
        )
        kernels.adam_decoders[(-(-size // block),)](
            rates,
            field.parameters[split:],
            field.first[split:],
            field.second[split:],
            self._partial,
            self._programs,
            size,
            optimizer.decoder_weight_decay,
            optimizer.epsilon,
            **betas,
            BLOCK=block,
            **kernels.FUSED,
        )

    def losses(self, num_rays: int) -> StepLosses:
        """The losses of the last run, which had so many rays; waits for the device."""
        rgb, depth, sdf, free, num_free, num_band, num_hit, smoothness = self._results.tolist()
        weights = self._config.loss
        samples = num_rays * self._samples
        supervised = max(num_free + num_band, 1.0)
        rgb /= 3 * num_rays
        depth /= max(num_hit, 1.0)
        sdf *= num_free / supervised / samples
        free *= num_band / supervised / samples
        total = weights.rgb * rgb + weights.depth * depth + weights.sdf * sdf + weights.free_space * free
        return StepLosses(total + weights.smoothness * smoothness, rgb, depth, sdf, free, smoothness)

    def depths(self, num_rays: int) -> Float32[np.ndarray, "n samples"]:
        """The depths of the samples last drawn [m]."""
        return self._z.cpu().numpy().reshape(self.capacity, self._samples)[:num_rays].copy()

    def decoder_gradient(self) -> Float[Tensor, " weights"]:
        """The last gradient by the decoders' weights, without decay."""
        return self._partial[:, : self._field.num_weights].sum(dim=0)


def _rates(config: OptimizerConfig, step: int) -> tuple[float, float, float]:
    """Adam's step sizes of table and decoders, and the root of the second moment's bias."""
    bias = 1.0 - config.beta1**step
    root = math.sqrt(1.0 - config.beta2**step)
    return config.table_learning_rate / bias, config.decoder_learning_rate / bias, root
