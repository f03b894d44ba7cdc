"""Our policy: the tour of a few views with the most expected new surface for its steps, on the paper's stages.

A full decision takes four stages. The map and the graph are brought up to date. Reachable vertices, thinned to one per
half metre, and the robot's own place get the expected gain of their best view
(:mod:`anm_mj.planning.policies.gvg.information_gain`). A beam search among the most promising of them finds the best
tours (:mod:`anm_mj.planning.policies.gvg.view_tours`); turns count as steps, because a turn of 10 degrees takes as much
of the budget as 6.5 cm of path. The first view of the best tour becomes the target; a factor on tours that begin at the
present target keeps the policy from changing its mind for little.

Between full decisions the policy reuses the plan as long as the target's view is expected to show about as much as
before. When no reachable view has new surface worth its steps, coverage is complete. Unless that is the goal, the robot
goes on where its map is worst: views then also count what they improve of known surface, in the same search. With the
goal "reconstruction" they do so from the start.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.planning.field_of_view import FieldOfView, turns_to_look_around
from anm_mj.planning.paths import path_steps, quantize_headings, segments_clear
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import is_known_place, remembered
from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.candidate_places import CandidatePlaces, candidate_places
from anm_mj.planning.policies.gvg.gain_tracker import GainTracker
from anm_mj.planning.policies.gvg.gvg_config import AS_MANY_AS_NEEDED, GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.policies.gvg.narrow_doors import NarrowDoors
from anm_mj.planning.policies.gvg.place_kinds import KINDS
from anm_mj.planning.policies.gvg.stagnation import StagnationDetector
from anm_mj.planning.policies.gvg.transitions import Places, TransitionTable
from anm_mj.planning.policies.gvg.travel_costs import TravelCosts
from anm_mj.planning.policies.gvg.unexplored import unexplored_patches
from anm_mj.planning.policies.gvg.unmeasured import UnmeasuredRays, hidden_sectors
from anm_mj.planning.policies.gvg.view_tours import Tour, best_tours
from anm_mj.planning.policies.gvg.views import Viewpoint, sector_of
from anm_mj.planning.stages import TRY_AGAIN, PlanningState, Stages
from anm_mj.protocols import EstimatesErrors, Mapper
from anm_mj.types import (
    TURN_STEP_RAD,
    Action,
    Candidate,
    ExploredState,
    Observation,
    Plan,
    Pose2,
    StopReason,
    TargetOutcome,
    TopDownMap,
)
from anm_mj.utils.arrays import Window
from anm_mj.utils.stopwatch import Stopwatch


class Gvg:
    """Tours of views over the generalized Voronoi graph."""

    Config = GvgConfig

    def __init__(self, context: PolicyContext[GvgConfig]):
        """Start before the bootstrap rotation; the policy draws nothing, so the seed has no effect."""
        self.config = context.settings
        self._stages = Stages(context.planning, context.footprint, coarse_far_field=True)
        self._tracker = GainTracker(self.config)
        self._stagnation = StagnationDetector(self.config)
        self._unmeasured = UnmeasuredRays()
        self._doors = NarrowDoors(self.config, self._stages, is_wide=context.footprint.is_wide)
        self._gain: InformationGain | None = None
        self._target: ActiveTarget | None = None
        self._closed: TargetOutcome | None = None
        """The target that the present decision has closed."""
        self._bootstrapped = False
        self._goal = context.goal
        self._improving = False
        self._heard_step = -1
        """Step of the last observation that the map has learnt from."""
        self._is_estimated = False
        """Whether poses come with an uncertainty."""
        self._errors_read_step = 0
        self._prior = np.zeros((0, 3))
        """Poses of prior runs."""
        self._tried: Float[np.ndarray, "n 4"] | None = None
        """What the views of a prior run left unknown, as :attr:`InformationGain.tried`; None where it does not say."""

    def memory(self) -> dict[str, np.ndarray]:
        """What views left unknown and failed targets suppressed, and how little the last steps and targets brought."""
        if self._gain is None:
            return {}
        return {
            "tried": self._gain.tried.astype(np.float32),
            "window": self._stagnation.window,
            "num_poor": np.array(self._tracker.num_poor),
            "yields": self._tracker.gain_yield.evidence_m2,
        }

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Expect nothing of views that a prior run had already, and go on where it lost its patience."""
        self._stages.continue_from(prior)
        self._prior = prior.poses
        self._tried = remembered(prior, "tried", (None, 4))
        window, num_poor = remembered(prior, "window", (None, 2)), remembered(prior, "num_poor", ())
        yields = remembered(prior, "yields", (2, len(KINDS)))
        if window is not None:
            self._stagnation.continue_from(window)
        if num_poor is not None:
            self._tracker.num_poor = max(0, int(num_poor))
        if yields is not None:
            self._tracker.gain_yield.continue_from(yields)

    def observe(self, observation: Observation) -> None:
        """Note where the robot is, and where its camera measured nothing."""
        self._stages.observe(observation)
        self._unmeasured.add(observation)
        self._heard_step = observation.step
        self._is_estimated |= observation.position_deviation_m > 0.0

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the way to the first view of the best tour."""
        self._closed = None
        plan = self._next_plan(mapper, observation)
        return plan if self._closed is None else replace(plan, closed=self._closed)

    def _next_plan(self, mapper: Mapper, observation: Observation) -> Plan:
        if self._goal == "reconstruction" and self._can_improve(mapper):
            self._improving = True
        is_first, self._bootstrapped = not self._bootstrapped, True
        if is_first and self.config.bootstrap_turns and not is_known_place(self._prior, observation):
            num_turns = self.config.bootstrap_turns
            if num_turns == AS_MANY_AS_NEEDED:
                num_turns = turns_to_look_around(observation)
            turns = (Action.TURN_LEFT,) * num_turns
            return Plan("bootstrap: a rotation before the first decision", actions=turns)
        watch = Stopwatch()
        topdown, window = self._stages.update_map(mapper, observation, watch)
        with watch.stage("gain"):
            gain = self._update_gain(mapper, observation, window)
            plan = self._reuse(topdown, observation.pose, gain, watch)
        if plan is not None:
            return plan
        state = self._stages.update_graph(topdown, observation.pose, watch)
        with watch.stage("gain"):
            gain.place_kinds.update(gain.occupancy, state.pose)
            if self._target is not None and self._target.is_reached(state.pose):
                self._close_target(gain, state.pose)
        state, look = self._doors.consider(state, gain)
        if look is not None:
            self._close_target(gain, state.pose)
            return look
        plan = self._decide(state, gain, mapper, observation)
        if plan.stop is not None and (
            self._stages.shrink_collisions(np.isfinite(state.paths.distance_m)) or self._doors.drop_margin(state, gain)
        ):
            return Plan(TRY_AGAIN, actions=(Action.TURN_LEFT,), stage_ms=watch.ms)
        if plan.stop is not None and self._goal == "both" and self._can_improve(mapper):
            self._improving, self._target = True, None
            plan = self._decide(state, gain, mapper, observation)
        if plan.stop is None:
            return plan
        with watch.stage("choice"):
            limits = {"safe_m": state.paths.safe_m, "range_m": gain.range_m, "camera": gain.camera}
            return replace(plan, unexplored=unexplored_patches(gain.occupancy, topdown, state.pose, **limits))

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Mark the obstacle in the map and drop the target."""
        self._stages.on_collision(pose, action)
        self._target = None

    def _update_gain(self, mapper: Mapper, observation: Observation, window: Window | None) -> InformationGain:
        """Bring the expected gains up to date with the map and with what this view left unknown."""
        is_first = self._gain is None
        if self._gain is None:
            self._gain = InformationGain(self.config, FieldOfView.of(observation))
            self._gain.expect_yields(self._tracker.gain_yield.of_kind)
        self._gain.update(mapper.occupancy_grid(), window)
        if is_first and self._tried is not None:
            self._gain.take_tried(self._tried.astype(float))
            self._tried = None
        elif is_first:
            for x, y, yaw in self._prior:
                self._gain.suppress_view(Pose2(x, y, yaw))
        if observation.step == self._heard_step:
            self._gain.suppress_view(observation.pose, hidden_sectors(observation, self._gain.camera.azimuth_rad))
        if self._gain.place_kinds.epoch != self._gain.occupancy.epoch:
            self._gain.place_kinds.update(self._gain.occupancy, observation.pose)
        self._gain.suppress(*self._unmeasured.take(self._gain.occupancy, self.config.gain_range_m))
        if not self._improving:  # That shows nothing new, and a run that goes on from this one begins with the window.
            self._stagnation.update(observation.step, self._gain.seen_m2)
        return self._gain

    def _can_improve(self, mapper: Mapper) -> bool:
        """Whether views could count what they improve, and do not yet."""
        return not self._improving and isinstance(mapper, EstimatesErrors)

    def _reuse(self, topdown: TopDownMap, pose: Pose2, gain: InformationGain, watch: Stopwatch) -> Plan | None:
        """The plan of the last full decision, if nothing was seen since that could change it."""
        target = self._target
        if target is None or target.needs_decision(pose, gain.seen_m2):
            return None
        path = target.remaining_path(pose)
        if len(path) and not segments_clear(topdown, path[:-1], path[1:], self._stages.safe_m, pose).all():
            return None
        view_gain_m2 = gain.expected_view(target.viewpoint).gain_m2
        if not target.is_worth(view_gain_m2):
            return None
        return target.reuse(path, view_gain_m2=view_gain_m2, seen_m2=gain.seen_m2, topdown=topdown, stage_ms=watch.ms)

    def _close_target(self, gain: InformationGain, pose: Pose2) -> None:
        target, self._target = self._target, None
        if target is not None:
            self._closed = self._tracker.close(target, gain, pose, learns=not self._improving)

    def _decide(self, state: PlanningState, gain: InformationGain, mapper: Mapper, observation: Observation) -> Plan:
        """A full decision: the first view of the best tour that a path leads to, or the end."""
        with state.watch.stage("gain"):
            due = self._target is None or observation.step >= self._errors_read_step + self.config.improvement_steps
            if self._improving and due and isinstance(mapper, EstimatesErrors):
                self._errors_read_step = observation.step
                radius_m, xy_m = self.config.improvement_radius_m, state.pose.xy_m
                gain.improve(mapper.surface_errors(xy_m, radius_m), xy_m, radius_m, observation.intrinsics.fx)
            candidates = candidate_places(state, gain, self.config)
        with state.watch.stage("choice"):
            return self._choose(state, candidates, gain)

    def _choose(self, state: PlanningState, candidates: CandidatePlaces, gain: InformationGain) -> Plan:
        if candidates.best_gain_m2 < self.config.min_gain_m2:
            return self._stop(state, candidates)
        table, tours = self._best_tours(state, candidates, gain)
        places = table.places
        for tour in tours[: self.config.max_tours]:
            first = tour.views[0]
            path = state.paths.path_to(int(places.vertex[first.place])) if first.place else np.zeros((0, 2))
            if first.place and not len(path):
                continue
            # Both judge by new surface, of which improvement brings none.
            little = tour.gain_m2 < self.config.stagnation_gain_m2
            residual = not self._improving and self._stagnation.is_stagnating() and little
            exhausted = not self._improving and self._tracker.is_exhausted(first.gain_m2)
            if residual or exhausted or tour.rate < self.config.min_rate_m2:
                return self._stop(state, candidates, stagnating=residual)
            if len(path):
                path = quantize_headings(path, state.topdown, state.paths.safe_m, state.pose)
            return self._go(state, tour, path, table, _first_views(places, tours), gain)
        return self._stop(state, candidates)

    def _best_tours(
        self, state: PlanningState, candidates: CandidatePlaces, gain: InformationGain
    ) -> tuple[TransitionTable, list[Tour]]:
        """The best tours, best first, and the table of the places that their views refer to."""
        costs, shared = TravelCosts(state.paths), self._stages.config
        weighs_certainty = shared.uncertainty_aware and shared.unbound_step_cost > 0.0 and self._is_estimated
        heading = sector_of(state.pose.yaw_rad)
        limits = {"depth": self.config.tour_depth, "width": self.config.tour_width}

        def search(discount_steps: float) -> tuple[TransitionTable, list[Tour], float]:
            """The same for one discount, and the value of the best tour's start times its gain per step [m2]."""
            short = candidates.shortlist(discount_steps)
            places = Places(candidates.xy_m[short], candidates.vertex[short], *gain.ray_gains(candidates.xy_m[short]))
            is_target = [self._target is not None and self._target.is_near(xy) for xy in places.xy_m]
            preference = np.where(is_target, self.config.hysteresis, 1.0)
            unbound = gain.unbound_shares(places.xy_m, shared.bound_share) if weighs_certainty else None
            more = None if unbound is None else shared.unbound_step_cost * unbound
            table = TransitionTable(places, costs, gain.view_side, more)
            tours = best_tours(table, heading, discount_steps=discount_steps, preference=preference, **limits)
            return table, tours, float(preference[tours[0].views[0].place]) * tours[0].rate if tours else 0.0

        near_steps, far_steps = self.config.discount_steps, candidates.discount_steps
        table, tours, rate = search(near_steps)
        if far_steps > self.config.far_discount_ratio * near_steps:
            # Residual gain nearby must not come before a wing of the building, nor the wing before the rest of a room.
            far_table, far_tours, far_rate = search(far_steps)
            if far_rate > self.config.far_rate_ratio * rate:
                return far_table, far_tours
        return table, tours

    def _go(
        self,
        state: PlanningState,
        tour: Tour,
        path: Float[np.ndarray, "k 2"],
        table: TransitionTable,
        first_views: tuple[Candidate, ...],
        gain: InformationGain,
    ) -> Plan:
        """The plan that leads to the first view of a tour, which becomes the target or stays it."""
        first, pose = tour.views[0], state.pose
        viewpoint = Viewpoint(table.places.xy_m[first.place], first.heading)
        kept = self._target is not None and self._target.is_same(viewpoint)
        if not kept:
            self._close_target(gain, pose)
        view = gain.expected_view(viewpoint)
        target = self._target
        if target is None:
            here, there = table.swept(sector_of(pose.yaw_rad), first.place, first.heading)
            promised = gain.promise(pose.xy_m, here), gain.promise(viewpoint.xy_m, there)
            given = {"seen_m2": gain.seen_m2, "config": self.config, "view_side": gain.view_side}
            expected_m2 = first.gain_m2
            if self._goal == "reconstruction":
                # New surface will be held against it. With "both", what is unseen was not worth a step before.
                expected_m2 = float(sum(rays.gain_m2.sum() for rays in promised))
            target = ActiveTarget(viewpoint, expected_gain_m2=expected_m2, promised=promised, view=view, **given)
        # A heading that the robot can have: the sector's own may lie half a turn step beside it.
        yaw = wrap_angle(pose.yaw_rad + (first.heading - sector_of(pose.yaw_rad)) * TURN_STEP_RAD)
        purpose = " to improve the map" if self._improving else ""
        reason = (
            f"target {'kept' if kept else 'chosen'}{purpose}: expected gain {first.gain_m2:.1f} m² in "
            f"{path_steps(path, pose.yaw_rad, yaw):.0f} steps "
            f"(tour: {len(tour.views)} views, {tour.gain_m2:.1f} m² in {tour.steps:.0f} steps)"
        )
        steps = self.config.replan_steps
        plan = state.plan(reason, path_xy_m=path, headings_rad=(yaw,), valid_steps=steps, candidates=first_views)
        target.decide(viewpoint, plan, view_gain_m2=view.gain_m2, seen_m2=gain.seen_m2)
        self._target = target
        return plan

    def _stop(self, state: PlanningState, candidates: CandidatePlaces, *, stagnating: bool = False) -> Plan:
        """The end of the run, with the reason."""
        config, num_places = self.config, len(candidates.vertex)
        best = f"best expected gain of {num_places} reachable places: {candidates.best_gain_m2:.2f} m²"
        stop, reason = StopReason.COMPLETE, best
        if num_places == 1 and candidates.num_unreachable:
            stop = StopReason.NO_REACHABLE_TARGET
            reason = f"no path leads to any of {candidates.num_unreachable} vertices"
        elif self._stages.is_cut_off(np.isfinite(state.paths.distance_m)):
            stop = StopReason.NO_REACHABLE_TARGET
            reason = f"no path leads to {candidates.num_unreachable} vertices since a collision"
        elif self._improving:
            reason = f"with improvement, {best}"
        elif self._tracker.is_exhausted(candidates.best_gain_m2):
            num_poor = self._tracker.num_poor
            reason = f"the last {num_poor} targets brought less than {config.poor_target_m2:g} m² each; {best}"
        elif stagnating:
            reason = (
                f"stagnation: next to no new surface in the last {config.stagnation_share:.0%} of the steps, and the "
                f"best tour among {num_places} reachable places has less than {config.stagnation_gain_m2:g} m²"
            )
        return state.plan(reason, stop=stop)


def _first_views(places: Places, tours: list[Tour]) -> tuple[Candidate, ...]:
    """The first view of every tour, for each place that of the best tour."""
    found: dict[int, Candidate] = {}
    for tour in tours:
        first = tour.views[0]
        found.setdefault(first.place, Candidate(places.xy_m[first.place], tour.value, first.gain_m2, first.at_step))
    return tuple(found.values())
