"""The map: a neural field trained online from posed RGB-D, and the occupancy grid that says where to trust it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, UInt8

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.select import make_backend, with_available_engine
from anm_mj.mapping.config import MappingConfig
from anm_mj.mapping.expected_error import EXPONENT, reducible_error_m
from anm_mj.mapping.field_geometry import FieldGeometry
from anm_mj.mapping.former_surface import FormerSurface
from anm_mj.mapping.grid_layout import doubled_table
from anm_mj.mapping.keyframes import Keyframes, KeyframeStore
from anm_mj.mapping.last_good import LastGood
from anm_mj.mapping.last_layer import last_layer_variance, observation_density
from anm_mj.mapping.map_file import SavedMap, read_map, write_map
from anm_mj.mapping.mesh import MeshExtractor, colored_mesh
from anm_mj.mapping.occupancy import OccupancyGrid
from anm_mj.mapping.surface import SurfaceExtractor
from anm_mj.mapping.uncertainty import uncertainty_at
from anm_mj.mapping.view import view_samples
from anm_mj.sensing.pixel_state import judge_pixels, valid_pixels
from anm_mj.types import (
    UNKNOWN,
    Intrinsics,
    MapUpdate,
    Observation,
    SurfaceChange,
    SurfaceErrors,
    SurfacePoints,
    TrainingEffort,
    VoxelGrid,
)

if TYPE_CHECKING:
    import trimesh

_FINAL_RATES = (1 / 2, 1 / 4, 1 / 8, 1 / 16)
"""Factors on the learning rates over the parts of the final training."""
_DRAWN_TOGETHER = 10
"""Iterations whose rays are drawn in one go, because the price of a draw hardly depends on its size."""
MAX_FAILURES = 5
"""So many frames in a row whose loss was not finite end the training."""


class _NotFinite(Exception):
    """The training loss is not finite."""


class NeuralMap:
    """Implements :class:`anm_mj.protocols.Mapper`.

    Training effort is counted in iterations, never in seconds: with the same seed, observations and machine type, the
    parameters are the same bit for bit on a CPU.
    """

    REBUILT = ("backend", "_device", "_mesh", "_good")

    def __init__(
        self, config: MappingConfig, *, seed: int, device: str = "auto", field_is_geometry: bool = True
    ) -> None:
        """An empty map.

        Args:
            config: Settings of the stage.
            seed: Start values, choice of rays, jitter and perturbations all derive from it.
            device: "auto" (CUDA where there is one), "cpu" or "cuda".
            field_is_geometry: Whether the field decides what is free and what is occupied, or the depth alone.

        Raises:
            MapError: If the device or the engine that the configuration names is unknown or absent.
        """
        self.config = config
        self.seed = seed
        self._device = device
        self.backend: MapperBackend = make_backend(config, seed=seed, device=device)
        self._rng = np.random.default_rng([seed, 1])
        self._keyframes = KeyframeStore(
            config.schedule.replay_bytes, config.schedule.pixel_share, self.backend.pixel_memory
        )
        self._occupancy = OccupancyGrid(config.occupancy)
        self._geometry = FieldGeometry(self._occupancy) if field_is_geometry else None
        self._surface = SurfaceExtractor(self._occupancy, config.surface_lattice_m)
        self._mesh = MeshExtractor(self._occupancy)
        self._former: FormerSurface | None = None
        """What was here before, where the map goes on from that of a former run."""
        self.is_trained = False
        """Whether the field was ever trained; else it says nothing, and only the occupancy means something."""
        self._num_frames = 0
        self._last: Observation | None = None
        """The last frame that was not blind."""
        self._good = LastGood()
        """After a resume, the state that the run resumed from."""
        self._failures = 0
        """Frames in a row whose loss was not finite."""

    @property
    def engine_name(self) -> str:
        """What computes the map, for the run's manifest: "torch", "triton", or "native" with its instruction set."""
        return self.backend.name

    def integrate(self, observation: Observation, effort: TrainingEffort | None = None) -> MapUpdate:
        """Fuse one observation into the occupancy grid, keep it if it is a keyframe, and train as the schedule says.

        With an ``effort``, every frame but the first is trained on with that.

        A training loss that is not finite takes the parameters back to the last good ones (:mod:`.last_good`); the
        frame's training ends there, its loss is NaN, and the next frame goes on from them.

        Raises:
            MapError: If the loss is not finite in :data:`MAX_FAILURES` frames in a row.
        """
        schedule = self.config.schedule
        observation = judge_pixels(observation)
        # A blind frame too: readers of the occupancy need a grid with at least the camera's place in it.
        self._occupancy.integrate(
            observation.depth_m, observation.intrinsics, observation.T_world_camera, observation.range_m
        )
        if not valid_pixels(observation).any():
            return MapUpdate(math.nan, 0, len(self._keyframes))
        self._fit_table()
        first = self._num_frames == 0
        is_keyframe = None if effort is None or first else effort.is_keyframe
        if self._num_frames % schedule.keyframe_every == 0 if is_keyframe is None else is_keyframe:
            self._keyframes.add(observation, self._rng, self._replay_weight(observation))
            if self._former is not None:
                self._former.forget_contradicted(self._keyframes, self._occupancy.grid, self._occupancy.corner)
        num_iterations = 0
        if first:
            num_iterations = schedule.first_iterations
        elif effort is not None:
            num_iterations = effort.iterations
        elif self._num_frames % schedule.train_every == 0:
            num_iterations = schedule.iterations
        self._num_frames += 1
        self._last = observation
        loss, done = math.nan, 0
        if num_iterations and self._good.is_due(self._num_frames):
            self._good.keep_or_restore(self.backend, self._num_frames, observation.step)
        try:
            current_rays = None if effort is None else effort.current_rays
            for latest in self._train(observation, num_iterations, first=first, current_rays=current_rays):
                loss, done = latest, done + 1
        except _NotFinite as err:
            loss = math.nan
            self._failures += 1
            self._good.restore(
                self.backend, self._num_frames, f"The training loss became {err} at step {observation.step}"
            )
            if self._failures >= MAX_FAILURES:
                raise MapError(
                    f"The training loss became {err} at step {observation.step}, as in the {MAX_FAILURES - 1} frames "
                    "before; check that depth and pose are possible, or lower the learning rates."
                ) from err
        else:
            self._failures = 0 if num_iterations else self._failures
        return MapUpdate(loss, done, len(self._keyframes))

    def finish(self) -> int:
        """Train on the keyframes once more, at falling learning rates, when no frame is to come.

        A constant rate follows new frames quickly, and keeps the parameters in motion about the best ones; with a
        falling rate they settle.

        Returns:
            How many iterations it trained: ``schedule.final_iterations``, or none where nothing was observed, or where
            the loss was not finite and the map is as it was before.
        """
        count, optimizer = self.config.schedule.final_iterations // len(_FINAL_RATES), self.config.optimizer
        if self._last is None or not count:
            return 0
        self._good.keep_or_restore(self.backend, self._num_frames, self._last.step)
        done = count * len(_FINAL_RATES)
        try:
            for share in _FINAL_RATES:
                rates = share * optimizer.table_learning_rate, share * optimizer.decoder_learning_rate
                slower = replace(optimizer, table_learning_rate=rates[0], decoder_learning_rate=rates[1])
                self._take_engine(replace(self.config, optimizer=slower), self.backend.get_state())
                for _ in self._train(self._last, count, first=False):
                    pass
        except _NotFinite as err:
            done = 0
            self._good.restore(self.backend, self._num_frames, f"The loss of the final training became {err}")
        self._take_engine(self.config, self._good.finite_state(self.backend, self._num_frames))
        # What was read from the field before is read anew.
        self._surface = SurfaceExtractor(self._occupancy, self.config.surface_lattice_m)
        self._geometry = FieldGeometry(self._occupancy) if self._geometry is not None else None
        return done

    @property
    def truncation_m(self) -> float:
        """Distance from surface beyond which the SDF says no more than 'far' [m]."""
        return self.config.field.truncation_m

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Signed distance at world points [m], positive in free space, truncated to +-``truncation_m``.

        Where nothing was observed the value means nothing; ask ``occupancy``.
        """
        return np.clip(self.backend.query_sdf(points_m), -1.0, 1.0) * np.float32(self.truncation_m)

    def rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points [m]."""
        return self.backend.query_rgb(points_m)

    def uncertainty(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """How unsure the map is at world points [m], by the configured method (:mod:`anm_mj.mapping.uncertainty`).

        A variance whose scale depends on the method; the same map always gives the same answer.
        """
        return uncertainty_at(
            self.backend,
            self._occupancy,
            points_m,
            self.config.uncertainty,
            self.seed,
            self.config.schedule.density_exponent,
        )

    def surface(
        self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, max_height_m: float = math.inf
    ) -> SurfacePoints:
        """Zero-crossings near occupied voxels within ``radius_m`` [m] in the plane, with present uncertainties.

        Positions and normals of a block are those of the last frame that saw it. Points above ``max_height_m`` are left
        out.
        """
        points, normals = self._surface.extract(self.backend.query_sdf, centre_xy_m, radius_m, max_height_m)
        return SurfacePoints(points, normals, self.uncertainty(points))

    def surface_errors(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> SurfaceErrors:
        """Expected errors at the zero-crossings near occupied voxels within ``radius_m`` [m] in the plane.

        They come from the last-layer variance, whatever method is configured for :meth:`uncertainty`, because that
        predicts the true error best (:mod:`anm_mj.mapping.expected_error`).
        """
        points = self._surface.places(self.backend.query_sdf, centre_xy_m, radius_m)
        density_exponent = self.config.schedule.density_exponent
        variance = last_layer_variance(self.backend, self._occupancy, points, density_exponent)
        count = observation_density(self._occupancy, points).astype(np.float32)
        return SurfaceErrors(points, reducible_error_m(variance), count, (1.0 - density_exponent) * EXPONENT)

    @property
    def observed(self) -> OccupancyGrid:
        """What depth alone says, and how often each place was observed; :attr:`occupancy` is read from it."""
        return self._occupancy

    @property
    def occupancy(self) -> VoxelGrid:
        """Free, occupied and unknown space as of now; views of the arrays within.

        Depth decides what was observed; between free and occupied the field decides, or the depth, as set at the start.
        """
        return self._occupancy.grid if self._geometry is None else self._geometry.grid(self.sdf)

    def occupancy_about(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> VoxelGrid:
        """The occupancy, as of now within ``radius_m`` [m] of a place along both axes, maybe of earlier elsewhere.

        It costs a fraction of the whole one.
        """
        if self._geometry is None:
            return self._occupancy.grid
        return self._geometry.grid(self.sdf, np.stack([centre_xy_m - radius_m, centre_xy_m + radius_m]))

    def mesh(self, resolution_m: float = 0.05, *, reuse: bool = False) -> trimesh.Trimesh:
        """The observed surface in the world [m], with vertex colours; faces look into free space.

        Args:
            resolution_m: Edge of a marching-cubes cell [m].
            reuse: Ask the field only where frames have come in since the last call with this resolution and keep the
                rest, for a view of a run as it goes.

        Raises:
            MapError: If the resolution is not positive.
        """
        return colored_mesh(self._mesh.extract(self.backend.query_sdf, self.rgb, resolution_m, reuse=reuse))

    def render(
        self, intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and planar depth [m] as the map believes a camera would see them (Eq. 1).

        Samples lie about the first surface along each ray that something was observed at; a ray that meets none is
        black, with NaN depth.
        """
        origin, direction, z, hit = view_samples(
            self._occupancy, self.backend.query_sdf, intrinsics, T_world_camera, self.config.field.truncation_m
        )
        rgb = np.zeros((intrinsics.height * intrinsics.width, 3), np.uint8)
        depth = np.full(len(rgb), np.nan, np.float32)
        rendered, rendered_depth = self.backend.render(origin, direction, z)
        rgb[hit] = np.rint(rendered * 255.0).astype(np.uint8)
        depth[hit] = rendered_depth
        shape = (intrinsics.height, intrinsics.width)
        return rgb.reshape(*shape, 3), depth.reshape(shape)

    def save(self, path: Path) -> None:
        """Write parameters, configuration and occupancy to ``path`` (``map.safetensors``).

        Keyframes and the optimiser's moments are not kept: a loaded map answers as the saved one does, and can take in
        more frames, but replays none of the earlier ones.
        """
        arrays = {
            f"field.{name}": value for name, value in self._good.finite_state(self.backend, self._num_frames).items()
        }
        arrays |= {f"occupancy.{name}": value for name, value in self._occupancy.get_state().items()}
        write_map(path, SavedMap(self.config, self.seed, self._num_frames, arrays))

    @classmethod
    def load(cls, path: Path, *, device: str = "auto", field_is_geometry: bool = True) -> NeuralMap:
        """The map that was saved at ``path``.

        Args:
            path: The file, ``map.safetensors`` of a run folder, or ``map.pt`` of an older one.
            device: As of a new map.
            field_is_geometry: As of a new map; the file does not say.

        Raises:
            MapError: If the file is missing or is not such a map.
        """
        saved = read_map(path)
        config = with_available_engine(saved.config)
        loaded = cls(config, seed=saved.seed, device=device, field_is_geometry=field_is_geometry)
        loaded._take_arrays(saved)
        loaded._num_frames = saved.num_frames
        return loaded

    def continue_from(self, saved: SavedMap, keyframes: Keyframes) -> None:
        """Begin with the map of a former run, which must have this map's :attr:`config` but for effort and rates.

        A few frames that contradict it suffice to change it, and :meth:`changes` tells what they have changed.

        Args:
            saved: the former map.
            keyframes: those of its frames that are to be replayed.

        Raises:
            MapError: They do not fit this map.
        """
        self._take_arrays(saved)
        former = self.occupancy
        self._occupancy.soften()
        self._keyframes.replace(0, keyframes)
        self._former = FormerSurface(
            former.state, self._occupancy.corner, former.resolution_m, keyframes, former.version
        )
        # The next frame is a keyframe, and one to train on.
        round_up = math.lcm(self.config.schedule.keyframe_every, self.config.schedule.train_every)
        self._num_frames = math.ceil(saved.num_frames / round_up) * round_up

    def _take_arrays(self, saved: SavedMap) -> None:
        """Take over field and occupancy.

        Raises:
            MapError: They are not what the configuration says, or damaged.
        """
        try:
            self.backend.set_state(_part(saved.arrays, "field."))
            self._occupancy.set_state(_part(saved.arrays, "occupancy."))
        except (ValueError, KeyError) as err:
            raise MapError(f"The saved map is damaged ({err}); explore anew.") from err
        schedule = saved.config.schedule
        self.is_trained = max(schedule.first_iterations, schedule.iterations, schedule.final_iterations) > 0

    def changes(self) -> tuple[SurfaceChange, ...] | None:
        """What new frames have found to be gone or new, largest first; None for a map that began empty."""
        if self._former is None:
            return None
        raw, state = self._occupancy.grid.state, self.occupancy.state
        # Where depth and field disagree, nothing is certain.
        agreed = np.where(raw == state, state, np.int8(UNKNOWN))
        return self._former.changes(agreed, self._occupancy.corner)

    def replay(self, limit_bytes: int) -> Keyframes:
        """What is replayed of the keyframes, thinned to so much memory."""
        return self._keyframes.keyframes().thinned(limit_bytes)

    def close(self) -> None:
        """Give the memory back: only settings and ``is_trained`` can be asked any more. May be called again."""
        kept = {"config": self.config, "seed": self.seed, "is_trained": self.is_trained}
        vars(self).clear()
        vars(self).update(kept)

    def checkpoint_state(self) -> dict[str, np.ndarray]:
        """Parameters and optimiser of the engine, for a checkpoint."""
        return {**self._good.finite_state(self.backend, self._num_frames), **self.backend.get_optimizer()}

    def restore_state(self, state: dict[str, np.ndarray]) -> None:
        """Take over what :meth:`checkpoint_state` gave; the table may have grown since the start.

        Raises:
            MapError: It does not fit the configuration.
        """
        if self.backend.config.field != self.config.field:
            self.backend = make_backend(self.config, seed=self.seed, device=self._device)
        # Torch takes no arrays that are read-only.
        state = {name: np.array(value) for name, value in state.items()}
        self.backend.set_state(state)
        self.backend.set_optimizer(state)

    def _replay_weight(self, observation: Observation) -> Float32[np.ndarray, "h w"] | None:
        """Weights by which a keyframe's pixels are drawn for replay; None for uniform ones.

        An image shows a near floor with thousands of pixels and a chair's leg with ten, once. Uniform draws keep
        improving the floor while surface with few observations stays unlearnt.
        """
        exponent = self.config.schedule.density_exponent
        if exponent == 0.0:
            return None
        count = self._occupancy.observation_count(
            observation.depth_m, observation.intrinsics, observation.T_world_camera
        )
        known = count > 0
        # Pixels that show no surface get the weight of a typical one.
        usual = np.median(count[known]) if known.any() else 1.0
        return np.where(known, count, usual).astype(np.float32) ** np.float32(-exponent)

    def _fit_table(self) -> None:
        """Double the table while the scene is large for it; every place keeps the features it has learnt.

        The optimiser starts afresh, as its moments belong to an engine; that happens a few times in a run at most.
        """
        while True:
            field = self.config.field
            wanted = field.entries_per_m3 * self._occupancy.surface_volume_m3
            if field.log2_table_size >= field.largest_log2_table_size or wanted <= 1 << field.log2_table_size:
                return
            state = self.backend.get_state()
            state["table"] = doubled_table(state["table"], field)
            self._good.double_table(field)
            self.config = replace(self.config, field=replace(field, log2_table_size=field.log2_table_size + 1))
            self._take_engine(self.config, state)

    def _take_engine(self, config: MappingConfig, state: dict[str, Float32[np.ndarray, "..."]]) -> None:
        """Go on with a new engine of another configuration, from given parameters."""
        self.backend = make_backend(config, seed=self.seed, device=self._device, state=state)

    def _train(
        self, observation: Observation, count: int, *, first: bool, current_rays: int | None = None
    ) -> Iterator[float]:
        """Train on rays of the keyframes and, after the first frame, of the one at hand; the loss of each iteration.

        Raises:
            _NotFinite: If a loss is not finite.
        """
        schedule = self.config.schedule
        num_current = 0 if first else max(schedule.num_rays // len(self._keyframes), schedule.min_current_rays)
        if current_rays is not None:
            num_current = min(num_current, current_rays)
        smooth = not first and self.config.loss.smoothness != 0.0
        for start in range(0, count, _DRAWN_TOGETHER):
            together = min(_DRAWN_TOGETHER, count - start)
            batches = self._keyframes.batches(together, schedule.num_rays, observation, num_current, self._rng)
            draws: list[tuple[int, Float[np.ndarray, "3"] | None]] = []
            for _ in range(together):
                corner = self._smoothness_corner() if smooth else None
                draws.append((int(self._rng.integers(1 << 32)), corner))
            for losses in self.backend.steps(batches, draws):
                if not math.isfinite(losses.total):
                    terms = ", ".join(
                        f"{name} {value:g}" for name, value in losses._asdict().items() if name != "total"
                    )
                    raise _NotFinite(f"{losses.total:g} ({terms})")
                self.is_trained = True
                yield losses.total

    def _smoothness_corner(self) -> Float[np.ndarray, "3"]:
        """A random place for the smoothness lattice within the box that was fused so far, or about its middle."""
        loss = self.config.loss
        grid = self._occupancy.grid
        size = np.array(grid.state.shape[::-1]) * grid.resolution_m
        room = size - (loss.smoothness_points - 1) * loss.smoothness_spacing_m
        return grid.origin_m + np.where(room > 0.0, self._rng.random(3), 0.5) * room


def _part(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
