"""The vertices that a decision weighs, and in which order: by tier and room, or as the paper's ablations ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.paths import segments_clear
from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig
from anm_mj.planning.policies.anm_s.headings import view_box
from anm_mj.planning.policies.anm_s.region_stages import RegionState
from anm_mj.planning.policies.anm_s.targets import Targets
from anm_mj.planning.policies.anm_s.visited import num_within, seen_around
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.types import FORWARD_STEP_M, Observation, OccupancyGrid, Region

UNVISITED, IN_HORIZON, ANCHORED, FAILED = 3, 2, 1, -6
"""Weights of a vertex's properties in the authors' released code; they add up to its tier."""


def best_first(
    now: RegionState,
    candidates: Candidates,
    targets: Targets,
    target: str,
    rng: np.random.Generator,
    regions: Sequence[Region],
) -> Int[np.ndarray, " n"]:
    """The candidates from best to worst, the present target before all others.

    ``target`` is how to choose, one of ``TARGETS``; ``rng`` draws the random order; ``regions`` guide the robot.
    """
    xy, distance = now.graph.vertex_xy_m[candidates.vertex], now.paths.distance_m[candidates.vertex]
    other = np.ones(len(xy), bool)
    other[targets.match(xy)] = False
    if target == "hierarchical":
        return np.lexsort((distance, room_distance(now, candidates.vertex), -candidates.tier, other))
    failures = targets.num_failures(xy)
    if target == "random":
        return np.lexsort((rng.random(len(xy)), failures, other))
    most = np.zeros(len(now.graph.vertex_xy_m))
    for region in regions:
        most[region.vertex] = max(most[region.vertex], region.score)
    return np.lexsort((distance, ~candidates.unvisited, -most[candidates.vertex], failures, other))


def own_room(now: RegionState) -> int:
    """The robot's room: that of the vertex that it reaches first; -1 for none."""
    distance_m = now.paths.distance_m
    return int(now.room[np.argmin(distance_m)]) if np.isfinite(distance_m).any() else -1


def room_name(now: RegionState, vertex: int) -> str:
    """What to call the room of a vertex."""
    room = int(now.room[vertex])
    if room < 0:
        return "a nook"
    return "the rest of the room" if room == own_room(now) else f"room {room}"


def room_distance(now: RegionState, vertices: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How far the room of each vertex is: 0 for the robot's own, else to the nearest of these vertices in it [m]."""
    room, distance_m = now.room[vertices], now.paths.distance_m[vertices]
    nearest = np.full(len(now.room) + 1, np.inf)
    np.minimum.at(nearest, room, distance_m)
    nearest[own_room(now)] = 0.0
    # Nooks share a number, and nothing else.
    return np.where(room < 0, distance_m, nearest[room])


@dataclass(frozen=True)
class Candidates:
    """Vertices that the robot may go to."""

    vertex: Int[np.ndarray, " n"]
    """Indices into the graph."""
    unvisited: Bool[np.ndarray, " n"]
    near: Bool[np.ndarray, " n"]
    """Whether each lies in the local horizon."""
    tier: Int[np.ndarray, " n"]
    """Which kind of vertex comes before which, whatever its distance (paper, section III-C); larger is better."""


class CandidateFinder:
    """Finds the candidates of a decision; it remembers the view ahead."""

    def __init__(self, context: PolicyContext[AnmSConfig], targets: Targets):
        """Start without a view; ``targets`` are the present one and those given up."""
        self._config = context.settings
        self._horizon_m = context.planning.horizon_m
        self._footprint = context.footprint
        self._targets = targets
        self._last_xy_m: Float[np.ndarray, "2"] | None = None
        self._ahead: Observation | None = None

    def observe(self, observation: Observation) -> None:
        """Take a view made while driving for what lies ahead."""
        xy_m = observation.pose.xy_m
        if self._last_xy_m is None or np.linalg.norm(xy_m - self._last_xy_m) > FORWARD_STEP_M / 2:
            self._ahead = observation
        self._last_xy_m = xy_m

    def find(
        self,
        now: RegionState,
        regions: tuple[Region, ...],
        grid: OccupancyGrid,
        trajectory_xy_m: list[Float[np.ndarray, "2"]],
    ) -> Candidates:
        """Vertices that can be reached and are unvisited or have one of some regions anchored to them.

        The grid tells how near surface was seen; the trajectory is where the robot has been [m].
        """
        anchored = np.array([region.vertex for region in regions], np.int64)
        decisions = now.decisions
        if self._targets.unvisited:
            # The vertex that stands for the present target may be no decision vertex now.
            decisions = np.union1d(decisions, self._targets.match(now.graph.vertex_xy_m))
        vertex = np.union1d(decisions, anchored)
        vertex = vertex[np.isfinite(now.paths.distance_m[vertex])]
        vertex = vertex[~self._targets.is_given_up(now.graph.vertex_xy_m[vertex])]
        unvisited = np.isin(vertex, decisions)
        unvisited &= num_within(now.graph.vertex_xy_m[vertex], trajectory_xy_m, self._config.visited_radius_m) == 0
        unseen = unvisited
        if self._config.visited_by == "sight":
            unseen = unvisited & ~seen_around(now, vertex, grid, self._footprint, self._config)
        guided = np.isin(vertex, anchored) & (self._config.target != "random")
        # When nothing better is left, the robot visits vertices whose surroundings it saw from elsewhere.
        unvisited = unseen if (unseen | guided).any() else unvisited
        active = unvisited | guided
        vertex, unvisited = vertex[active], unvisited[active]
        xy_m = now.graph.vertex_xy_m[vertex]
        near = self._in_horizon(now, xy_m)
        failed = self._targets.num_failures(xy_m) > 0
        # An anchored region counts in the local horizon alone.
        seen = np.isin(vertex, anchored) & near
        tier = UNVISITED * unvisited + IN_HORIZON * near + ANCHORED * seen + FAILED * failed
        return Candidates(vertex, unvisited, near, tier)

    def _in_horizon(self, now: RegionState, xy_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which places lie in the local horizon, in sight and, where there are such, in the view ahead."""
        near = (np.abs(xy_m - now.pose.xy_m) <= self._horizon_m / 2).all(axis=1)
        near &= segments_clear(now.topdown, np.repeat(now.pose.xy_m[None], len(xy_m), axis=0), xy_m, 0.0, now.pose)
        if self._ahead is not None:
            low, high = view_box(self._ahead)
            ahead = near & ((xy_m >= low) & (xy_m <= high)).all(axis=1)
            near = ahead if ahead.any() else near
        return near
