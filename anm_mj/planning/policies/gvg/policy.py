"""Our policy: a short tour of views with the most expected new surface for its steps, on the paper's stages.

Every decision knows a panorama of expected gain (:mod:`anm_mj.planning.policies.gvg.information_gain`) for vertices of
the graph, thinned to one in half a metre, and for where the robot stands. The most promising of them are searched for
the best sequence of views (:mod:`anm_mj.planning.policies.gvg.tour`); turns count as steps, because a 10-degree turn
spends as much of the budget as 6.5 cm of way. The robot decides again every few steps and on events, and changes its
mind only for something clearly better. When no reachable place has gain worth a step the run is complete.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.frames import wrap_angle
from anm_mj.planning.paths import path_steps, quantize_headings, remaining_path, segments_clear
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.gain_cache import GainCache
from anm_mj.planning.policies.gvg.gain_tracker import GainTracker
from anm_mj.planning.policies.gvg.information_gain import GainCaster, view_sums
from anm_mj.planning.policies.gvg.stagnation import Progress
from anm_mj.planning.policies.gvg.tour import SIDE, Places, Tour, TourSearch
from anm_mj.planning.policies.gvg.travel_costs import NUM_AZIMUTHS, TravelCosts
from anm_mj.planning.policies.gvg.unexplored import unexplored_patches
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FORWARD_STEP_M,
    TURN_STEP_RAD,
    Action,
    Candidate,
    Observation,
    Plan,
    Pose2,
    StopReason,
    TopDownMap,
)
from anm_mj.utils.stopwatch import Stopwatch

HERE = -1
"""Stands for the robot's own place among the candidate vertices."""
IN_VIEW = np.arange(-SIDE, SIDE + 1)
"""Azimuth sectors that a view takes in, counted from the one it looks along."""
FARTHER = 1.2
"""Where what is left lies this much farther away than gain is discounted over, tours to there are weighed too."""
FAR_RATE = 1.5
"""They are taken when they bring so many times as much per step."""
MOST_DISCOUNT = 4.0
"""The time that gain is discounted over grows at most to so many times what it is in small scenes."""
SAME_PLACE_M = 0.2
"""A vertex this near is looked from without going there: turning to it costs more than it shows [m]."""
NEWS_SHARE = 0.3
"""Of what is expected at the target may have been seen since it was chosen, without a new choice."""
STILL_SHARE = 0.6
"""While the view that the robot is sent to promises this share of what it did, it still stands."""
MAX_TOURS = 8
"""Best tours whose first path is worked out before one is taken."""


@dataclass(frozen=True)
class _Options:
    """The places that can be weighed; the first is where the robot stands."""

    vertex: Int[np.ndarray, " n"]
    xy_m: Float[np.ndarray, "n 2"]
    gain_m2: Float[np.ndarray, " n"]
    """Of the best view from each."""
    steps: Float[np.ndarray, " n"]
    """To get there."""
    unreachable: int


