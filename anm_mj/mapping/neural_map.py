"""The map: a neural field trained online from posed RGB-D, and the occupancy grid that says where to trust it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Int64, UInt8

from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.depth_occupancy import MovedPoses
from anm_mj.mapping.field import Field
from anm_mj.mapping.keyframes import Keyframes
from anm_mj.mapping.last_layer import CONSTANT_M, expected_errors
from anm_mj.mapping.map_file import SavedMap, read_map, write_map
from anm_mj.mapping.mapping_config import MAPPING_PRESETS, MappingConfig
from anm_mj.mapping.mesh import MeshExtractor, colored_mesh
from anm_mj.mapping.occupancy import Occupancy
from anm_mj.mapping.occupancy_kernels import DepthFrame
from anm_mj.mapping.prior_surface import PriorSurface
from anm_mj.mapping.surface import SurfaceExtractor
from anm_mj.mapping.uncertainty import uncertainty_at
from anm_mj.mapping.view import render_view
from anm_mj.sensing.pixel_state import judge_pixels, valid_pixels, without_moved
from anm_mj.types import (
    Intrinsics,
    MapUpdate,
    Observation,
    OccupancyGrid,
    SurfaceChange,
    SurfaceErrors,
    SurfacePoints,
    TrainingEffort,
)

if TYPE_CHECKING:
    import trimesh


def make_map(preset: str = "default", *, seed: int = 0, device: str = "auto") -> NeuralMap:
    """An empty neural map; ``integrate`` it with observations. ``preset`` is the mapping effort, a key of
    :data:`anm_mj.mapping.mapping_config.MAPPING_PRESETS`; seed and device are as of :class:`NeuralMap`. Raises MapError
    if there is no such preset, the seed is no number from 0 up to 2^63 - 1, or the device is unknown or absent.
    """
    if not 0 <= seed < 1 << 63:
        raise MapError(f"The seed is {seed}; give a whole number from 0 up to {(1 << 63) - 1}.")
    if preset not in MAPPING_PRESETS:
        raise MapError(f"There is no mapping preset '{preset}'; choose one of {', '.join(MAPPING_PRESETS)}.")
    return NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device=device)


class NeuralMap:
    """Implements :class:`anm_mj.protocols.Mapper`: hands observations and questions to field and occupancy."""

    REBUILT = ("_mesh",)

    def __init__(self, config: MappingConfig, *, seed: int, device: str = "auto") -> None:
        """An empty map. Start values, choice of rays, jitter and perturbations all derive from ``seed``; ``device`` is
        "auto" (the CPU with the native engine, else CUDA where there is one), "cpu" or "cuda". Raises MapError if the
        device or the engine that the configuration names is unknown or absent.
        """
        self.field = Field(config, seed=seed, device=device)
        self.occupancy = Occupancy(config)
        """The occupancy grid, by depth alone and as the field refines it."""
        self._prior: PriorSurface | None = None
        """What was here before, where the map goes on from that of a prior run."""
        self._start_readers()

    def _start_readers(self) -> None:
        """Remember nothing that was read from the field."""
        self.occupancy.forget_field()
        self._surface = SurfaceExtractor(self.occupancy.by_depth, self.config.surface_lattice_m)
        self._mesh = MeshExtractor(self.occupancy.by_depth)

    @property
    def config(self) -> MappingConfig:
        """Settings of the stage, with the table as large as it has become."""
        return self.field.config

    @property
    def backend(self) -> MapperBackend:
        """The engine that holds the field's parameters; another one when the table has grown."""
        return self.field.backend

    @property
    def is_trained(self) -> bool:
        """Whether the field was ever trained; else it says nothing, and only the occupancy means something."""
        return self.field.is_trained

    def find_moved(self, observation: Observation) -> Observation:
        """The frame with the pixels told apart that show something moved, as far as the map knows by now."""
        if not self.config.moving.detect:
            return observation
        moved = self.occupancy.by_depth.find_moved(judge_pixels(observation))
        return observation if moved is None else without_moved(observation, moved)

    def hold_moved(self, discs: Float[np.ndarray, "n 3"]) -> None:
        """Take what the last frame showed to move for an obstacle; see the protocol."""
        self.occupancy.by_depth.hold_moved(discs)

    def release_moved(self) -> bool:
        """Take nothing that moved for an obstacle any more; whether anything was."""
        return self.occupancy.by_depth.release_moved()

    def doubt_moved(self) -> bool:
        """Take for free space for now what may be left of something that moved; see the protocol."""
        return self.occupancy.by_depth.doubt_moved()

    def settle_moved(self) -> None:
        """No frame is to come: take what was doubted and not seen since for surface again, and hold nothing."""
        if self.occupancy.by_depth.settle_moved():
            self.occupancy.forget_field()

    def integrate(self, observation: Observation, effort: TrainingEffort | None = None) -> MapUpdate:
        """Fuse one observation into the occupancy grid, keep it if it is a keyframe, and train as the schedule says.

        With an ``effort``, every frame but the first is trained on with that. Raises MapError if the loss was not
        finite for several frames in a row, the grid becomes too large or reaches too far from the origin, or the images
        are not those of one camera.
        """
        _require_images(observation)
        observation = judge_pixels(observation)
        # A blind frame too: readers of the occupancy need a grid with at least the camera's place in it.
        by_depth = self.occupancy.by_depth
        view = observation.intrinsics, observation.T_world_camera, observation.known_range_m
        by_depth.integrate(observation.depth_m, *view, observation.moved_m)
        if not valid_pixels(observation).any():
            return MapUpdate(math.nan, 0, len(self.field.keyframes))
        self.field.fit_table(by_depth.surface_volume_m3())
        if self.field.wants_keyframe(effort):
            weight = by_depth.replay_weight(observation, self.config.schedule.density_exponent)
            self.field.add_keyframe(observation, weight)
            if self._prior is not None:
                self._prior.forget_contradicted(self.field.keyframes, by_depth.grid, by_depth.voxels.corner)
        return self.field.learn(observation, by_depth.grid, effort)

    def move_keyframes(self, from_end: Int64[np.ndarray, " m"], T_world_camera: Float[np.ndarray, "m 4 4"]) -> None:
        """Give keyframes other poses (camera to world); training follows. They are counted from the last one, which is
        1: of a prior run some may have gone.
        """
        self.field.move_keyframes(from_end, T_world_camera)

    def rebuild(self, frames: Iterable[DepthFrame], iterations: int, moved: MovedPoses | None = None) -> None:
        """Follow keyframes that were moved far: fuse the occupancy grid anew from depth images, train that often.

        ``moved`` as of :meth:`~.depth_occupancy.DepthOccupancy.rebuild`.
        """
        self.occupancy.by_depth.rebuild(frames, moved)
        self.field.retrain(iterations, self.occupancy.by_depth.grid)
        self._start_readers()

    def finish(self) -> int:
        """Train on the keyframes once more, when no frame is to come; the number of iterations."""
        self.settle_moved()
        done = self.field.finish(self.occupancy.by_depth.grid)
        if done:
            self._start_readers()
        return done

    @property
    def truncation_m(self) -> float:
        """Distance from surface beyond which the SDF says no more than 'far' [m]."""
        return self.config.field.truncation_m

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Signed distance at world points [m], positive in free space, truncated to +-``truncation_m``.

        Where nothing was observed the value means nothing; ask :meth:`occupancy_grid`.
        """
        _check_points(points_m)
        return self.field.sdf(points_m)

    def rgb(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
        """Colours in [0, 1] at world points [m]."""
        _check_points(points_m)
        return self.backend.query_rgb(points_m)

    def uncertainty(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """How unsure the map is at world points [m], by the configured method (:mod:`anm_mj.mapping.uncertainty`).

        A variance whose scale depends on the method; the same map always gives the same answer.
        """
        _check_points(points_m)
        return uncertainty_at(self.backend, self.occupancy.by_depth, points_m, self.config, self.field.seed)

    def surface(
        self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, max_height_m: float = math.inf
    ) -> SurfacePoints:
        """Zero-crossings near occupied voxels within ``radius_m`` [m] in the plane, with present uncertainties.

        Positions and normals of a block are those of the last frame that saw it. Points above ``max_height_m`` are out.
        """
        points, normals = self._surface.extract(self.backend.query_sdf, centre_xy_m, radius_m, max_height_m)
        return SurfacePoints(points, normals, self.uncertainty(points))

    def expected_error_m(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """How far the surface at world points on it [m] is expected to lie from the true one [m], the constant too."""
        exponent = self.config.schedule.density_exponent
        return expected_errors(self.backend, self.occupancy.by_depth, points_m, exponent).error_m + CONSTANT_M

    def surface_errors(self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float) -> SurfaceErrors:
        """Expected errors at the zero-crossings within ``radius_m`` [m] (:mod:`anm_mj.mapping.last_layer`)."""
        points = self._surface.places(self.backend.query_sdf, centre_xy_m, radius_m)
        return expected_errors(self.backend, self.occupancy.by_depth, points, self.config.schedule.density_exponent)

    def occupancy_grid(
        self, centre_xy_m: Float[np.ndarray, "2"] | None = None, radius_m: float = math.inf
    ) -> OccupancyGrid:
        """Free, occupied and unknown space; views of the arrays within.

        Depth decides what was observed; between free and occupied the field decides, or the depth, as
        ``mapping.geometry`` says. The grid is of now within ``radius_m`` [m] of a place in the world along both axes,
        and elsewhere maybe of an earlier call, which costs a fraction; without a place the whole grid is brought up to
        date.
        """
        return self.occupancy.grid(self.sdf, centre_xy_m, radius_m)

    def mesh(self, resolution_m: float = 0.05, *, reuse: bool = False) -> trimesh.Trimesh:
        """The observed surface in the world [m], with vertex colours; faces look into free space. ``resolution_m`` is
        the edge of a marching-cubes cell [m]. With ``reuse`` the field is asked only where frames have come in since
        the last call with this resolution and the rest is kept, for a view of a run as it goes. Raises MapError if the
        resolution is not positive.
        """
        return colored_mesh(self._mesh.extract(self.backend.query_sdf, self.rgb, resolution_m, reuse=reuse))

    def render(
        self, intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"], max_depth_m: float = math.inf
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colour and planar depth [m] as a camera would see the map (Eq. 1); black and NaN where no surface is up to
        ``max_depth_m`` [m].
        """
        return render_view(self.backend, self.occupancy.by_depth, intrinsics, T_world_camera, max_depth_m)

    def save(self, path: Path | str) -> None:
        """Write parameters, configuration and occupancy to ``path`` (``map.safetensors``).

        Keyframes and the optimiser's moments are not kept: a loaded map answers as the saved one does, and can take in
        more frames, but replays none of the earlier ones. Raises OSError if the file cannot be written.
        """
        write_map(Path(path), SavedMap.of(self.field, self.occupancy.by_depth))

    @classmethod
    def load(cls, path: Path | str, *, device: str = "auto", geometry: str | None = None) -> NeuralMap:
        """The map that was saved at ``path``, the ``map.safetensors`` of a run folder; ``device`` is as of a new map,
        and ``geometry`` takes the place of the map's own ``mapping.geometry``. Raises MapError if the file is missing
        or is not such a map.
        """
        saved = read_map(Path(path))
        config = saved.config if geometry is None else replace(saved.config, geometry=geometry)
        loaded = cls(config, seed=saved.seed, device=device)
        saved.fill(loaded.field, loaded.occupancy.by_depth)
        return loaded

    def continue_from(self, saved: SavedMap, keyframes: Keyframes) -> None:
        """Begin with the map of a prior run, which must have this map's :attr:`config` but for effort and rates, and
        replay keyframes of it.

        A few frames that contradict it suffice to change it, and :meth:`changes` tells what they have changed. Raises
        MapError if ``saved`` or ``keyframes`` do not fit this map.
        """
        saved.fill(self.field, self.occupancy.by_depth)
        prior = self.occupancy_grid()
        self.occupancy.by_depth.soften()
        self.field.continue_from(keyframes, saved.num_frames)
        self._prior = PriorSurface(prior, self.occupancy.by_depth.voxels.corner, keyframes)

    def changes(self) -> tuple[SurfaceChange, ...] | None:
        """What new frames have found to be gone or new, largest first; None for a map that began empty."""
        if self._prior is None:
            return None
        voxels = self.occupancy.by_depth.voxels
        return self._prior.changes(self.occupancy_grid().state, voxels.state, voxels.corner)

    def replay(self, limit_bytes: int) -> Keyframes:
        """What is replayed of the keyframes, thinned to so much memory."""
        return self.field.keyframes.keyframes().thinned(limit_bytes)

    def close(self) -> None:
        """Free the memory; afterwards the map knows its settings and nothing else."""
        self.field.close()
        self.occupancy = Occupancy(self.config)
        self._prior = None
        self._start_readers()


def _require_images(observation: Observation) -> None:
    """Raises MapError for images of another type or size than an observation has: no kernel looks at that."""
    size = observation.intrinsics.height, observation.intrinsics.width
    for name, kind, shape in (("rgb", np.uint8, (*size, 3)), ("depth_m", np.float32, size)):
        image = getattr(observation, name)
        if image.dtype != kind or image.shape != shape:
            raise MapError(
                f"{name} of observation {observation.step} is {image.dtype} of shape {image.shape}; for these "
                f"intrinsics give {np.dtype(kind)} of shape {shape}."
            )


def _check_points(points_m: np.ndarray) -> None:
    """Raises MapError for anything but an array of points."""
    shape = np.shape(points_m)
    if len(shape) != 2 or shape[1] != 3:
        raise MapError(f"Points are an array of shape (n, 3) [m], this has {shape}; reshape it by .reshape(-1, 3).")
