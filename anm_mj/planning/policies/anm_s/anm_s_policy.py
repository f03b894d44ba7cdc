"""The paper's policy: anchored vertices in the local horizon first, then near to far (sections III-B, III-C, IV-A).

After a full rotation at the start, every decision weighs two kinds of vertices: those at which the robot has a decision
to make (:mod:`~anm_mj.planning.policies.anm_s.decision_vertices`), as long as they are unvisited, and those with a
region of interest anchored to them; docs/planning.md tells in which order. This is the target "hierarchical"; the
paper's ablations are "random" (any unvisited vertex) and "best-anchored" (the vertex with the most uncertain region).
The robot keeps a target until it reaches it, collides on the way, or sees on the way that the target is no candidate
any more. With no candidate left it makes one more full rotation, as the authors' released code does; then the run ends.

The tiers, the visited radius and the view ahead are those of the released code, because the paper leaves them open.
Where paper and code differ, the policy follows the paper: a bootstrap of 36 turns without tilting, both decoders
perturbed, regions anchored by visibility, surfaces from zero-crossings.

Deviations from the paper:

- Unknown space is a state of its own, so that vertices lie in observed free space only; bounds never come from ground
  truth.
- Regions vanish once the robot saw their surface from near or turned to it, so that the run ends.
- Spurs of the graph into corners are no decision vertices.
- Rooms stand between the local horizon and the whole graph.
- Vertices come last when the robot saw all that surrounds them from near enough; ``visited_by`` "place" leaves that
  out, as in the released code.
- After these come vertices beside the unknown that the robot was only near to, and then vertices beside passages that
  seemed too narrow from afar.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from anm_mj.control.path_follower import TURN_ABOVE_RAD
from anm_mj.frames import wrap_angle
from anm_mj.geometry.connected_components import connected_components
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.planning.borders import BORDER_WIDTH_M, borders_unknown
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.paths import narrow_gaps
from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig
from anm_mj.planning.policies.anm_s.candidate_vertices import CandidateFinder, Candidates, best_first, room_name
from anm_mj.planning.policies.anm_s.headings import off_axis, view_headings
from anm_mj.planning.policies.anm_s.region_stages import RegionStages, RegionState
from anm_mj.planning.policies.anm_s.targets import Targets
from anm_mj.planning.policies.anm_s.visited import num_within
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import is_known_place, remembered
from anm_mj.planning.stages import TRY_AGAIN
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FORWARD_STEP_M,
    NEAR_TARGET_M,
    TURN_STEP_RAD,
    Action,
    Candidate,
    ExploredState,
    Observation,
    Plan,
    Pose2,
    Region,
    StopReason,
)

USUAL_VIEW_RAD = math.pi / 2.0
"""Field of view that ``well_in_view_deg`` is meant for; in narrower views it is less in proportion [rad]."""


class AnmS:
    """Active Neural Mapping at Scale (Kuang et al., IROS 2024) on our stages."""

    Config = AnmSConfig
    _azimuth_rad = 0.0
    """Where the camera looks beside the heading, as seen last [rad]."""

    def __init__(self, context: PolicyContext[AnmSConfig]):
        """Start before the bootstrap rotation; the seed decides about random targets alone."""
        self.config = context.settings
        self._rng = np.random.default_rng(context.seed)
        # The paper's ablations have no order of rooms.
        with_rooms = self.config.target == "hierarchical"
        self.stages = RegionStages(context.planning, context.footprint, with_rooms=with_rooms)
        self.targets = Targets(self.config)
        self._finder = CandidateFinder(context, self.targets)
        self._well_in_view_rad = math.radians(self.config.well_in_view_deg)
        self._bootstrapped = False
        self._rotated = False
        self._prior = np.zeros((0, 3))
        """Poses of prior runs."""

    def memory(self) -> dict[str, np.ndarray]:
        """Regions that were seen as well as can be, and targets that led into obstacles or were dropped."""
        return {"observed": self.stages.region_finder.observed, **self.targets.memory()}

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Take over where a prior run was, and what it gave up."""
        self.stages.continue_from(prior)
        self._prior = prior.poses
        observed = remembered(prior, "observed", (None, 3))
        if observed is not None:
            self.stages.region_finder.continue_from(observed.astype(np.int64))
        self.targets.continue_from(*(remembered(prior, name, (None, 2)) for name in ("failed_xy_m", "dropped_xy_m")))

    def observe(self, observation: Observation) -> None:
        """Take note of what lies ahead, and of which regions come into view at the target."""
        self.stages.observe(observation)
        pose = observation.pose
        camera = FieldOfView.of(observation)
        self._azimuth_rad = camera.azimuth_rad
        narrower = min(camera.width_rad / USUAL_VIEW_RAD, 1.0)
        self._well_in_view_rad = narrower * math.radians(self.config.well_in_view_deg)
        self._finder.observe(observation)
        if self.targets.is_near(pose):
            # There is no better place to see them from, so that is all there is to see of them.
            axis_rad = pose.yaw_rad + self._azimuth_rad
            for region in self.targets.regions:
                if abs(off_axis(region, pose.xy_m, axis_rad)) < self._well_in_view_rad + TURN_STEP_RAD:
                    self.stages.region_finder.mark_observed(region)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the best vertex by tier and distance."""
        is_first, self._bootstrapped = not self._bootstrapped, True
        if is_first and self.config.bootstrap_turns and not is_known_place(self._prior, observation):
            turns = (Action.TURN_LEFT,) * self.config.bootstrap_turns
            return Plan("bootstrap: a full rotation before the first decision", actions=turns)
        now = self.stages.read(mapper, observation)
        candidates = self._finder.find(
            now, self._guiding(now), mapper.occupancy_grid(), self.stages.topdown.trajectory_xy_m
        )
        for best in best_first(now, candidates, self.targets, self.config.target, self._rng, self._guiding(now)):
            plan = self._go(now, candidates, int(best))
            if plan is not None:
                self._rotated = False
                return plan
        plan = self._to_the_unknown(now)
        if plan is None:
            vertices, beyond_m = narrow_gaps(now.paths)
            plan = self._to_a_look(now, vertices, lambda k: beyond_m[k], "a narrow passage")
        return plan or self._without_candidates(now)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Stamp the obstacle and put the present target last."""
        self.stages.on_collision(pose, action)
        self.targets.fail()

    def _guiding(self, now: RegionState) -> tuple[Region, ...]:
        """The regions that guide the robot: none without visibility guidance."""
        return now.regions if self.config.visibility_guidance else ()

    def _go(self, now: RegionState, candidates: Candidates, chosen: int) -> Plan | None:
        """The plan that leads to a candidate and looks at its regions; None when it would ask for nothing."""
        vertex = int(candidates.vertex[chosen])
        xy = now.graph.vertex_xy_m[vertex]
        regions = tuple(region for region in self._guiding(now) if region.vertex == vertex)
        path = now.paths.path_to(vertex)
        here = np.linalg.norm(xy - now.pose.xy_m) < ARRIVED_M
        leg = path[-1] - path[-2] if len(path) > 1 else np.zeros(2)
        arrival_yaw = now.pose.yaw_rad if here else math.atan2(leg[1], leg[0])
        headings = view_headings(regions, xy, arrival_yaw, self._well_in_view_rad, self._azimuth_rad)
        # A heading within half a turn step is taken already.
        turns = any(abs(wrap_angle(heading - now.pose.yaw_rad)) > TURN_ABOVE_RAD for heading in headings)
        if not len(path) or (here and not turns):
            for region in regions if here else ():
                self.stages.region_finder.mark_observed(region)
            return None
        self.targets.drop_for(xy, now.pose)
        self.targets.choose(xy, regions, unvisited=bool(candidates.unvisited[chosen]))
        distance_m = now.paths.distance_m[candidates.vertex]
        steps = distance_m / FORWARD_STEP_M
        return now.plan(
            f"{self._why(now, candidates, chosen)}, {len(regions)} regions anchored, {distance_m[chosen]:.1f} m away",
            path_xy_m=path,
            headings_rad=headings,
            valid_steps=self.config.replan_steps,
            candidates=tuple(
                Candidate(now.graph.vertex_xy_m[n], float(s), float(s), float(c))
                for n, s, c in zip(candidates.vertex, candidates.tier, steps, strict=True)
            ),
        )

    def _why(self, now: RegionState, candidates: Candidates, chosen: int) -> str:
        tier = int(candidates.tier[chosen])
        near = candidates.near[chosen]
        where = "the local horizon" if near else room_name(now, int(candidates.vertex[chosen]))
        why = {
            "hierarchical": f"in {where}, first of {int((candidates.tier == tier).sum())} vertices",
            "best-anchored": "the most uncertain region",
            "random": "drawn at random",
        }[self.config.target]
        return f"tier {tier}: {why}"

    def _to_the_unknown(self, now: RegionState) -> Plan | None:
        """To the nearest vertex beside the unknown that the robot was near to but not at, and a look into it.

        The paper's graph goes on through unknown space: it has unvisited vertices behind a door that the robot passed.
        """
        graph = now.graph
        beside = np.flatnonzero(borders_unknown(graph, now.frontier_xy_m) & np.isfinite(now.paths.distance_m))

        def middle_of_unknown(vertex: int) -> Float[np.ndarray, "2"]:
            away = np.linalg.norm(now.frontier_xy_m - graph.vertex_xy_m[vertex], axis=1)
            return now.frontier_xy_m[away <= graph.clearance_m[vertex] + BORDER_WIDTH_M].mean(axis=0)

        return self._to_a_look(now, beside, lambda k: middle_of_unknown(int(beside[k])), "the unknown beside one")

    def _to_a_look(
        self,
        now: RegionState,
        vertices: Int[np.ndarray, " n"],
        look_at: Callable[[int], Float[np.ndarray, "2"]],
        what: str,
    ) -> Plan | None:
        """To the nearest of some vertices that the robot was not at yet, and a look from there.

        ``look_at`` gives the place to look at from the vertex of a number [m]; the robot looks into ``what``.
        """
        xy = now.graph.vertex_xy_m[vertices]
        been = num_within(xy, self.stages.topdown.trajectory_xy_m, NEAR_TARGET_M) > 0
        left = np.flatnonzero(~been & ~self.targets.is_given_up(xy))
        if not len(left):
            return None
        distance_m = now.paths.distance_m[vertices]
        chosen = int(left[np.argmin(distance_m[left])])
        path = now.paths.path_to(int(vertices[chosen]))
        if not len(path):
            return None
        self.targets.choose(xy[chosen], (), unvisited=False)
        towards = look_at(chosen) - xy[chosen]
        reason = f"every vertex is visited: a look into {what}, {distance_m[chosen]:.1f} m away"
        yaw = wrap_angle(math.atan2(towards[1], towards[0]) - self._azimuth_rad)
        return now.plan(reason, path_xy_m=path, headings_rad=(yaw,))

    def _without_candidates(self, now: RegionState) -> Plan:
        """One full rotation, as in the authors' released code; if that brings nothing, stop."""
        self.targets.clear()
        reached = np.isfinite(now.paths.distance_m)
        reachable = reached.any()
        what = "every vertex is visited and no region is left" if reachable else "no vertex of the graph can be reached"
        if not self._rotated:
            self._rotated = True
            return Plan(f"{what}: another full rotation", actions=(Action.TURN_LEFT,) * NUM_HEADINGS)
        if self.stages.shrink_collisions(reached) or (len(narrow_gaps(now.paths)[0]) and self.stages.drop_margin()):
            return Plan(f"{what}: {TRY_AGAIN}", actions=(Action.TURN_LEFT,))
        num_parts = len(np.unique(connected_components(now.graph.edges, len(reached))[~reached]))
        complete = reachable and not self.stages.is_cut_off(reached)
        return now.plan(
            f"{what}, even after a full rotation; parts of the graph out of reach: {num_parts}",
            stop=StopReason.COMPLETE if complete else StopReason.NO_REACHABLE_TARGET,
        )
