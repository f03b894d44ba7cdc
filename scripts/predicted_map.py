"""Measures what predicting the map behind the frontier could save at most: ``gvg`` with the truth in unknown cells.

    python scripts/predicted_map.py --scene rmf_office --steps 2000 --starts 8
    python scripts/predicted_map.py --scene home --steps 300 --variants gvg both

Variants: ``gvg`` predicts nothing. ``gain``: rays of a view run on through unknown cells that are free in truth and end
at the true surface, which alone counts. ``both``: the graph, too, leads through such cells, so that tours do; the robot
drives up to where they begin and looks there. ``window``: the same with the truth up to ``--window-m`` behind what is
known to be free only. As in bench_planner.py, the occupancy grid is the map. Prints a line per run, and each variant
minus the first one, paired by start.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import tyro
from bench_planner import run
from jaxtyping import Bool, Float, Float16, Float32, Int, Int8
from scipy import ndimage

from anm_mj.evaluation.ground_truth import sample_triangles
from anm_mj.frames import world_to_cell, wrap_angle
from anm_mj.planning.change_reader import ChangeReader
from anm_mj.planning.distance_transform import capped_distance_cells
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.grid_windows import Window, bounds
from anm_mj.planning.paths import segments_clear
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import RIM_M, InformationGain
from anm_mj.planning.policies.gvg.policy import Gvg
from anm_mj.planning.policies.gvg.pooled_occupancy import KNOWN, PooledOccupancy
from anm_mj.planning.policies.gvg.ray_cache import INSIDE, RayCache, Rays
from anm_mj.planning.policies.gvg.tour import Tour
from anm_mj.planning.policies.gvg.transitions import Places
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.planning.topdown import MAX_CLEARANCE_M, MAX_DEPTH_M
from anm_mj.protocols import Mapper
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.navigable import scene_area
from anm_mj.scene.raster import Grid, clip_to_slab, rasterise
from anm_mj.types import (
    ARRIVED_M,
    FREE,
    OCCUPIED,
    TURN_STEP_RAD,
    UNKNOWN,
    Candidate,
    Footprint,
    Observation,
    Plan,
    TopDownMap,
    VoxelGrid,
)
from anm_mj.utils.arrays import dilate_mask, embed
from anm_mj.utils.stopwatch import Stopwatch

AHEAD_M = 0.6
"""At the end of known space the robot looks along the path to this far behind it [m]."""
REFUTED_M = 0.3
"""Where a look along the path leaves it unknown, nothing is predicted within this distance any more [m]."""
NUM_SAMPLES = 4_000_000
"""Samples of the surface that tell its inclination."""
LEAST_SLANT = 0.2
"""A ray covers at most 1 / this times the area that it would cover on a surface across it."""


class Truth:
    """The true scene, on the grids of the planner."""

    def __init__(self, scene: Scene, footprint: Footprint, window_m: float) -> None:
        vertices, faces = scene.triangles()
        self._triangles_m, self._area, self.window_m = vertices[faces], scene_area(scene, footprint), window_m
        self._samples_m, face = sample_triangles(vertices, faces, NUM_SAMPLES, 0)
        edges = self._triangles_m[face, 1:] - self._triangles_m[face, :1]
        normals = np.cross(edges[:, 0], edges[:, 1])
        self._normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float16)
        self.low_m, self.high_m = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)

    def cells(self, occupancy: PooledOccupancy, eye_m: Float[np.ndarray, "3"]) -> Int8[np.ndarray, "layers rows cols"]:
        """FREE where air is connected to the camera, UNKNOWN at surface, which is to be found, and KNOWN elsewhere."""
        layers, rows, cols = occupancy.state.shape
        grid, cell = Grid(occupancy.origin_m[:2], occupancy.cell_m, rows, cols), occupancy.cell_m
        low_m = occupancy.origin_m[2] + cell * np.arange(layers)
        hit = np.stack([rasterise(clip_to_slab(self._triangles_m, z, z + cell), grid) for z in low_m])
        labels, _ = ndimage.label(~hit)
        free = labels == labels.ravel()[occupancy.flat_index(eye_m[None])[0]]
        return np.where(hit, UNKNOWN, np.where(free, FREE, KNOWN)).astype(np.int8)

    def normals(self, occupancy: PooledOccupancy) -> Float16[np.ndarray, "cells 3"]:
        """The normal of some surface in each cell; 0 where there is none."""
        normals = np.zeros((occupancy.state.size, 3), np.float16)
        inside = occupancy.contains(self._samples_m)
        normals[occupancy.flat_index(self._samples_m[inside])] = self._normals[inside]
        return normals

    def columns(
        self, origin_xy_m: Float[np.ndarray, "2"], resolution_m: float, shape: tuple[int, int]
    ) -> Int8[np.ndarray, "rows cols"]:
        """State of the columns over the body's heights."""
        state = np.full(shape, UNKNOWN, np.int8)
        clear = self._area.clearance_m > 0.0
        labels, _ = ndimage.label(clear)
        rooms = np.isin(labels, np.unique(labels[self._area.component == 1])) & clear
        for mask, value in ((rooms, FREE), (~clear, OCCUPIED)):
            xy_m = self._area.grid.centres_m(*np.nonzero(mask))
            at = world_to_cell(xy_m, origin_xy_m, resolution_m)
            at = at[((at >= 0) & (at < shape)).all(axis=1)]
            state[at[:, 0], at[:, 1]] = value
        return state


