"""One training step of the Triton engine: the launches and their buffers.

The batch comes first into its buffer; all launches after that read device memory alone, so that on a GPU they are
captured once and replayed from then on.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.mapping.backends.backend import StepLosses
from anm_mj.mapping.backends.triton.adam import adam_decoders_kernel, adam_table_kernel
from anm_mj.mapping.backends.triton.batch import GRANULE, BatchBuffer
from anm_mj.mapping.backends.triton.captured import Captured
from anm_mj.mapping.backends.triton.field import TritonField
from anm_mj.mapping.backends.triton.launch import EXACT, FUSED, block, num_blocks, padded
from anm_mj.mapping.backends.triton.sampling import sample_kernel
from anm_mj.mapping.backends.triton.train import train_kernel
from anm_mj.mapping.config import MappingConfig, OptimizerConfig
from anm_mj.mapping.grid_layout import NUM_FEATURES
from anm_mj.mapping.losses import smoothness_lattice
from anm_mj.mapping.rays import RayBatch
from anm_mj.mapping.spaced_depths import spaced_depths

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
        self._batch = BatchBuffer(capacity, device)
        self._z = torch.zeros(points, device=device)
        self._points = torch.zeros(3, points, device=device)
        self._features = torch.zeros(NUM_FEATURES * field.levels, points, device=device)
        self._counts = torch.zeros(3, dtype=torch.int32, device=device)
        self._results = torch.zeros(8, device=device)
        # No product works on fewer than 16 rows.
        self._tile_rays = max(1, max(block(_TILE_POINTS, _INTERPRETED_POINTS), padded(1)) // self._samples_pad)
        self._sample_rays = block(_SAMPLE_RAYS if sampling.scheme == "guided" else 1, GRANULE)
        # Two in the interpreter, so that sums over programs are tested too.
        limit = _PROGRAMS_PER_CORE * torch.cuda.get_device_properties(device).multi_processor_count if cuda else 2
        self._programs = min(limit, num_blocks(capacity, self._tile_rays))
        self._partial = torch.zeros(self._programs, field.num_weights + 4, device=device)
        spaced = spaced_depths(sampling, config.field.truncation_m)
        self._spaced = torch.from_numpy(np.concatenate(spaced)).to(device)
        if smooth:
            self._offsets = smoothness_lattice(torch.zeros(3), config.loss).t().contiguous().to(device)
            count = self._offsets.shape[1]
            self._lattice = torch.zeros_like(self._offsets)
            self._lattice_features = torch.zeros(NUM_FEATURES * field.levels, count, device=device)
            self._lattice_count = torch.tensor([count], dtype=torch.int32, device=device)
        self._captured = Captured(self._launch, enabled=cuda)

    def load(self, rays: RayBatch, seed: int, corner_m: Float[np.ndarray, "3"] | None, step: int) -> None:
        """Copy a batch, and what depends on the number of the step (from 1), to the device."""
        self._batch.load(rays, seed, self._samples, _rates(self._config.optimizer, step), corner_m)

    def run(self) -> None:
        """Gradients and update for the batch at hand."""
        self._captured.run()

    def _launch(self) -> None:
        self.compute_gradients()
        self._update()

    def compute_gradients(self) -> None:
        """Add gradients to the table's, write those of the decoders, and the sums that losses are made of."""
        field, loss = self._field, self._config.loss
        self.draw_samples()
        field.encode_into(self._features, self._points)
        train_kernel[(self._programs,)](
            self._batch.header,
            self._batch.rays,
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
            **FUSED,
            **_ONE_STAGE,
        )
        field.scatter(self._points, self._batch.num_samples, self._features)
        torch.sum(self._partial[:, field.num_weights :], dim=0, out=self._results[:4])
        self._results[4:7].copy_(self._counts)
        if self.smooth:
            self._smoothness()

    def draw_samples(self) -> None:
        """Depths and points of the samples, and how many are free and in the band."""
        config, sampling = self._config, self._config.sampling
        self._counts.zero_()
        sample_kernel[(num_blocks(self.capacity, self._sample_rays),)](
            self._batch.header,
            self._batch.rays,
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
            **EXACT,
        )

    def _smoothness(self) -> None:
        """The smoothness term and its gradient; in torch, as differences of neighbours leave a kernel little to win."""
        loss = self._config.loss
        k = loss.smoothness_points
        torch.add(self._offsets, self._batch.corner_m[:, None], out=self._lattice)
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
        rates = self._batch.rates
        split, size = field.table_size, field.num_weights
        size_of_block = block(_ADAM_BLOCK, _INTERPRETED_ADAM_BLOCK)
        betas = {"BETA1": optimizer.beta1, "BETA2": optimizer.beta2}
        adam_table_kernel[(num_blocks(split, size_of_block),)](
            rates,
            field.parameters,
            field.first,
            field.second,
            field.table_gradient,
            split,
            optimizer.epsilon,
            **betas,
            BLOCK=size_of_block,
            **FUSED,
        )
        adam_decoders_kernel[(num_blocks(size, size_of_block),)](
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
            BLOCK=size_of_block,
            **FUSED,
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
