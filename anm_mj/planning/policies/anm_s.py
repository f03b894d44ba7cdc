"""The paper's policy: anchored vertices in the local horizon first, then near to far (sections III-C, III-D, IV-A).

After a full turn at the start, every decision weighs the vertices where three or more edges meet. A vertex is better
when it has not been visited, when it lies visible in the local horizon, and when a region of interest is anchored to
it; among equals the nearest along the graph is taken (target "hierarchical"; the paper's ablation knows "random", any
unvisited vertex, and "best-anchored", the one with the most uncertain region). On arrival the robot turns to the
regions anchored there. The tiers and the visited radius are those of the authors' released code, because the paper
leaves them open. Where paper and code differ, the paper is followed: a bootstrap of 36 turns without tilting, both
decoders perturbed, regions anchored by visibility, surfaces from zero-crossings. Deviations from the paper: unknown
space is a state of its own, so that vertices lie in observed free space only, and bounds are never taken from ground
truth.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.paths import segments_clear
from anm_mj.planning.stages import Situation, Stages
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FORWARD_STEP_M,
    Action,
    Candidate,
    Footprint,
    Observation,
    Plan,
    Pose2,
    Region,
    StopReason,
)

UNVISITED, IN_HORIZON, ANCHORED, FAILED = 3, 2, 1, -6
"""Weights of a vertex's properties in the authors' released code."""
FAIL_RADIUS_M = 0.3
"""Vertices this near to a target that led into an obstacle are put last [m]."""


class AnmS:
    """Active Neural Mapping at Scale (Kuang et al., IROS 2024) on our stages."""

    def __init__(self, config: PlanningConfig, footprint: Footprint, seed: int):
        """Start before the bootstrap rotation; the seed decides about random targets alone."""
        self.config = config
        self._rng = np.random.default_rng(seed)
        self._stages = Stages(config, footprint)
        self._bootstrapped = False
        self._target_xy_m: Float[np.ndarray, 2] | None = None
        self._failed_xy_m: list[Float[np.ndarray, 2]] = []
        self._headed_for: tuple[Region, ...] = ()

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the best vertex by tier and distance."""
        if not self._bootstrapped and self.config.bootstrap_turns:
            self._bootstrapped = True
            return self._look_around("bootstrap: one full turn before the first decision")
        self._mark_looked_at(observation.pose)
        now = self._stages.read(mapper, observation)
        nodes = np.flatnonzero(now.graph.degree >= 3)
        away = np.linalg.norm(now.graph.vertex_xy_m[nodes] - now.pose.xy_m, axis=1) > ARRIVED_M
        reachable = nodes[np.isfinite(now.reach.distance_m[nodes]) & away]
        if not len(reachable):
            if self._target_xy_m is None:
                return self._stop(now, "no vertex of the graph can be reached, even after a look around")
            self._target_xy_m = None
            return self._look_around("no vertex of the graph can be reached: another full turn")
        score = self._scores(now, reachable)
        for best in self._order(now, reachable, score):
            path = now.reach.path_to(int(reachable[best]))
            if len(path):
                return self._go(now, int(reachable[best]), path, reachable, score)
        return self._stop(now, "no safe path leads to any vertex")

    def blocked(self, pose: Pose2, action: Action) -> None:
        """Stamp the obstacle and put the present target last."""
        self._stages.blocked(pose, action)
        self._headed_for = ()
        if self._target_xy_m is not None:
            self._failed_xy_m.append(self._target_xy_m)

    def _mark_looked_at(self, pose: Pose2) -> None:
        """Suppress the regions of the target if the robot has come there; a way cut short has shown nothing of them."""
        if self._target_xy_m is not None and np.linalg.norm(self._target_xy_m - pose.xy_m) < 2 * ARRIVED_M:
            for region in self._headed_for:
                self._stages.finder.mark_looked_at(region)
        self._headed_for = ()

    def _scores(self, now: Situation, nodes: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        xy = now.graph.vertex_xy_m[nodes]
        visited = _within(xy, self._stages.topdown.trail_xy_m, self.config.visited_radius_m)
        failed = _within(xy, self._failed_xy_m, FAIL_RADIUS_M)
        in_horizon = (np.abs(xy - now.pose.xy_m) <= self.config.horizon_m / 2).all(axis=1)
        start = np.repeat(now.pose.xy_m[None], len(xy), axis=0)
        in_horizon &= segments_clear(now.topdown, start, xy, 0.0, now.pose)
        anchored = np.isin(nodes, [region.vertex for region in self._guiding(now)])
        return UNVISITED * ~visited + IN_HORIZON * in_horizon + ANCHORED * anchored + FAILED * failed

    def _order(
        self, now: Situation, nodes: Int[np.ndarray, " n"], score: Int[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """The vertices from best to worst: by tier and distance, or as the ablation asks."""
        distance = now.reach.distance_m[nodes]
        failed = _within(now.graph.vertex_xy_m[nodes], self._failed_xy_m, FAIL_RADIUS_M)
        if self.config.target == "hierarchical":
            return np.lexsort((distance, -score))
        visited = _within(now.graph.vertex_xy_m[nodes], self._stages.topdown.trail_xy_m, self.config.visited_radius_m)
        if self.config.target == "random":
            return np.lexsort((self._rng.random(len(nodes)), visited, failed))
        most = np.zeros(len(now.graph.vertex_xy_m))
        for region in now.regions:
            most[region.vertex] = max(most[region.vertex], region.score)
        return np.lexsort((distance, visited, -most[nodes], failed))

    def _guiding(self, now: Situation) -> tuple[Region, ...]:
        """The regions that lead the robot: none without visibility guidance."""
        return now.regions if self.config.visibility_guidance else ()

    def _go(
        self,
        now: Situation,
        vertex: int,
        path: Float[np.ndarray, "k 2"],
        nodes: Int[np.ndarray, " n"],
        score: Int[np.ndarray, " n"],
    ) -> Plan:
        xy = now.graph.vertex_xy_m[vertex]
        self._target_xy_m = xy
        self._stages.set_out(path)
        self._headed_for = tuple(region for region in self._guiding(now) if region.vertex == vertex)
        towards = [region.centre_m[:2] - xy for region in self._headed_for]
        headings = tuple(math.atan2(d[1], d[0]) for d in towards)
        tier = int(score[np.flatnonzero(nodes == vertex)[0]])
        chosen = {
            "hierarchical": f"nearest of {int((score == tier).sum())} vertices",
            "best-anchored": "the most uncertain region",
            "random": "drawn at random",
        }[self.config.target]
        reason = f"tier {tier}: {chosen}, {len(headings)} regions anchored, {now.reach.distance_m[vertex]:.1f} m away"
        steps = now.reach.distance_m[nodes] / FORWARD_STEP_M
        candidates = tuple(
            Candidate(now.graph.vertex_xy_m[n], float(s), float(s), float(c))
            for n, s, c in zip(nodes, score, steps, strict=True)
        )
        return Plan(
            reason,
            path,
            headings,
            candidates=candidates,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )

    def _look_around(self, reason: str) -> Plan:
        return Plan(reason, np.zeros((0, 2)), actions=(Action.TURN_LEFT,) * self.config.bootstrap_turns)

    def _stop(self, now: Situation, reason: str) -> Plan:
        return Plan(
            reason,
            np.zeros((0, 2)),
            stop=StopReason.NO_REACHABLE_TARGET,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )


def _within(
    xy_m: Float[np.ndarray, "n 2"], places_xy_m: list[Float[np.ndarray, 2]], radius_m: float
) -> Bool[np.ndarray, " n"]:
    if not places_xy_m:
        return np.zeros(len(xy_m), bool)
    places = np.array(places_xy_m)
    return (np.linalg.norm(xy_m[:, None] - places[None], axis=-1) < radius_m).any(axis=1)