class PredictedOccupancy(PooledOccupancy):
    """The pooled occupancy with the truth in unknown cells: of these, only unseen surface stays UNKNOWN."""

    def __init__(self, rim_m: float, truth: Truth, eye_m: Float[np.ndarray, "3"]) -> None:
        super().__init__(rim_m)
        self._observed, self._truth, self._eye_m, self._changes = PooledOccupancy(rim_m), truth, eye_m, ChangeReader()
        self._true = self.state
        self.normals = np.zeros((0, 3), np.float16)

    @property
    def seen_m2(self) -> float:
        """Surface truly seen [m2]."""
        return self._observed.seen_m2

    def update(
        self, grid: VoxelGrid, window: Window | None
    ) -> tuple[Float[np.ndarray, 2], Float[np.ndarray, 2]] | None:
        """All that was observed so far, from whatever distance, and the truth elsewhere."""
        del window
        observed = self._observed
        if not observed.cell_m:
            observed.update(self._spanning(grid), None)
        observed.update(grid, self._changes.take(grid))
        if self.epoch != observed.epoch:
            shape, start = observed.state.shape, np.zeros(3, int)
            if self.state.size:
                start = np.rint((self.origin_m - observed.origin_m) / observed.cell_m).astype(int)[::-1]
            self.tried_from_m = embed(self.tried_from_m, shape, start, np.inf)
            self.cell_m, self.origin_m, self.epoch = observed.cell_m, observed.origin_m, observed.epoch
            self.state, self.layer_share = np.full(shape, KNOWN, np.int8), np.ones(shape[0], np.float32)
            self._true, self.normals = self._truth.cells(self, self._eye_m), self._truth.normals(self)
        state = np.where(observed.state == UNKNOWN, self._true, observed.state)
        state[(state == UNKNOWN) & dilate_mask(observed.state == OCCUPIED)] = KNOWN
        if math.isfinite(self._truth.window_m):
            to_free = np.asarray(ndimage.distance_transform_edt(~(observed.state == FREE).any(axis=0)))
            beyond = to_free * self.cell_m > self._truth.window_m
            state[:, beyond] = observed.state[:, beyond]
        changed = bounds((state != self.state).any(axis=0), (slice(0, state.shape[1]), slice(0, state.shape[2])))
        self.state = state
        if not changed:
            return None
        corners = np.array([[part.start for part in changed[0][::-1]], [part.stop for part in changed[0][::-1]]])
        low_m, high_m = self.origin_m[:2] + corners * self.cell_m
        return low_m, high_m

    def _spanning(self, grid: VoxelGrid) -> VoxelGrid:
        """An unknown grid over the whole scene, with the cells of another one."""
        cell = grid.resolution_m
        low = np.floor((self._truth.low_m - grid.origin_m) / cell).clip(max=0)
        low[2] = 0  # Layers as observed.
        high = np.ceil((self._truth.high_m - grid.origin_m) / cell).clip(min=grid.state.shape[::-1])
        shape = tuple((high - low)[::-1].astype(int))
        state = np.broadcast_to(np.int8(UNKNOWN), shape)
        return VoxelGrid(state, np.broadcast_to(np.float32(np.inf), shape), grid.origin_m + low * cell, cell)


