"""The batch of a training step, always in the same place of device memory, as a captured graph wants it.

A header of 16 words comes first: number of rays, seed and number of samples as integers; step sizes and the smoothness
lattice's corner as floats. Then come ten rows of rays. The number of rays is read from the header by the kernels, so
one captured graph serves all batches up to a capacity.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32
from torch import Tensor

from anm_mj.mapping.backends.triton.launch import num_blocks
from anm_mj.mapping.backends.triton.pixels import NUM_ROWS, DeviceRays
from anm_mj.mapping.rays import RayBatch

_HEADER = 16
"""Words before the rays."""
_COUNT, _RATES, _CORNER = 2, 4, 8
"""Where number of samples, step sizes and lattice corner stand in the header."""
GRANULE = 64
"""Capacities are multiples of this many rays."""


def capacity_for(num_rays: int) -> int:
    """The capacity of a buffer that holds so many rays."""
    return GRANULE * num_blocks(num_rays, GRANULE)


class BatchBuffer:
    """Room for one batch on a device, and the same on the host, from where it is copied in one go."""

    def __init__(self, capacity: int, device: torch.device) -> None:
        self.capacity = capacity
        words = _HEADER + NUM_ROWS * capacity
        self._host = torch.zeros(words, pin_memory=device.type == "cuda")
        self._device = torch.zeros(words, device=device)

    @property
    def header(self) -> Int32[Tensor, " words"]:
        """Number of rays and seed come first; a view."""
        return self._device.view(torch.int32)

    @property
    def num_samples(self) -> Int32[Tensor, "1"]:
        """Number of samples of all rays; a view."""
        return self.header[_COUNT : _COUNT + 1]

    @property
    def rates(self) -> Float32[Tensor, "3"]:
        """Step sizes of table and decoders, and the root of the second moment's bias; a view."""
        return self._device[_RATES : _RATES + 3]

    @property
    def corner_m(self) -> Float32[Tensor, "3"]:
        """Lowest corner of the smoothness lattice in the world [m]; a view."""
        return self._device[_CORNER : _CORNER + 3]

    @property
    def rays(self) -> Float32[Tensor, "10 capacity"]:
        """Origin, direction, colour and depth; a view."""
        return self._device[_HEADER:].view(NUM_ROWS, self.capacity)

    def load(
        self,
        rays: RayBatch,
        seed: int,
        samples_per_ray: int,
        rates: tuple[float, float, float],
        corner_m: Float[np.ndarray, "3"] | None,
    ) -> None:
        """Take in a batch; of one that lies on the device already, only the header comes from the host.

        What was loaded before must have been used: the host's part is written over at once.
        """
        num_rays = len(rays)
        host = self._host.numpy()
        host.view(np.uint32)[: _COUNT + 1] = num_rays, seed & 0xFFFFFFFF, num_rays * samples_per_ray
        host[_RATES : _RATES + 3] = rates
        if corner_m is not None:
            host[_CORNER : _CORNER + 3] = corner_m
        if isinstance(rays, DeviceRays):
            self._device[:_HEADER].copy_(self._host[:_HEADER], non_blocking=True)
            self.rays[:, :num_rays].copy_(rays.rows)
            return
        rows = host[_HEADER:].reshape(NUM_ROWS, self.capacity)
        rows[0:3, :num_rays] = rays.origin_m.T
        rows[3:6, :num_rays] = rays.direction.T
        rows[6:9, :num_rays] = rays.rgb.T
        rows[9, :num_rays] = rays.depth_m
        self._device.copy_(self._host, non_blocking=True)
