"""Our policy: the most expected new surface per step, on the paper's stages.

Every decision casts a panorama of expected gain (:mod:`anm_mj.planning.gain`) from vertices of the graph, thinned to
one in half a metre, and from where the robot stands. A candidate's value is the gain of its best view, with the surface
of regions anchored there added, divided by the steps it costs, turns included, because a 10-degree turn spends as much
of the budget as 6.5 cm of way. The robot looks again every few steps and on events, and changes its mind only for
something clearly better. When no reachable place has gain worth a step the run is complete.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.frames import wrap_angle
from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.gain import GainCaster, best_view
from anm_mj.planning.paths import path_steps
from anm_mj.planning.stages import Situation, Stages
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FORWARD_STEP_M,
    TURN_STEP_RAD,
    Action,
    Candidate,
    Footprint,
    Observation,
    Plan,
    Pose2,
    Region,
    StopReason,
)

HERE = -1
"""Stands for the robot's own place among the candidate vertices."""
EXACT_PATHS = 6
"""Best candidates by estimate whose paths are worked out before the choice."""
LEAST_STEPS = 0.6
"""A view that costs less is the present one, which has nothing new to show."""
REGION_SHARE = 0.25
"""Uncertain surface that was seen already counts this share of surface never seen."""
MEMBER_AREA_M2 = 0.01
"""Surface that one member of a region stands for [m2]: the square of the 10 cm lattice it comes from."""
FORGET_RANGE_M = 6.0
"""Remembered gain of places nearer to the robot than this is cast anew [m]: what it sees changes it."""


@dataclass(frozen=True)
class _Option:
    vertex: int
    xy_m: Float[np.ndarray, 2]
    gain_m2: float
    yaw_rad: float
    num_regions: int
    cost_steps: float = math.inf
    score: float = 0.0