class PredictedGain(InformationGain):
    """Expected gain on the predicted occupancy."""

    def __init__(self, config: GvgConfig, camera: FieldOfView, truth: Truth, eye_m: Float[np.ndarray, "3"]) -> None:
        super().__init__(config, camera)
        self.occupancy = PredictedOccupancy(self.range_m + RIM_M, truth, eye_m)
        self._rays = RayCache(self.occupancy, camera=camera, range_m=self.range_m, num_elevations=config.num_elevations)
        edges = np.linspace(*camera.slopes(INSIDE), config.num_elevations + 1)
        azimuth, slope = np.meshgrid(
            np.arange(NUM_AZIMUTHS) * TURN_STEP_RAD, (edges[:-1] + edges[1:]) / 2, indexing="ij"
        )
        self._direction = np.stack([np.cos(azimuth), np.sin(azimuth), slope], axis=2).reshape(-1, 3).astype(np.float32)

    def _ray_gains(self, rays: Rays) -> Float32[np.ndarray, "n rays"]:
        """The area that each ray covers on a surface of the true inclination [m2]."""
        gain_m2 = super()._ray_gains(rays)
        place, ray = np.nonzero(gain_m2)
        normals = self.occupancy.normals[rays.hit[place, ray]].astype(np.float32)
        slant = np.abs((normals * self._direction[ray]).sum(axis=1))
        slant[~normals.any(axis=1)] = 1.0
        gain_m2[place, ray] /= np.maximum(slant, LEAST_SLANT)
        return gain_m2


class PredictedStages(Stages):
    """The stages with the graph of the predicted top-down map."""

    def __init__(self, context: PolicyContext[GvgConfig], truth: Truth) -> None:
        super().__init__(context.planning, context.footprint, coarse_far_field=True)
        self._truth, self._true = truth, np.zeros((0, 0), np.int8)
        self.known: TopDownMap | None = None
        self.refuted_xy_m: list[Float[np.ndarray, "2"]] = []

    def update_graph(
        self,
        mapper: Mapper,
        observation: Observation,
        topdown: TopDownMap,
        watch: Stopwatch,
        *,
        with_regions: bool = True,
    ) -> PlanningState:
        """Graph and paths on the predicted map."""
        self.known = topdown
        return super().update_graph(mapper, observation, self.predict(topdown), watch, with_regions=with_regions)

    def predict(self, known: TopDownMap) -> TopDownMap:
        """The map with the truth in unknown cells."""
        cell, truth = known.resolution_m, self._truth
        low = np.floor((truth.low_m[:2] - known.origin_xy_m) / cell).clip(max=0).astype(int)
        high = np.ceil((truth.high_m[:2] - known.origin_xy_m) / cell).clip(min=known.state.shape[::-1]).astype(int)
        shape, origin_m = (int(high[1] - low[1]), int(high[0] - low[0])), known.origin_xy_m + low * cell
        state = embed(known.state, shape, -low[::-1], np.int8(UNKNOWN))
        if self._true.shape != shape:
            self._true = truth.columns(origin_m, cell, shape)
        predicted = (state == UNKNOWN) & (self._true != UNKNOWN)
        if math.isfinite(truth.window_m):
            predicted &= np.asarray(ndimage.distance_transform_edt(state != FREE)) * cell <= truth.window_m
        rows, cols = np.ogrid[: shape[0], : shape[1]]
        for x, y in self.refuted_xy_m:
            x_m, y_m = origin_m[0] + (cols + 0.5) * cell - x, origin_m[1] + (rows + 0.5) * cell - y
            predicted &= x_m**2 + y_m**2 > REFUTED_M**2
        state[predicted] = self._true[predicted]
        surface, frontier = _new_borders(state, predicted)
        at_m = [origin_m + points * cell for points in (surface, frontier)]
        surface_m = np.concatenate([known.surface_xy_m, at_m[0]])
        return TopDownMap(_clearance_m(state == FREE, cell), state, cell, origin_m, surface_m, at_m[1])