class Gvg:
    """Tours of views over the generalized Voronoi graph."""

    Config = GvgConfig

    def __init__(self, context: PolicyContext[GvgConfig]):
        """Start before the bootstrap rotation; the policy draws nothing, so the seed has no effect."""
        self.config = config = context.settings
        self._stages = Stages(context.planning, context.footprint, coarse_far_field=True)
        self._caster: GainCaster | None = None
        self._bootstrapped = False
        self._ledger = GainTracker(config)
        self._progress = Progress(config)
        self._plan: Plan | None = None
        self._kept_on = 0
        self._decided_at_m2 = 0.0
        self._expected_m2 = 0.0
        self._aim = np.zeros(2), IN_VIEW
        self._remembered = GainCache(config.candidate_spacing_m, config.num_azimuths)

    def observe(self, observation: Observation) -> None:
        """Learn nothing: the map takes every observation in, and that is what the policy decides on."""

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the first stop of the best tour."""
        if not self._bootstrapped and self.config.bootstrap_turns:
            self._bootstrapped = True
            turns = (Action.TURN_LEFT,) * self.config.bootstrap_turns
            return Plan("bootstrap: a look around before the first decision", np.zeros((0, 2)), actions=turns)
        watch = Stopwatch()
        topdown = self._stages.update_map(mapper, observation, watch)
        with watch.stage("gain"):
            if self._caster is None:
                self._caster = GainCaster(self.config, float(observation.T_world_camera[2, 3]))
            changed = self._caster.view.update(mapper.occupancy, *self._stages.topdown.changed_xy_m)
            if changed is not None:
                self._caster.note_change(*changed)
            self._caster.note_view(observation.pose)
            self._progress.note(observation.step, self._caster.view.seen_m2)
            kept = self._keep_on(topdown, observation.pose, self._caster, watch)
        if kept is not None:
            self._stages.follow_path(kept.path_xy_m)
            return kept
        now = self._stages.update_graph(mapper, observation, topdown, watch, with_regions=False)
        with now.watch.stage("gain"):
            if self._ledger.is_done(now.pose):
                self._settle(now, self._caster)
            options = self._options(now, self._caster, fresh=False)
            if options.gain_m2.max() < self.config.min_gain_m2:
                # Before nothing is said to be left, no place may be judged by what it was worth long ago.
                options = self._options(now, self._caster, fresh=True)
        with now.watch.stage("choice"):
            plan = self._choose(now, options, self._caster)
        self._stages.follow_path(plan.path_xy_m)
        self._plan = plan
        return plan

    def _keep_on(self, topdown: TopDownMap, pose: Pose2, caster: GainCaster, watch: Stopwatch) -> Plan | None:
        """The present plan again, where nothing has come to light that could change it."""
        plan, ledger = self._plan, self._ledger
        if plan is None or ledger.target_xy_m is None or ledger.is_done(pose):
            return None
        news_m2 = caster.view.seen_m2 - self._decided_at_m2
        enough_m2 = max(self.config.replan_gain_m2, NEWS_SHARE * self._expected_m2)
        if news_m2 > enough_m2 or self._kept_on >= self.config.max_plan_reuse:
            return None
        if _is_followed(plan, pose):
            return None
        path = plan.path_xy_m
        if len(path):
            path = remaining_path(path, pose)
            if not segments_clear(topdown, path[:-1], path[1:], self._stages.safe_m, pose).all():
                return None
        _, _, still_m2 = caster.expectation(*self._aim)
        if still_m2 < max(STILL_SHARE * self._expected_m2, self.config.min_gain_m2):
            return None
        self._kept_on += 1
        return replace(
            plan,
            reason=f"goes on: {still_m2:.1f} m2 expected, {news_m2:.1f} m2 seen since it was decided",
            path_xy_m=path,
            topdown=topdown,
            stage_ms=watch.ms,
        )

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Stamp the obstacle and give the present target up."""
        self._stages.on_collision(pose, action)
        self._ledger.target_xy_m = None
        self._plan = None

    def _settle(self, now: PlanningState, caster: GainCaster) -> None:
        """Hold what the present target brought against what it promised."""
        xy = self._ledger.target_xy_m
        if xy is None:
            return
        cells, rho_m, still_m2 = caster.expectation(xy, (self._ledger.heading + IN_VIEW) % NUM_AZIMUTHS)
        if self._ledger.settle(caster.view.seen_m2, still_m2, now.pose):
            caster.give_up(cells, rho_m)

    def _options(self, now: PlanningState, caster: GainCaster, *, fresh: bool) -> _Options:
        reachable = np.isfinite(now.paths.distance_m)
        # What is reached already is weighed as the robot's own place.
        away = np.linalg.norm(now.graph.vertex_xy_m - now.pose.xy_m, axis=1) > SAME_PLACE_M
        vertices = self._thin(now, reachable & away)
        places = np.concatenate([now.pose.xy_m[None], now.graph.vertex_xy_m[vertices]])
        panoramas = self._panoramas(caster, places, fresh)
        gain = view_sums(panoramas).max(axis=1)
        steps = np.concatenate([[0.0], now.paths.distance_m[vertices] / FORWARD_STEP_M])
        return _Options(np.concatenate([[HERE], vertices]), places, gain, steps, int((~reachable).sum()))

    def _thin(self, now: PlanningState, reachable: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
        """One vertex per square of the spacing, the one with most clearance; squares are anchored in the world."""
        vertices = np.flatnonzero(reachable)
        square = np.floor(now.graph.vertex_xy_m[vertices] / self.config.candidate_spacing_m).astype(np.int64)
        order = np.lexsort((-now.graph.clearance_m[vertices], square[:, 1], square[:, 0]))
        square = square[order]
        first = np.ones(len(order), bool)
        first[1:] = (square[1:] != square[:-1]).any(axis=1)
        kept = vertices[order[first]]
        return kept[np.argsort(now.paths.distance_m[kept], kind="stable")]

    def _panoramas(
        self, caster: GainCaster, places_xy_m: Float[np.ndarray, "n 2"], fresh: bool
    ) -> Float[np.ndarray, "n azimuths"]:
        if caster.changed_xy_m is not None:
            low, high = caster.changed_xy_m
            self._remembered.forget(low - self.config.gain_range_m, high + self.config.gain_range_m)
            caster.changed_xy_m = None
        panoramas, known = self._remembered.recall(places_xy_m)
        stale = ~known | fresh
        panoramas[stale] = caster.panoramas(places_xy_m[stale])
        self._remembered.remember(places_xy_m[stale], panoramas[stale])
        return panoramas

    def _discount_steps(self, options: _Options) -> float:
        """After how many steps gain counts 1/e: more where what is left lies far away, or crumbs would come first."""
        gain = np.where(options.gain_m2 < self.config.min_gain_m2, 0.0, options.gain_m2)
        mean_steps = float((gain * options.steps).sum() / max(gain.sum(), 1e-9))
        least = self.config.discount_steps
        return float(np.clip(mean_steps, least, MOST_DISCOUNT * least))

    def _shortlist(self, options: _Options, discount_steps: float) -> Int[np.ndarray, " k"]:
        """The robot's own place, and the most promising others, no two in the same square metre."""
        worth = options.gain_m2 * np.exp(-options.steps / discount_steps)
        worth[options.gain_m2 < self.config.min_gain_m2] = 0.0
        square = np.floor(options.xy_m / self.config.shortlist_spacing_m).astype(np.int64)
        chosen = [0]
        taken: set[tuple[int, int]] = set()
        for i in np.argsort(-worth, kind="stable"):
            if len(chosen) > self.config.max_candidates or worth[i] <= 0.0:
                break
            key = (int(square[i, 0]), int(square[i, 1]))
            if i and key not in taken:
                taken.add(key)
                chosen.append(int(i))
        return np.array(chosen)

    def _choose(self, now: PlanningState, options: _Options, caster: GainCaster) -> Plan:
        if options.gain_m2.max() < self.config.min_gain_m2:
            return self._stop(now, options, caster)
        near_steps, far_steps = self.config.discount_steps, self._discount_steps(options)
        ways = TravelCosts(now.paths)
        places, tours = self._search(now, options, caster, ways, near_steps)
        if far_steps > FARTHER * near_steps:
            # Crumbs at hand must not come before a wing of the building, nor the wing before what is left of a room.
            far = self._search(now, options, caster, ways, far_steps)
            if self._rate(*far) > FAR_RATE * self._rate(places, tours):
                places, tours = far
        candidates = self._candidates(places, tours)
        for tour in tours[:MAX_TOURS]:
            first = tour.stops[0]
            path = np.zeros((0, 2)) if first.place == 0 else now.paths.path_to(int(places.vertex[first.place]))
            if first.place and not len(path):
                continue
            crumbs = self._progress.is_lull() and tour.gain_m2 < self.config.stagnation_gain_m2
            if crumbs or tour.rate < self.config.min_rate_m2 or self._ledger.is_exhausted(first.gain_m2):
                return self._stop(now, options, caster, crumbs=crumbs)
            if len(path):
                path = quantize_headings(path, now.topdown, now.paths.safe_m, now.pose)
            return self._go(now, tour, places, path, candidates, caster)
        return self._stop(now, options, caster)

    def _search(
        self, now: PlanningState, options: _Options, caster: GainCaster, ways: TravelCosts, discount_steps: float
    ) -> tuple[Places, list[Tour]]:
        """The best tours when gain is discounted over so many steps, and the places that they lead to."""
        short = self._shortlist(options, discount_steps)
        hit, worth = caster.rays(options.xy_m[short])
        places = Places(options.xy_m[short], options.vertex[short], caster.patches(hit), worth)
        preferred = np.array([self.config.hysteresis if self._ledger.is_target(xy) else 1.0 for xy in places.xy_m])
        search = TourSearch(places, ways, discount_steps=discount_steps, preferred=preferred)
        return places, search.best(self._sector(now.pose), depth=self.config.tour_depth, width=self.config.tour_width)

    def _rate(self, places: Places, tours: list[Tour]) -> float:
        """What the best tour brings per step, with a bonus for one that leads to the present target [m2 per step]."""
        if not tours:
            return 0.0
        bonus = self.config.hysteresis if self._ledger.is_target(places.xy_m[tours[0].stops[0].place]) else 1.0
        return bonus * tours[0].rate

    def _sector(self, pose: Pose2) -> int:
        """The azimuth sector that the robot looks along."""
        return math.floor(pose.yaw_rad / TURN_STEP_RAD + 0.5) % self.config.num_azimuths

    def _candidates(self, places: Places, tours: list[Tour]) -> tuple[Candidate, ...]:
        """The first stops of the tours found, each once, with the worth of its best tour."""
        firsts: dict[int, Candidate] = {}
        for tour in tours:
            stop = tour.stops[0]
            firsts.setdefault(stop.place, Candidate(places.xy_m[stop.place], tour.value, stop.gain_m2, stop.at_step))
        return tuple(firsts.values())

    def _go(
        self,
        now: PlanningState,
        tour: Tour,
        places: Places,
        path: Float[np.ndarray, "k 2"],
        candidates: tuple[Candidate, ...],
        caster: GainCaster,
    ) -> Plan:
        first = tour.stops[0]
        # Headings that the robot can have: those of the sectors may lie half a turn beside them.
        turns = first.heading - self._sector(now.pose)
        xy, yaw = places.xy_m[first.place], wrap_angle(now.pose.yaw_rad + turns * TURN_STEP_RAD)
        kept = self._ledger.is_promised(xy, first.heading)
        if kept:
            self._ledger.follow(xy, first.heading)
        else:
            self._settle(now, caster)
            self._ledger.open(xy, first.heading, first.gain_m2, caster.view.seen_m2)
        self._kept_on, self._decided_at_m2 = 0, caster.view.seen_m2
        self._aim = xy, (first.heading + IN_VIEW) % self.config.num_azimuths
        _, _, self._expected_m2 = caster.expectation(*self._aim)
        cost = path_steps(path, now.pose.yaw_rad, yaw)
        reason = (
            f"{'keeps' if kept else 'takes'} {first.gain_m2:.1f} m2 for {cost:.0f} steps, first of a tour of "
            f"{len(tour.stops)} stops with {tour.gain_m2:.1f} m2 in {tour.stops[-1].at_step:.0f}"
        )
        return Plan(
            reason,
            path,
            (yaw,),
            valid_steps=self.config.replan_steps,
            candidates=candidates,
            topdown=now.topdown,
            graph=now.graph,
            stage_ms=now.watch.ms,
        )

    def _stop(self, now: PlanningState, options: _Options, caster: GainCaster, *, crumbs: bool = False) -> Plan:
        best = float(options.gain_m2.max())
        if self._ledger.is_exhausted(best):
            stop = StopReason.COMPLETE
            reason = (
                f"the last {self._ledger.poor_in_a_row} targets added under {self.config.poor_target_m2:g} m2 each, "
                f"and the best of {len(options.vertex)} reachable places promises {best:.2f}"
            )
        elif len(options.vertex) == 1 and options.unreachable:
            stop = StopReason.NO_REACHABLE_TARGET
            reason = f"no way leads to any of {options.unreachable} vertices"
        elif crumbs:
            stop = StopReason.COMPLETE
            reason = (
                f"next to nothing was seen in the last {self.config.stagnation_share:.0%} of the steps, and the best "
                f"tour among {len(options.vertex)} reachable places promises less than "
                f"{self.config.stagnation_gain_m2:g} m2"
            )
        else:
            stop = StopReason.COMPLETE
            reason = f"the best of {len(options.vertex)} reachable places would add {best:.2f} m2"
        return Plan(
            reason,
            np.zeros((0, 2)),
            stop=stop,
            unexplored=unexplored_patches(
                caster.view,
                now.topdown,
                now.pose,
                safe_m=now.paths.safe_m,
                range_m=self.config.gain_range_m,
                camera_height_m=now.camera_height_m,
            ),
            topdown=now.topdown,
            graph=now.graph,
            stage_ms=now.watch.ms,
        )


def _is_followed(plan: Plan, pose: Pose2) -> bool:
    """Whether a plan asks for nothing more: its heading may lie half a turn beside the sector that the ledger has."""
    there = not len(plan.path_xy_m) or math.dist(plan.path_xy_m[-1], pose.xy_m) < ARRIVED_M
    # Headings lie whole turns away, but for what wheels are off.
    return there and all(abs(wrap_angle(yaw - pose.yaw_rad)) < 0.75 * TURN_STEP_RAD for yaw in plan.headings_rad)
