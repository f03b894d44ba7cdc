"""The engine for a CPU, in C++ (``native/``): a training step is one call, many times faster than through torch.

It draws the same samples as the torch engine from the same seed, and its checkpoints are the same. Its results are
the same bytes for any number of threads, but not for other instruction sets, which sum in another order.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32

from anm_mj import _native
from anm_mj.errors import MapError
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations
from anm_mj.mapping.backends.backend import MapperBackend, Parameters, RenderedRays, SampleDepths, StepLosses, Vectors
from anm_mj.mapping.backends.parameters import (
    DECODER_NAMES,
    bins_per_m,
    cells_per_m,
    check_shapes,
    decoder_shapes,
    index_factors,
    initial_parameters,
    parameter_shapes,
    split_flat,
)
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch, spaced_depths
from anm_mj.utils.threads import usual_num_threads

_MAX_WIDTH = 1024
"""Most neurons, outputs and samples per ray that the engine's fixed buffers hold."""

_MOMENTS = ("table_m", "table_v", "table_touched", "decoders_m", "decoders_v")


class NativeBackend(MapperBackend):
    """Implements :class:`~anm_mj.mapping.backends.backend.MapperBackend` on the CPU."""

    device = "cpu"
    can_align = True

    def __init__(
        self,
        config: MappingConfig,
        *,
        seed: int,
        num_threads: int | None = None,
        kernel: str = "",
        parameters: Parameters | None = None,
    ) -> None:
        """Start from given parameters, or from those that ``seed`` gives. ``num_threads`` None = ``OMP_NUM_THREADS``,
        or one per core that the process may use; ``kernel`` is the instruction set, one of ``_native.kernel_names()``,
        empty for the best of this processor. Raises MapError if a layer or a ray's samples are too many for the engine.
        """
        field, sampling = config.field, config.sampling
        widest = max(field.hidden_width, field.geometry_features + 1, sampling.samples_per_ray)
        if widest > _MAX_WIDTH:
            raise MapError(
                f"The native engine holds at most {_MAX_WIDTH} neurons, features or samples, but {widest} are "
                "configured; use engine 'torch'."
            )
        self.config = config
        factors, masks = index_factors(field)
        even, band, spare = spaced_depths(sampling, field.truncation_m)
        self._engine = _native.Engine(
            _settings(config),
            cells_per_m(field),
            np.ascontiguousarray(factors, np.int64),
            np.ascontiguousarray(masks, np.int64),
            even,
            band,
            spare,
            num_threads or usual_num_threads(),
            kernel,
        )
        self.kernel: str = self._engine.kernel
        """The instruction set in use: "v2", "v3" or "v4" (levels of x86-64) or "generic"."""
        self.name = f"native-{self.kernel}"
        self.set_parameters(initial_parameters(field, seed) if parameters is None else parameters)

    def step(self, rays: RayBatch, seed: int, smoothness_corner_m: Float[np.ndarray, "3"] | None = None) -> StepLosses:
        """One iteration: sample, render, losses, gradients, Adam; see the base class."""
        return StepLosses(*self._engine.step(*_ray_arrays(rays), seed & 0xFFFFFFFF, _optional(smoothness_corner_m)))

    def steps(
        self, batches: Sequence[RayBatch], draws: Sequence[tuple[int, Float[np.ndarray, "3"] | None]]
    ) -> list[StepLosses]:
        """Several iterations, whose phases overlap; see the base class."""
        arrays = [_ray_arrays(rays) for rays in batches]
        seeds, corners = [seed & 0xFFFFFFFF for seed, _ in draws], [_optional(corner_m) for _, corner_m in draws]
        return [StepLosses(*losses) for losses in self._engine.steps(arrays, seeds, corners)]

    def query_sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The SDF s at world points, in fractions of the truncation; see the base class."""
        return self._engine.query_sdf(_floats(points_m))

    def query_rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points; see the base class."""
        return self._engine.query_rgb(_floats(points_m))

    def query_perturbed(
        self, points_m: Float[np.ndarray, "n 3"], decoders: Float32[np.ndarray, "k weights"]
    ) -> tuple[Float32[np.ndarray, "k n"], Float32[np.ndarray, "k n 3"]]:
        """The SDF s and colours under ``k`` sets of decoder weights; see the base class."""
        return self._engine.query_perturbed(_floats(points_m), _floats(decoders))

    def query_hidden(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n hidden"]:
        """The SDF decoder's hidden layer at world points; see the base class."""
        return self._engine.query_hidden(_floats(points_m))

    def query_sensitivity(
        self, points_m: Float[np.ndarray, "n 3"]
    ) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
        """Squared gradient norms by all decoder weights; see the base class."""
        return self._engine.query_sensitivity(_floats(points_m))

    def render(self, origin_m: Vectors, direction: Vectors, z_m: SampleDepths) -> RenderedRays:
        """Rendered colour and planar depth of rays; see the base class."""
        return self._engine.render(_floats(origin_m), _floats(direction), _floats(z_m))

    def align(
        self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], settings: AlignSettings
    ) -> NormalEquations:
        """Normal equations of a frame at a camera pose (``native/frame_to_field.h``); see the base class."""
        sums = self._engine.align(
            points.camera_m,
            points.rgb,
            points.variance_m2,
            points.trust,
            _floats(T_world_camera[:3, :3]),
            _floats(T_world_camera[:3, 3]),
            (settings.saturation, settings.least_slope, settings.most_slope),
            settings.field_deviation_m**2,
            settings.kernel,
            settings.color_deviation,
            settings.color_kernel,
        )
        return NormalEquations(*sums)

    def parameters(self) -> Parameters:
        """Copies of all parameters by name."""
        table, decoders = self._engine.get_state()
        return {"table": table, **self._split(decoders)}

    def set_parameters(self, parameters: Parameters) -> None:
        """Take over parameters by name and start the optimiser afresh; see the base class."""
        check_shapes(parameters, parameter_shapes(self.config.field))
        decoders = np.concatenate([parameters[name].ravel() for name in DECODER_NAMES])
        self._engine.set_state(_floats(parameters["table"]), _floats(decoders))

    def get_state(self) -> dict[str, np.ndarray]:
        """Parameters, moments, lines of the table that ever had a gradient, and iterations so far."""
        *moments, iteration = self._engine.get_optimizer()
        return {**self.parameters(), **dict(zip(_MOMENTS, moments, strict=True)), "iteration": np.array(iteration)}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave; see the base class."""
        self.set_parameters(state)
        check_shapes(state, {name: array.shape for name, array in self.get_state().items()})
        table_m, table_v, touched, decoders_m, decoders_v = (state[name] for name in _MOMENTS)
        self._engine.set_optimizer(
            _floats(table_m),
            _floats(table_v),
            np.ascontiguousarray(touched, np.uint8),
            _floats(decoders_m),
            _floats(decoders_v),
            int(state["iteration"]),
        )

    def _split(self, decoders: Float32[np.ndarray, " weights"]) -> dict[str, Float32[np.ndarray, "rows cols"]]:
        parts = split_flat(decoders, decoder_shapes(self.config.field))
        return {name: part.copy() for name, part in parts.items()}


def _settings(config: MappingConfig) -> _native.Settings:
    field, sampling, loss, optimizer = config.field, config.sampling, config.loss, config.optimizer
    out = _native.Settings()
    out.levels = field.num_levels
    out.log2_table_size = field.log2_table_size
    out.bins = field.blob_bins
    out.hidden = field.hidden_width
    out.geometry = field.geometry_features
    out.bins_per_m = tuple(bins_per_m(field).tolist())
    out.truncation = field.truncation_m
    out.guided = sampling.scheme == "guided"
    out.free_samples = sampling.free_samples
    out.near_samples = sampling.near_samples
    out.max_depth = sampling.max_depth_m
    out.none_step = sampling.reach_m / sampling.samples_per_ray
    out.weight_rgb = loss.rgb
    out.weight_depth = loss.depth
    out.weight_sdf = loss.sdf
    out.weight_free = loss.free_space
    out.weight_smoothness = loss.smoothness
    out.smoothness_points = loss.smoothness_points
    out.smoothness_spacing = loss.smoothness_spacing_m
    out.no_depth_rgb = loss.no_depth_rgb
    out.no_depth_is_free = loss.no_depth_is_free
    out.table_rate = optimizer.table_learning_rate
    out.decoder_rate = optimizer.decoder_learning_rate
    out.beta1 = optimizer.beta1
    out.beta2 = optimizer.beta2
    out.epsilon = optimizer.epsilon
    out.decoder_decay = optimizer.decoder_weight_decay
    return out


def _floats(array: Float[np.ndarray, "..."]) -> Float32[np.ndarray, "..."]:
    return np.ascontiguousarray(array, np.float32)


def _optional(array: Float[np.ndarray, "..."] | None) -> Float32[np.ndarray, "..."] | None:
    return None if array is None else _floats(array)


def _ray_arrays(rays: RayBatch) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return _floats(rays.origin_m), _floats(rays.direction), _floats(rays.rgb), _floats(rays.depth_m)