def _new_borders(
    state: Int8[np.ndarray, "rows cols"], predicted: Bool[np.ndarray, "rows cols"]
) -> tuple[Float[np.ndarray, "s 2"], Float[np.ndarray, "f 2"]]:
    """Borders of free space at predicted obstacles, and all those at what stays unknown [cells]."""
    found = [], []
    for d_row, d_col in ((0, 1), (1, 0)):
        here, there = state[: len(state) - d_row, : state.shape[1] - d_col], state[d_row:, d_col:]
        new = predicted[: len(state) - d_row, : state.shape[1] - d_col] | predicted[d_row:, d_col:]
        ends, unknown = (here == FREE) != (there == FREE), (here == UNKNOWN) | (there == UNKNOWN)
        for points, mask in zip(found, (ends & new & ~unknown, ends & unknown), strict=True):
            row, col = np.nonzero(mask)
            points.append(np.stack([col + 0.5 + 0.5 * d_col, row + 0.5 + 0.5 * d_row], axis=1))
    return np.concatenate(found[0]), np.concatenate(found[1])


def _clearance_m(free: Bool[np.ndarray, "rows cols"], cell_m: float) -> Float[np.ndarray, "rows cols"]:
    """As :class:`anm_mj.planning.topdown.TopDownMapper` computes it [m]."""
    inside = capped_distance_cells(np.pad(free, 1), math.ceil(MAX_CLEARANCE_M / cell_m))[1:-1, 1:-1]
    outside = capped_distance_cells(~free, math.ceil(MAX_DEPTH_M / cell_m + 0.5))
    clearance = np.where(free, inside - np.float32(0.5), np.float32(0.5) - outside)
    return np.maximum(clearance * np.float32(cell_m), np.float32(-MAX_DEPTH_M))


