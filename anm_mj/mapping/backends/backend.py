"""The seam at which the mapper's engine is swapped: whole training steps in, losses out.

A narrower seam (an encoding, a network) would cost as much again in copies and launches. Arrays are numpy at this
border, in host memory; the parameter layout is the one of :mod:`anm_mj.mapping.backends.parameters`. Given the same
state, rays and seed, all engines draw the same samples (:func:`.torch_sampling.counter_uniform`) and agree to rounding.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.errors import MapError
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch

Vectors = Float32[np.ndarray, "n 3"]
"""One vector for each of n rays."""
SampleDepths = Float32[np.ndarray, "n samples"]
"""Planar depths of the samples on each of n rays [m]."""
RenderedRays = tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, " n"]]
"""Colour in [0, 1] and planar depth [m] of n rays."""


Parameters = dict[str, Float32[np.ndarray, "..."]]
"""Parameters of the field by name."""


class StepLosses(NamedTuple):
    """Losses of one training step: the weighted total, then the terms before weighting."""

    total: float
    rgb: float
    depth: float
    sdf: float
    free_space: float
    smoothness: float


class MapperBackend(ABC):
    """An engine: holds the parameters and the optimiser's state, trains and answers queries."""

    can_align = False
    """Whether the engine compares frames with the field, as localisation needs it."""

    config: MappingConfig
    name: str
    """Which engine it is, for the log: "torch", "mlp", or "native" with its instruction set."""
    device: str
    """Where it computes, for the log: "cpu" or "cuda"."""

    @abstractmethod
    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration: sample, render, losses, gradients, Adam. The sample jitter is derived from ``seed``; the
        smoothness lattice has its lowest corner at ``smoothness_corner_m`` in the world, None leaves the term out.
        Returns the losses before the update.
        """

    def steps(
        self, batches: Sequence[RayBatch], draws: Sequence[tuple[int, Float[np.ndarray, "3"] | None]]
    ) -> list[StepLosses]:
        """Several iterations, with the results of :meth:`step` on each batch, by its seed and smoothness corner in
        ``draws``; an engine may let them overlap. Returns the losses of each, up to the first whose total is not
        finite: nothing is trained after it.
        """
        done: list[StepLosses] = []
        for rays, (seed, corner_m) in zip(batches, draws, strict=True):
            done.append(self.step(rays, seed, corner_m))
            if not math.isfinite(done[-1].total):
                break
        return done

    @abstractmethod
    def query_sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The SDF s at world points [m], in fractions of the truncation, not clipped."""

    @abstractmethod
    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points [m]."""

    @abstractmethod
    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours at world points [m] under ``k`` sets of decoder weights, from one encoding. Each row of
        ``decoders`` holds all decoder weights, in the order of the parameter layout, C-contiguous.
        """

    @abstractmethod
    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """What the SDF decoder's hidden layer gives at world points [m], after its activation."""

    @abstractmethod
    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared norm of the gradient by all decoder weights, of s and of the colour (mean of the three channels)."""

    @abstractmethod
    def render(self, origin_m: Vectors, direction: Vectors, z_m: SampleDepths) -> RenderedRays:
        """Rendered colour in [0, 1] and planar depth [m] of rays, from samples at the given depths (Eq. 1)."""

    def align(
        self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], settings: AlignSettings
    ) -> NormalEquations:
        """Normal equations of a frame's distances to the surface, and of its colours, at a camera pose. Raises MapError
        if the engine cannot; :attr:`can_align` says so before.
        """
        raise MapError(f"Engine '{self.name}' cannot localise; use mapping.engine=native.")

    @abstractmethod
    def parameters(self) -> Parameters:
        """Copies of all parameters by name."""

    @abstractmethod
    def set_parameters(self, parameters: Parameters) -> None:
        """Take over parameters by name, passing over other names, and start the optimiser afresh. Raises MapError if a
        name is missing or a shape differs from the configuration's.
        """

    @abstractmethod
    def get_state(self) -> dict[str, np.ndarray]:
        """Copies of parameters and of the optimiser's moments and counters, by name."""

    @abstractmethod
    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave. Raises MapError if a name is missing or a shape differs."""