class Gvg:
    """Gain per step over the generalized Voronoi graph."""

    def __init__(self, config: PlanningConfig, footprint: Footprint, seed: int):
        """Start before the bootstrap rotation; the policy draws nothing, so the seed has no effect."""
        del seed
        self.config = config
        self._stages = Stages(config, footprint)
        self._caster: GainCaster | None = None
        self._bootstrapped = False
        self._target_xy_m: Float[np.ndarray, 2] | None = None
        self._remembered: dict[tuple[int, int], Float[np.ndarray, " azimuths"]] = {}

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the candidate with the best gain per step."""
        if not self._bootstrapped and self.config.bootstrap_turns:
            self._bootstrapped = True
            turns = (Action.TURN_LEFT,) * self.config.bootstrap_turns
            return Plan("bootstrap: one full turn before the first decision", np.zeros((0, 2)), actions=turns)
        now = self._stages.read(mapper, observation)
        with now.watch.stage("gain"):
            options, unreachable = self._options(now, mapper, self.config.max_candidates)
            if not any(option.score for option in options):
                # Before nothing is said to be left, no place may be judged by what it was worth long ago.
                options, unreachable = self._options(now, mapper, None)
        with now.watch.stage("choice"):
            plan = self._choose(now, options, unreachable)
        self._stages.set_out(plan.path_xy_m)
        return plan

    def blocked(self, pose: Pose2, action: Action) -> None:
        """Stamp the obstacle and give the present target up."""
        self._stages.blocked(pose, action)
        self._target_xy_m = None

    def _options(self, now: Situation, mapper: Mapper, max_cast: int | None) -> tuple[list[_Option], int]:
        reachable = np.isfinite(now.reach.distance_m)
        # What is reached already is weighed as the robot's own place.
        away = np.linalg.norm(now.graph.vertex_xy_m - now.pose.xy_m, axis=1) > ARRIVED_M
        vertices = self._thin(now, reachable & away)
        places = np.concatenate([now.pose.xy_m[None], now.graph.vertex_xy_m[vertices]])
        panoramas = self._panoramas(now, mapper, places, max_cast)
        regions = self._assign_regions(now, places)
        options = []
        for i, vertex in enumerate([HERE, *vertices.tolist()]):
            for region in regions[i]:
                self._add_region(panoramas[i], region, places[i])
            gain, yaw = best_view(panoramas[i])
            if vertex == HERE:
                cost = abs(wrap_angle(yaw - now.pose.yaw_rad)) / TURN_STEP_RAD
            else:
                cost = self._estimate(now, vertex, yaw)
            options.append(self._option(_Option(vertex, places[i], gain, yaw, len(regions[i])), cost))
        return options, int((~reachable).sum())

    def _option(self, place: _Option, cost: float) -> _Option:
        """The same place with another cost and the score that goes with it."""
        worth_it = place.gain_m2 >= self.config.min_gain_m2 and cost >= LEAST_STEPS
        score = place.gain_m2 / (cost + self.config.cost_offset_steps) if worth_it else 0.0
        if self._is_target(place.xy_m):
            score *= self.config.hysteresis
        return replace(place, cost_steps=cost, score=score)

    def _is_target(self, xy_m: Float[np.ndarray, 2]) -> bool:
        """Whether a place is the present target: vertices move a little with every new frame."""
        if self._target_xy_m is None:
            return False
        return float(np.linalg.norm(xy_m - self._target_xy_m)) < self.config.candidate_spacing_m

    def _thin(self, now: Situation, reachable: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
        """One vertex per square of the spacing, the one with most clearance; squares are anchored in the world."""
        vertices = np.flatnonzero(reachable)
        square = np.floor(now.graph.vertex_xy_m[vertices] / self.config.candidate_spacing_m).astype(np.int64)
        order = np.lexsort((-now.graph.clearance_m[vertices], square[:, 1], square[:, 0]))
        _, first = np.unique(square[order], axis=0, return_index=True)
        kept = vertices[order[first]]
        return kept[np.argsort(now.reach.distance_m[kept], kind="stable")]

    def _panoramas(
        self, now: Situation, mapper: Mapper, places_xy_m: Float[np.ndarray, "n 2"], max_cast: int | None
    ) -> Float[np.ndarray, "n azimuths"]:
        grid = mapper.occupancy
        if self._caster is None:
            self._caster = GainCaster(self.config, grid.resolution_m, now.camera_height_m)
        self._caster.note_view(grid, now.pose)
        keys = [(int(x), int(y)) for x, y in np.floor(places_xy_m / self.config.candidate_spacing_m)]
        stale = np.linalg.norm(places_xy_m - now.pose.xy_m, axis=1) < FORGET_RANGE_M
        new = np.array([key not in self._remembered for key in keys])
        new[0] = True  # The robot's own place; it is no vertex, so that nothing else answers for it.
        # Places never looked from come first: without any gain they could not be chosen at all.
        cast = np.concatenate([np.flatnonzero(new), np.flatnonzero(stale & ~new)])[:max_cast]
        panoramas = np.zeros((len(places_xy_m), self.config.num_azimuths))
        for i, key in enumerate(keys):
            panoramas[i] = self._remembered.get(key, 0.0)
        panoramas[cast] = self._caster.panoramas(grid, places_xy_m[cast])
        self._remembered.update({keys[i]: panoramas[i].copy() for i in cast})
        return panoramas

    def _assign_regions(self, now: Situation, places_xy_m: Float[np.ndarray, "n 2"]) -> list[list[Region]]:
        """Each region to the place nearest to its anchor; those in view from here have been looked at and drop out."""
        regions: list[list[Region]] = [[] for _ in places_xy_m]
        for region in now.regions:
            anchor = now.graph.vertex_xy_m[region.vertex]
            nearest = int(np.argmin(np.linalg.norm(places_xy_m - anchor, axis=1)))
            if nearest == 0 and abs(wrap_angle(_bearing(now.pose.xy_m, region) - now.pose.yaw_rad)) <= math.pi / 4:
                self._stages.finder.mark_looked_at(region)
            else:
                regions[nearest].append(region)
        return regions

    def _add_region(self, panorama: Float[np.ndarray, " azimuths"], region: Region, xy_m: Float[np.ndarray, 2]) -> None:
        sector = math.tau / len(panorama)
        azimuth = round(_bearing(xy_m, region) / sector) % len(panorama)
        panorama[azimuth] += REGION_SHARE * MEMBER_AREA_M2 * region.num_members

    def _estimate(self, now: Situation, vertex: int, yaw: float) -> float:
        towards = now.graph.vertex_xy_m[vertex] - now.pose.xy_m
        bearing = math.atan2(towards[1], towards[0])
        turns = abs(wrap_angle(bearing - now.pose.yaw_rad)) + abs(wrap_angle(yaw - bearing))
        return float(now.reach.distance_m[vertex]) / FORWARD_STEP_M + turns / TURN_STEP_RAD

    def _choose(self, now: Situation, options: list[_Option], unreachable: int) -> Plan:
        shortlist = sorted(options, key=lambda option: -option.score)[:EXACT_PATHS]
        best: tuple[_Option, Float[np.ndarray, "k 2"]] | None = None
        for estimate in shortlist:
            if estimate.score <= 0.0:
                break
            path = np.zeros((0, 2)) if estimate.vertex == HERE else now.reach.path_to(estimate.vertex)
            if estimate.vertex != HERE and not len(path):
                continue
            cost = path_steps(path, now.pose.yaw_rad, estimate.yaw_rad)
            option = self._option(estimate, cost)
            if option.score > (best[0].score if best else 0.0):
                best = (option, path)
        candidates = tuple(Candidate(o.xy_m, o.score, o.gain_m2, o.cost_steps) for o in shortlist)
        if best is None:
            return self._stop(now, options, unreachable, candidates)
        option, path = best
        kept = self._is_target(option.xy_m)
        self._target_xy_m = option.xy_m
        reason = (
            f"{'keeps' if kept else 'takes'} {option.gain_m2:.1f} m2 expected for {option.cost_steps:.0f} steps, "
            f"best of {len(options)} places, {option.num_regions} regions anchored"
        )
        return Plan(
            reason,
            path,
            (option.yaw_rad,),
            valid_steps=self.config.replan_steps,
            candidates=candidates,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )

    def _stop(
        self, now: Situation, options: list[_Option], unreachable: int, candidates: tuple[Candidate, ...]
    ) -> Plan:
        best = max(option.gain_m2 for option in options)
        if len(options) == 1 and unreachable:
            stop = StopReason.NO_REACHABLE_TARGET
            reason = f"no way leads to any of {unreachable} vertices"
        else:
            stop = StopReason.COMPLETE
            reason = f"the best of {len(options)} reachable places would add {best:.2f} m2"
        return Plan(
            reason,
            np.zeros((0, 2)),
            stop=stop,
            candidates=candidates,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )


def _bearing(xy_m: Float[np.ndarray, 2], region: Region) -> float:
    """World direction from a place to a region [rad]."""
    towards = region.centre_m[:2] - xy_m
    return math.atan2(towards[1], towards[0])