class PredictedGvg(Gvg):
    """``gvg`` that knows the scene behind the frontier, but drives through known space only."""

    def __init__(self, context: PolicyContext[GvgConfig], truth: Truth, *, with_graph: bool) -> None:
        super().__init__(context)
        self._truth, self._refuted_xy_m = truth, None
        if with_graph:
            self._stages = PredictedStages(context, truth)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The plan of ``gvg``; where a look at the path ahead brought nothing, another one without that place."""
        while True:
            self._refuted_xy_m = None
            plan = super().plan(mapper, observation)
            if self._refuted_xy_m is None:
                return plan
            self._stages.refuted_xy_m.append(self._refuted_xy_m)
            self._target = None

    def _update_gain(self, mapper: Mapper, observation: Observation) -> InformationGain:
        if self._gain is None:
            eye_m = observation.T_world_camera[:3, 3]
            self._gain = PredictedGain(self.config, FieldOfView.of(observation), self._truth, eye_m)
        return super()._update_gain(mapper, observation)

    def _go(
        self,
        state: PlanningState,
        tour: Tour,
        places: Places,
        path: Float[np.ndarray, "k 2"],
        first_views: tuple[Candidate, ...],
        gain: InformationGain,
    ) -> Plan:
        """The plan as far as known space goes, and a look from there along the rest of the path."""
        known = getattr(self._stages, "known", None)
        fine, leg = _resampled(path, state.topdown.resolution_m / 2)
        clear = np.ones(0, bool)
        if known is not None:
            clear = segments_clear(known, fine[:-1], fine[1:], state.paths.safe_m, state.pose)
        if clear.all():
            return super()._go(state, tour, places, path, first_views, gain)
        pose, end = state.pose, int(clear.argmin())
        ahead = fine[min(end + round(AHEAD_M / state.topdown.resolution_m * 2), len(fine) - 1)]
        off = wrap_angle(math.atan2(*(ahead - fine[end])[::-1]) - pose.yaw_rad)
        turns = round(off / TURN_STEP_RAD)
        drives = math.dist(fine[end], pose.xy_m) > ARRIVED_M
        if not drives and not turns:
            self._refuted_xy_m = fine[end + 1]
        path = np.concatenate([path[: leg[end] + 1], fine[end : end + 1]]) if drives else path[:0]
        plan = super()._go(state, tour, places, path, first_views, gain)
        plan = replace(plan, headings_rad=(wrap_angle(pose.yaw_rad + turns * TURN_STEP_RAD),))
        target = self._target
        target.decide(
            target.viewpoint,
            plan,
            view_gain_m2=gain.expected_view(target.viewpoint).gain_m2,
            seen_m2=gain.seen_m2,
        )
        return plan


def _resampled(path: Float[np.ndarray, "k 2"], step_m: float) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, " n"]]:
    """Points along a path [m], and the leg that each lies on."""
    points, legs = [path[:1]], [0]
    for number, (start, end) in enumerate(itertools.pairwise(path)):
        share = np.linspace(0.0, 1.0, max(math.ceil(math.dist(start, end) / step_m), 1) + 1)[1:, None]
        points.append(start + share * (end - start))
        legs += [number] * len(share)
    return np.concatenate(points), np.array(legs)


VARIANTS = ("gvg", "gain", "both", "window")


def main(
    scene: str = "home",
    variants: tuple[str, ...] = VARIANTS,
    steps: int = 1000,
    starts: int = 1,
    window_m: float = 4.0,
    range_m: float = 4.5,
    tour_depth: int = 4,
    max_candidates: int = 16,
    discount_steps: float = 100.0,
) -> None:
    """Run and print.

    Args:
        scene: name or folder.
        variants: what to compare; the first is what the others are compared with.
        steps: budget of actions.
        starts: how many of the scene's starts.
        window_m: how far behind known free space ``window`` predicts [m].
        range_m: setting ``policy.gain_range_m`` of all variants but ``gvg`` [m].
        tour_depth: setting ``policy.tour_depth`` of these.
        max_candidates: setting ``policy.max_candidates`` of these.
        discount_steps: setting ``policy.discount_steps`` of these.
    """
    world = load_scene(scene)
    settings = GvgConfig(
        gain_range_m=range_m, tour_depth=tour_depth, max_candidates=max_candidates, discount_steps=discount_steps
    )

    def made(variant: str, body: Footprint) -> Gvg:
        if variant == "gvg":
            return Gvg(PolicyContext(body, GvgConfig(), goal="coverage"))
        truth = Truth(world, body, window_m if variant == "window" else math.inf)
        return PredictedGvg(PolicyContext(body, settings, goal="coverage"), truth, with_graph=variant != "gain")

    print("variant  start     AUC   final  90 % at  steps  contacts  p50 ms  end")
    figures = np.full((len(variants), starts, 2), np.nan)
    for number, start in enumerate(world.starts[:starts]):
        for which, variant in enumerate(variants):
            outcome, coverage, timed = run(
                world, "gvg", steps, start, 0, make=lambda body, variant=variant: made(variant, body)
            )
            row = [r.observable_ratio or 0.0 for r in coverage.curve.rows]
            reached = next((str(r.step) for r in coverage.curve.rows if (r.observable_ratio or 0.0) >= 90.0), "never")
            figures[which, number] = np.mean(row + [row[-1]] * max(steps // 10 + 1 - len(row), 0)), row[-1]
            print(
                f"{variant:8} {number:>5} {figures[which, number, 0]:7.2f} {row[-1]:7.2f} {reached:>8} "
                f"{outcome.num_steps:>6} {coverage.num_contacts:>9} {np.median(timed.ms or [0.0]):>7.1f}  "
                f"{outcome.stop_reason}",
                flush=True,
            )
    for variant, more in zip(variants[1:], figures[1:] - figures[0], strict=True):
        error = more.std(axis=0, ddof=1) / math.sqrt(starts) if starts > 1 else np.full(2, np.nan)
        auc, final = (f"{m:+.2f} +- {e:.2f}" for m, e in zip(more.mean(axis=0), error, strict=True))
        print(f"{variant} minus {variants[0]} [points]: AUC {auc}, final {final}")


if __name__ == "__main__":
    tyro.cli(main)
