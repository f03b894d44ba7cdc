"""The engine for a GPU, in Triton: a training step is a few kernels, replayed as one captured graph on CUDA.

Nobody has measured it on a GPU, so it runs only where ``mapping.engine=triton`` asks for it. Tests compare its results
with the torch engine's: in Triton's interpreter on the host, or on a GPU where they find one. They also compile the
kernels for a GPU that is not there. The interpreter multiplies in float32 where the compiled kernels sum three TF32
products.

Kernels do the sampling, the encoding, the decoders with rendering, losses and their gradients (in one), the scatter
into the table's gradient, and Adam. Torch does the rest on the device: the smoothness term, rendering of views and the
sensitivity of the outputs. From the same seed it draws the same samples as the torch engine, and checkpoints are
interchangeable. Atomics sum the table's gradient, so two runs differ in the last bits.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import StepLosses
from anm_mj.mapping.backends.tensor_backend import CUDA_CHUNK, HashGridBackend
from anm_mj.mapping.backends.triton.batch import capacity_for
from anm_mj.mapping.backends.triton.field import TritonField
from anm_mj.mapping.backends.triton.launch import INTERPRETED
from anm_mj.mapping.backends.triton.pixels import DevicePixels
from anm_mj.mapping.backends.triton.training_step import TrainingStep
from anm_mj.mapping.config import MappingConfig
from anm_mj.mapping.encoding import one_blob
from anm_mj.mapping.parameters import check_state, initial_parameters
from anm_mj.mapping.rays import RayBatch


class TritonBackend(HashGridBackend):
    """Implements :class:`~anm_mj.mapping.backends.backend.MapperBackend` on a CUDA device, or in the interpreter."""

    name = "triton"

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        """Start from the parameters that ``seed`` gives.

        Args:
            config: The mapping configuration.
            seed: What the start values are drawn from.
            device: "auto", "cuda", or "cpu" where the interpreter runs the kernels.

        Raises:
            MapError: If a layer or a ray's samples are too many for the kernels, or the device is a CPU and the
                kernels are not interpreted.
        """
        super().__init__(config, device, CUDA_CHUNK)
        if self.device == "cpu" and not INTERPRETED:
            raise MapError("The Triton engine needs a CUDA device, and there is none; use engine 'auto' or 'torch'.")
        self._field = TritonField(config, self._device)
        self._period_m = torch.tensor(config.field.blob_period_m, device=self._device)
        self._training: TrainingStep | None = None
        self._num_steps = 0
        self.set_state(initial_parameters(config.field, seed))

    def pixel_memory(self, count: int) -> DevicePixels:
        """Room for so many pixels to replay, on the device; see the base class."""
        return DevicePixels(count, self._device)

    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration: sample, render, losses, gradients, Adam; see the base class."""
        self._num_steps += 1
        training = self._loaded(rays, seed, smoothness_corner_m)
        training.run()
        return training.losses(len(rays))

    def sample_depths(self, depth_m: Float32[np.ndarray, " n"], seed: int) -> Float32[np.ndarray, "n samples"]:
        """The planar depths [m] that :meth:`step` samples rays of these measured depths at."""
        zeros = np.zeros((len(depth_m), 3), np.float32)
        training = self._loaded(RayBatch(zeros, zeros, zeros, depth_m), seed, None)
        training.draw_samples()
        return training.depths(len(depth_m))

    def gradients(
        self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None
    ) -> tuple[StepLosses, dict[str, Float32[np.ndarray, "..."]]]:
        """Losses and their gradients by parameter name, as in :meth:`step`; nothing is trained.

        The decoders' weight decay, which is the optimiser's, is not in them.
        """
        training = self._loaded(rays, seed, smoothness_corner_m)
        training.compute_gradients()
        gradients = self._field.split(torch.cat((self._field.table_gradient, training.decoder_gradient())))
        self._field.table_gradient.zero_()
        return training.losses(len(rays)), gradients

    def query_sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The SDF s at world points, in fractions of the truncation; see the base class."""
        weights = self._field.weights[None]
        return self._ask(points_m, lambda points: self._field.decode(_columns(points), weights, color=False)[0][0])

    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours under ``k`` sets of decoder weights; see the base class."""
        s_out = np.empty((len(decoders), len(points_m)), np.float32)
        rgb_out = np.empty((len(decoders), len(points_m), 3), np.float32)
        weights = self._tensor(decoders)
        for rows, points in self._chunks(points_m, max(1, self._chunk // len(decoders))):
            s, rgb = self._field.decode(_columns(points), weights)
            s_out[:, rows] = s.cpu().numpy()
            rgb_out[:, rows] = rgb.transpose(1, 2).cpu().numpy()
        return s_out, rgb_out

    def get_state(self) -> dict[str, Float32[np.ndarray, "..."]]:
        """Copies of all parameters by name."""
        return self._field.get_state()

    def set_state(self, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Take over parameters by name and start the optimiser afresh; see the base class."""
        self._field.set_state(state)
        self._num_steps = 0

    def get_optimizer(self) -> dict[str, np.ndarray]:
        """Adam's moments and steps; see the base class."""
        moments = {"first": self._field.first, "second": self._field.second}
        return {
            **{f"moments.{name}": tensor.cpu().numpy().copy() for name, tensor in moments.items()},
            "num_steps": np.array(self._num_steps),
        }

    def set_optimizer(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_optimizer` gave; see the base class."""
        check_state(state, {name: array.shape for name, array in self.get_optimizer().items()})
        self._field.first.copy_(torch.from_numpy(state["moments.first"]))
        self._field.second.copy_(torch.from_numpy(state["moments.second"]))
        self._num_steps = int(state["num_steps"])

    def _loaded(self, rays: RayBatch, seed: int, corner_m: Float[np.ndarray, "3"] | None) -> TrainingStep:
        """The training step with this batch in its buffers; other buffers if these are of another size."""
        capacity, smooth = capacity_for(len(rays)), corner_m is not None
        training = self._training
        if training is None or (training.capacity, training.smooth) != (capacity, smooth):
            # The old buffers go before the new ones come.
            self._training = None
            training = TrainingStep(self.config, self._field, capacity, smooth=smooth)
            self._training = training
        training.load(rays, seed, corner_m, max(1, self._num_steps))
        return training

    def _encode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n features"], Float[Tensor, "n blob"]]:
        columns = _columns(points)
        return self._field.features(columns).t(), one_blob(columns.t(), self._period_m, self.config.field.blob_bins)

    def _decode(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        s, rgb = self._field.decode(_columns(points), self._field.weights[None])
        return s[0], rgb[0].t()

    def _decoders(self) -> list[Float[Tensor, "_ _"]]:
        return self._field.split_weights()


def _columns(points: Float[Tensor, "n 3"]) -> Float[Tensor, "3 n"]:
    """Points as the kernels read them, coordinate by coordinate."""
    return points.t().contiguous()
