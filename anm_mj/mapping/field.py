"""The neural field of a map: an engine that is trained on rays of keyframes, and asked about places.

Training effort is counted in iterations, never in seconds: with the same seed, observations and machine type, the
parameters are the same bit for bit on a CPU.
"""

import logging
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Int64

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend, Parameters
from anm_mj.mapping.backends.parameters import doubled_table
from anm_mj.mapping.backends.select import make_backend
from anm_mj.mapping.keyframes import Keyframes, KeyframeStore
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.types import MapUpdate, Observation, OccupancyGrid, TrainingEffort

_logger = logging.getLogger(__name__)

_FINAL_RATES = (1 / 2, 1 / 4, 1 / 8, 1 / 16)
"""Factors on the learning rates over the parts of the final training."""
_DRAWN_TOGETHER = 10
"""Iterations whose rays are drawn in one go, because the price of a draw hardly depends on its size."""
KEEP_EVERY_FRAMES = 20
"""A copy of the parameters costs milliseconds; a loss that is not finite takes back this many frames at most."""
MAX_FAILURES = 5
"""So many frames in a row whose loss was not finite end the training."""


class _NotFinite(Exception):
    """The training loss is not finite."""


class Field:
    """Trains an engine frame by frame, and replaces it by a larger one as the scene grows."""

    REBUILT = ("backend", "_device", "_good", "_good_frame")

    def __init__(self, config: MappingConfig, *, seed: int, device: str) -> None:
        """An untrained field; see :class:`anm_mj.mapping.neural_map.NeuralMap`. Raises MapError if the device or the
        engine is unknown or absent.
        """
        self.config = config
        """With the table as large as it has become."""
        self.seed = seed
        self._device = device
        self.backend: MapperBackend = make_backend(config, seed=seed, device=device)
        self.keyframes = KeyframeStore(config.schedule.replay_bytes, config.schedule.pixel_share)
        self.is_trained = False
        """Whether it was ever trained; else it says nothing."""
        self.num_frames = 0
        self._rng = np.random.default_rng([seed, 1])
        self._last: Observation | None = None
        self._good: Parameters | None = None
        """Parameters that were all finite, to go back to when training fails; after a resume those of then."""
        self._good_frame = 0
        self._failures = 0
        """Frames in a row whose loss was not finite."""

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Signed distance at world points [m], truncated to +-``truncation_m``."""
        truncation = np.float32(self.config.field.truncation_m)
        return np.clip(self.backend.query_sdf(points_m), -1.0, 1.0) * truncation

    def wants_keyframe(self, effort: TrainingEffort | None = None) -> bool:
        """Whether the next frame is to become a keyframe; a given effort decides it for all but the first one."""
        if not len(self.keyframes):
            return True  # A map that was loaded replays nothing yet.
        if effort is not None and effort.is_keyframe is not None and self.num_frames:
            return effort.is_keyframe
        return self.num_frames % self.config.schedule.keyframe_every == 0

    def add_keyframe(self, observation: Observation, weight: Float32[np.ndarray, "h w"] | None) -> None:
        """Keep pixels of an observation for replay, drawn in proportion to a weight; None = uniformly. Raises MapError
        if the store has no room for one more keyframe.
        """
        self.keyframes.add(observation, self._rng, weight)

    def continue_from(self, keyframes: Keyframes, num_frames: int) -> None:
        """Replay keyframes of a prior run; the next frame is a keyframe, and one to train on. Raises MapError if the
        store has no room for them.
        """
        self.keyframes.replace(0, keyframes)
        round_up = math.lcm(self.config.schedule.keyframe_every, self.config.schedule.train_every)
        self.num_frames = math.ceil(num_frames / round_up) * round_up

    def learn(self, observation: Observation, grid: OccupancyGrid, effort: TrainingEffort | None = None) -> MapUpdate:
        """Train on the next frame, of which one pixel at least was measured; ``grid`` is the box that was observed, for
        the smoothness term, and ``effort`` takes the place of the schedule's on every frame but the first.

        A loss that is not finite takes the parameters back to the last good ones; the frame's training ends there, its
        loss is NaN, and the next frame goes on from them. Raises MapError if the loss is not finite in
        :data:`MAX_FAILURES` frames in a row.
        """
        schedule, first = self.config.schedule, self.num_frames == 0
        num_iterations = 0
        if first:
            num_iterations = schedule.first_iterations
        elif effort is not None:
            num_iterations = effort.iterations
        elif self.num_frames % schedule.train_every == 0:
            num_iterations = schedule.iterations
        self.num_frames += 1
        self._last = observation
        loss, done = math.nan, 0
        if num_iterations and (self._good is None or self.num_frames - self._good_frame >= KEEP_EVERY_FRAMES):
            self._keep_or_restore(observation.step)
        try:
            current_rays = None if effort is None else effort.current_rays
            for latest in self._train(observation, num_iterations, grid, first=first, current_rays=current_rays):
                loss, done = latest, done + 1
        except _NotFinite as err:
            loss = math.nan
            self._failures += 1
            said = f"The training loss became {err} at step {observation.step}"
            self._restore(said)
            if self._failures >= MAX_FAILURES:
                raise MapError(
                    f"{said}, as in the {MAX_FAILURES - 1} frames before; check that depth and pose are possible, or "
                    "lower the learning rates."
                ) from err
        else:
            self._failures = 0 if num_iterations else self._failures
        return MapUpdate(loss, done, len(self.keyframes))

    def move_keyframes(self, from_end: Int64[np.ndarray, " m"], T_world_camera: Float[np.ndarray, "m 4 4"]) -> None:
        """As of :class:`~.neural_map.NeuralMap`; the last frame goes with the last keyframe, which it is."""
        self.keyframes.move(len(self.keyframes) - from_end, T_world_camera)
        if self._last is not None and 1 in from_end:
            self._last = replace(self._last, T_world_camera=T_world_camera[from_end.tolist().index(1)])

    def retrain(self, count: int, grid: OccupancyGrid) -> int:
        """Train on the keyframes as they stand now, after they were moved. Returns the number of iterations: 0 where
        nothing was observed, or where the loss was not finite and the field is as it was before.
        """
        if self._last is None or not count:
            return 0
        self._keep_or_restore(self._last.step)
        try:
            for _ in self._train(self._last, count, grid, first=False):
                pass
        except _NotFinite as err:
            self._restore(f"The loss of the training on moved keyframes became {err}")
            return 0
        return count

    def finish(self, grid: OccupancyGrid) -> int:
        """Train on the keyframes once more, at falling learning rates, when no frame is to come.

        A constant rate follows new frames quickly, and keeps the parameters in motion about the best ones; with a
        falling rate they settle. Returns the number of iterations: ``schedule.final_iterations``, or none where nothing
        was observed, or where the loss was not finite and the field is as it was before.
        """
        done, optimizer = self.config.schedule.final_iterations, self.config.optimizer
        if self._last is None or not done:
            return 0
        self._keep_or_restore(self._last.step)
        try:
            for k, share in enumerate(_FINAL_RATES):
                count = (done + k) // len(_FINAL_RATES)  # The parts add up to all.
                rates = share * optimizer.table_learning_rate, share * optimizer.decoder_learning_rate
                slower = replace(optimizer, table_learning_rate=rates[0], decoder_learning_rate=rates[1])
                self._replace_backend(replace(self.config, optimizer=slower), self.backend.parameters())
                for _ in self._train(self._last, count, grid, first=False):
                    pass
        except _NotFinite as err:
            done = 0
            self._restore(f"The loss of the final training became {err}")
        self._replace_backend(self.config, self.finite_parameters())
        return done

    def finite_parameters(self) -> Parameters:
        """Copies of the parameters, all of which are finite, by name; the last good ones where one is not."""
        parameters = self.backend.parameters()
        if _are_finite(parameters) or self._good is None:
            return parameters
        self._restore("Parameters of the map were not finite any more")
        return self.backend.parameters()

    def get_state(self) -> dict[str, np.ndarray]:
        """Parameters and optimiser of the engine, for a checkpoint."""
        self.finite_parameters()  # Goes back where one is not finite.
        return self.backend.get_state()

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`get_state` gave; the table may have grown since the start. Raises MapError if it does
        not fit the configuration.
        """
        if self.backend.config.field != self.config.field:
            self.backend = make_backend(self.config, seed=self.seed, device=self._device)
        # Torch takes no arrays that are read-only.
        self.backend.set_state({name: np.array(value) for name, value in state.items()})

    def fit_table(self, surface_volume_m3: float) -> None:
        """Double the table while the scene is large for it; every place keeps the features it has learnt.

        The optimiser starts afresh, as its moments belong to an engine; that happens a few times in a run at most.
        ``surface_volume_m3`` is that of the occupancy grid's blocks that hold surface. An engine without a table stays.
        """
        while True:
            field = self.config.field
            wanted = field.entries_per_m3 * surface_volume_m3
            if field.log2_table_size >= field.largest_log2_table_size or wanted <= 1 << field.log2_table_size:
                return
            parameters = self.backend.parameters()
            if "table" not in parameters:
                return
            parameters["table"] = doubled_table(parameters["table"], field)
            good = self._good
            if good is not None:
                self._good = {**good, "table": doubled_table(good["table"], field)}
            self.config = replace(self.config, field=replace(field, log2_table_size=field.log2_table_size + 1))
            self._replace_backend(self.config, parameters)

    def close(self) -> None:
        """Free engine and keyframes; the field can neither be trained nor asked afterwards."""
        self.keyframes = KeyframeStore(0, 1.0)
        self._good = None
        self._last = None
        del self.backend

    def _keep_or_restore(self, step: int) -> None:
        """Keep the parameters, or go back where one of them is not finite; the log names the step."""
        parameters = self.backend.parameters()
        if _are_finite(parameters):
            self._good, self._good_frame = parameters, self.num_frames
        else:
            self._restore(f"Parameters of the map were not finite any more at step {step}")

    def _restore(self, why: str) -> None:
        """Go back to the parameters that were kept, with an optimiser that starts afresh; ``why`` is logged."""
        if self._good is None:
            _logger.warning("%s, and no good ones were kept.", why)
            return
        frames = self.num_frames - self._good_frame
        ago = f" {frames} frames ago" if frames > 0 else " before"
        _logger.warning("%s; the map goes back to what it was%s.", why, ago)
        self.backend.set_parameters(self._good)

    def _replace_backend(self, config: MappingConfig, parameters: Parameters) -> None:
        self.backend = make_backend(config, seed=self.seed, device=self._device, parameters=parameters)

    def _train(
        self, observation: Observation, count: int, grid: OccupancyGrid, *, first: bool, current_rays: int | None = None
    ) -> Iterator[float]:
        """Train on rays of the keyframes and, after the first frame, of the one at hand; the loss of each iteration.
        Raises _NotFinite if a loss is not finite.
        """
        schedule = self.config.schedule
        num_current = 0 if first else max(schedule.num_rays // len(self.keyframes), schedule.min_current_rays)
        if current_rays is not None:
            num_current = min(num_current, current_rays)
        smooth = not first and self.config.loss.smoothness != 0.0
        for start in range(0, count, _DRAWN_TOGETHER):
            together = min(_DRAWN_TOGETHER, count - start)
            batches = self.keyframes.batches(together, schedule.num_rays, observation, num_current, self._rng)
            draws: list[tuple[int, Float[np.ndarray, "3"] | None]] = []
            for _ in range(together):
                corner = self._smoothness_corner(grid) if smooth else None
                draws.append((int(self._rng.integers(1 << 32)), corner))
            for losses in self.backend.steps(batches, draws):
                if not math.isfinite(losses.total):
                    terms = losses._asdict()
                    del terms["total"]
                    named = ", ".join(f"{name} {value:g}" for name, value in terms.items())
                    raise _NotFinite(f"{losses.total:g} ({named})")
                self.is_trained = True
                yield losses.total

    def _smoothness_corner(self, grid: OccupancyGrid) -> Float[np.ndarray, "3"]:
        """A random place for the smoothness lattice within the box that was fused so far, or about its middle."""
        loss = self.config.loss
        size = np.array(grid.state.shape[::-1]) * grid.resolution_m
        room = size - (loss.smoothness_points - 1) * loss.smoothness_spacing_m
        return grid.origin_m + np.where(room > 0.0, self._rng.random(3), 0.5) * room


def _are_finite(parameters: Parameters) -> bool:
    """Whether no parameter is NaN or infinite, nor so large that their sum overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return all(bool(np.isfinite(array.sum())) for array in parameters.values())
