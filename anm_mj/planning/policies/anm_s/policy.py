"""The paper's policy: anchored vertices in the local horizon first, then near to far (sections III-B, III-C, IV-A).

After a full turn at the start, every decision weighs the vertices at which something is to be decided
(:mod:`anm_mj.planning.graph_nodes`), and any other that a region of interest is anchored to. Only those are candidates
that lie in an area not visited yet or have a region anchored to them. A candidate is better when it is unvisited, when
it lies in the local horizon and in the view ahead, and when it does and a region is anchored to it; among equals those
in the room that the robot is in come first, then room by room from near to far (:mod:`anm_mj.planning.rooms`), in each
the nearest along the graph (target "hierarchical"; the paper's ablation knows "random", any unvisited vertex, and
"best-anchored", the one with the most uncertain region). On arrival the robot turns until every region anchored there
has been in view. A target is kept until it is reached, blocked, or no longer a candidate because of what was seen on
the way. With no candidate left the robot looks around once more, as the authors' released code does, then the run ends.

The tiers, the visited radius and the view ahead are those of the released code, because the paper leaves them open.
Where paper and code differ, the paper is followed: a bootstrap of 36 turns without tilting, both decoders perturbed,
regions anchored by visibility, surfaces from zero-crossings. Deviations from the paper: unknown space is a state of its
own, so that vertices lie in observed free space only, and bounds are never taken from ground truth; regions vanish once
their surface was seen from near or turned to, so that there is an end; spurs of the graph into corners are no decision
vertices; between the local horizon and the whole graph there are rooms; vertices come last when all that surrounds them
was seen from near enough (``visited_by`` "place" leaves that out, as in the released code); after them come those
beside the unknown that the robot has only been near to.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.frames import pixel_directions, wrap_angle
from anm_mj.planning.contracted_edges import components
from anm_mj.planning.graph_nodes import BORDER_WIDTH_M, borders_unknown
from anm_mj.planning.paths import segments_clear
from anm_mj.planning.policies.anm_s.config import AnmSConfig
from anm_mj.planning.policies.anm_s.visited import num_within, seen_around, visited, within
from anm_mj.planning.policies.context import PolicyContext
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
    Region,
    StopReason,
    VoxelGrid,
)

UNVISITED, IN_HORIZON, ANCHORED, FAILED = 3, 2, 1, -6
"""Weights of a vertex's properties in the authors' released code."""
FAIL_RADIUS_M = 0.3
"""Vertices this near to a target that led into an obstacle are put last [m]."""
MAX_FAILS = 2
"""After so many blocked ways a target is given up."""
MAX_CHANGES = 3
"""A target that the robot has turned from so often is given up: it is there from afar only, where graphs are rough."""
REPLAN_STEPS = 10
"""So often it is asked whether the target is still worth going to."""
SAME_TARGET_M = 1.0
"""The graph changes; the vertex nearest to the target within this distance takes its place [m]."""
FULL_TURN = 36
"""Turns of a look around when nothing is left to go to."""
PIXEL_STEP = 4
"""Of a view every so many columns and rows tell how far it reaches [px]."""
WELL_IN_VIEW_RAD = math.radians(30.0)
"""A region less than this off the camera's axis is well inside a view of 90 degrees [rad]."""


class AnmS:
    """Active Neural Mapping at Scale (Kuang et al., IROS 2024) on our stages."""

    Config = AnmSConfig

    def __init__(self, context: PolicyContext[AnmSConfig]):
        """Start before the bootstrap rotation; the seed decides about random targets alone."""
        self.config = config = context.settings
        self._planning = context.planning
        self._footprint = context.footprint
        self._rng = np.random.default_rng(context.seed)
        # The paper's ablation has no order of rooms.
        self._stages = Stages(context.planning, context.footprint, with_rooms=config.target == "hierarchical")
        self._bootstrapped = False
        self._looked_around = False
        self._target_xy_m: Float[np.ndarray, 2] | None = None
        self._target_unvisited = False
        self._failed_xy_m: list[Float[np.ndarray, 2]] = []
        self._turned_from_xy_m: list[Float[np.ndarray, 2]] = []
        """Targets that were no candidates any more before they were reached."""
        self._headed_for: tuple[Region, ...] = ()
        self._last_xy_m: Float[np.ndarray, 2] | None = None
        self._ahead: Observation | None = None
        """The last view taken while driving: what lies in it is ahead."""

    def observe(self, observation: Observation) -> None:
        """Take note of what lies ahead, and of which regions come into view at the target."""
        pose = observation.pose
        if self._last_xy_m is None or np.linalg.norm(pose.xy_m - self._last_xy_m) > FORWARD_STEP_M / 2:
            self._ahead = observation
        self._last_xy_m = pose.xy_m
        if self._target_xy_m is not None and np.linalg.norm(self._target_xy_m - pose.xy_m) < 2 * ARRIVED_M:
            # There is no better place to see them from, so that is all there is to see of them.
            for region in self._headed_for:
                if abs(_off_axis(region, pose.xy_m, pose.yaw_rad)) < WELL_IN_VIEW_RAD + TURN_STEP_RAD:
                    self._stages.region_finder.mark_observed(region)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The bootstrap rotation first, then the best vertex by tier and distance."""
        if not self._bootstrapped and self.config.bootstrap_turns:
            self._bootstrapped = True
            return self._look_around("bootstrap: one full turn before the first decision", self.config.bootstrap_turns)
        now = self._stages.read(mapper, observation)
        nodes, unvisited = self._candidates(now, mapper.occupancy)
        near = self._in_horizon(now, now.graph.vertex_xy_m[nodes])
        score = self._scores(now, nodes, unvisited, near)
        before_xy_m = self._target_xy_m
        for best in self._order(now, nodes, unvisited, score):
            plan = self._go(now, int(best), nodes, near, score)
            if plan is not None:
                self._note_change(before_xy_m, now.pose)
                self._target_unvisited = bool(unvisited[best])
                self._looked_around = False
                return plan
        return self._to_the_unknown(now) or self._at_a_loss(now)

    def _note_change(self, before_xy_m: Float[np.ndarray, 2] | None, pose: Pose2) -> None:
        """Note the target before this one if the robot turns from it on the way."""
        if before_xy_m is None or self._target_xy_m is None or math.dist(before_xy_m, pose.xy_m) < 2 * ARRIVED_M:
            return
        if math.dist(before_xy_m, self._target_xy_m) > SAME_TARGET_M:
            self._turned_from_xy_m.append(before_xy_m)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Stamp the obstacle and put the present target last."""
        self._stages.on_collision(pose, action)
        self._headed_for = ()
        if self._target_xy_m is not None:
            self._failed_xy_m.append(self._target_xy_m)
            self._target_xy_m = None

    def _candidates(self, now: PlanningState, grid: VoxelGrid) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Vertices that a way leads to and that are unvisited or have a region anchored, and which are unvisited."""
        anchored = np.array([region.vertex for region in self._guiding(now)], np.int64)
        decisions = np.union1d(now.decisions, self._kept(now))
        nodes = np.union1d(decisions, anchored)
        nodes = nodes[np.isfinite(now.paths.distance_m[nodes])]
        nodes = nodes[~self._is_given_up(now.graph.vertex_xy_m[nodes])]
        unvisited = np.isin(nodes, decisions)
        unvisited &= ~visited(now.graph, nodes, self._stages.topdown.trajectory_xy_m, self.config)
        worth_it = unvisited
        if self.config.visited_by == "sight":
            seen = seen_around(now.graph, nodes, now.topdown, now.frontier_xy_m, grid, self._footprint, self.config)
            worth_it = unvisited & ~seen
        guided = np.isin(nodes, anchored) & (self.config.target != "random")
        # Once there is nothing better to do, vertices are visited whose surroundings were seen from elsewhere.
        unvisited = worth_it if (worth_it | guided).any() else unvisited
        active = unvisited | guided
        return nodes[active], unvisited[active]

    def _is_given_up(self, xy_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which places have led into an obstacle twice, or have come and gone as targets."""
        blocked = num_within(xy_m, self._failed_xy_m, FAIL_RADIUS_M) >= MAX_FAILS
        return blocked | (num_within(xy_m, self._turned_from_xy_m, FAIL_RADIUS_M) >= MAX_CHANGES)

    def _kept(self, now: PlanningState) -> Int[np.ndarray, " k"]:
        """The vertex that now stands for the present target, if that was unvisited: no junction any more, maybe."""
        if self._target_xy_m is None or not self._target_unvisited or not len(now.graph.vertex_xy_m):
            return np.zeros(0, np.int64)
        away = np.linalg.norm(now.graph.vertex_xy_m - self._target_xy_m, axis=1)
        return np.flatnonzero((away == away.min()) & (away <= SAME_TARGET_M))[:1]

    def _scores(
        self,
        now: PlanningState,
        nodes: Int[np.ndarray, " n"],
        unvisited: Bool[np.ndarray, " n"],
        near: Bool[np.ndarray, " n"],
    ) -> Int[np.ndarray, " n"]:
        failed = num_within(now.graph.vertex_xy_m[nodes], self._failed_xy_m, FAIL_RADIUS_M) > 0
        anchored = np.isin(nodes, [region.vertex for region in self._guiding(now)])
        return UNVISITED * unvisited + IN_HORIZON * near + ANCHORED * (anchored & near) + FAILED * failed

    def _in_horizon(self, now: PlanningState, xy_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which places lie in the local horizon, in sight and, where there are such, in the view ahead."""
        near = (np.abs(xy_m - now.pose.xy_m) <= self._planning.horizon_m / 2).all(axis=1)
        near &= segments_clear(now.topdown, np.repeat(now.pose.xy_m[None], len(xy_m), axis=0), xy_m, 0.0, now.pose)
        if self._ahead is not None:
            low, high = _view_box(self._ahead)
            ahead = near & ((xy_m >= low) & (xy_m <= high)).all(axis=1)
            near = ahead if ahead.any() else near
        return near

    def _order(
        self,
        now: PlanningState,
        nodes: Int[np.ndarray, " n"],
        unvisited: Bool[np.ndarray, " n"],
        score: Int[np.ndarray, " n"],
    ) -> Int[np.ndarray, " n"]:
        """From best to worst: the present target first, then by tier and distance, or as the ablation asks."""
        xy, distance = now.graph.vertex_xy_m[nodes], now.paths.distance_m[nodes]
        failed = num_within(xy, self._failed_xy_m, FAIL_RADIUS_M)
        present = np.zeros(len(nodes), bool)
        if self._target_xy_m is not None and len(nodes):
            away = np.linalg.norm(xy - self._target_xy_m, axis=1)
            present[np.argmin(away)] = away.min() <= SAME_TARGET_M
        if self.config.target == "hierarchical":
            return np.lexsort((distance, _rooms_off(now, nodes), -score, ~present))
        if self.config.target == "random":
            return np.lexsort((self._rng.random(len(nodes)), failed, ~present))
        most = np.zeros(len(now.graph.vertex_xy_m))
        for region in now.regions:
            most[region.vertex] = max(most[region.vertex], region.score)
        return np.lexsort((distance, ~unvisited, -most[nodes], failed, ~present))

    def _guiding(self, now: PlanningState) -> tuple[Region, ...]:
        """The regions that lead the robot: none without visibility guidance."""
        return now.regions if self.config.visibility_guidance else ()

    def _go(
        self,
        now: PlanningState,
        chosen: int,
        nodes: Int[np.ndarray, " n"],
        near: Bool[np.ndarray, " n"],
        score: Int[np.ndarray, " n"],
    ) -> Plan | None:
        """The plan that leads to one of the nodes and looks at its regions; None when there is nothing to be done."""
        vertex = int(nodes[chosen])
        xy = now.graph.vertex_xy_m[vertex]
        regions = tuple(region for region in self._guiding(now) if region.vertex == vertex)
        path = now.paths.path_to(vertex)
        here = np.linalg.norm(xy - now.pose.xy_m) < ARRIVED_M
        leg = path[-1] - path[-2] if len(path) > 1 else np.zeros(2)
        arrival_yaw = now.pose.yaw_rad if here else math.atan2(leg[1], leg[0])
        headings = view_headings(regions, xy, arrival_yaw)
        if not len(path) or (here and not headings):
            for region in regions if here else ():
                self._stages.region_finder.mark_observed(region)
            return None
        self._target_xy_m, self._headed_for = xy, regions
        self._stages.follow_path(path)
        tier = int(score[chosen])
        where = "the local horizon" if near[chosen] else _room_name(now, vertex)
        why = {
            "hierarchical": f"in {where}, first of {int((score == tier).sum())} vertices",
            "best-anchored": "the most uncertain region",
            "random": "drawn at random",
        }[self.config.target]
        reason = f"tier {tier}: {why}, {len(regions)} regions anchored, {now.paths.distance_m[vertex]:.1f} m away"
        steps = now.paths.distance_m[nodes] / FORWARD_STEP_M
        candidates = tuple(
            Candidate(now.graph.vertex_xy_m[n], float(s), float(s), float(c))
            for n, s, c in zip(nodes, score, steps, strict=True)
        )
        return Plan(
            reason,
            path,
            headings,
            valid_steps=REPLAN_STEPS,
            candidates=candidates,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )

    def _to_the_unknown(self, now: PlanningState) -> Plan | None:
        """To the nearest vertex beside the unknown that the robot has been near to but not at, and a look into it.

        Where the paper's graph goes on through unknown space there are unvisited vertices behind a door that was passed
        and not looked through; here the graph ends before it, maybe nearer than counts as visited.
        """
        graph, distance_m = now.graph, now.paths.distance_m
        beside = np.flatnonzero(borders_unknown(graph, now.frontier_xy_m) & np.isfinite(distance_m))
        xy = graph.vertex_xy_m[beside]
        beside = beside[~within(xy, self._stages.topdown.trajectory_xy_m, 2 * ARRIVED_M) & ~self._is_given_up(xy)]
        if not len(beside):
            return None
        vertex = int(beside[np.argmin(distance_m[beside])])
        path = now.paths.path_to(vertex)
        if not len(path):
            return None
        self._target_xy_m, self._headed_for, self._target_unvisited = graph.vertex_xy_m[vertex], (), False
        away = np.linalg.norm(now.frontier_xy_m - self._target_xy_m, axis=1)
        near = away <= graph.clearance_m[vertex] + BORDER_WIDTH_M
        towards = now.frontier_xy_m[near].mean(axis=0) - self._target_xy_m
        self._stages.follow_path(path)
        return Plan(
            f"every vertex is visited: a look into the unknown beside one, {distance_m[vertex]:.1f} m away",
            path,
            (math.atan2(towards[1], towards[0]),),
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )

    def _at_a_loss(self, now: PlanningState) -> Plan:
        """Look around once, as the authors' released code does; when that has brought nothing, stop."""
        self._target_xy_m, self._headed_for = None, ()
        reached = np.isfinite(now.paths.distance_m)
        reachable = reached.any()
        what = "every vertex is visited and no region is left" if reachable else "no vertex of the graph can be reached"
        if not self._looked_around:
            self._looked_around = True
            return self._look_around(f"{what}: another full turn", FULL_TURN)
        num_parts = len(np.unique(components(now.graph)[~reached]))
        return Plan(
            f"{what}, even after a look around; parts of the graph out of reach: {num_parts}",
            np.zeros((0, 2)),
            stop=StopReason.COMPLETE if reachable else StopReason.NO_REACHABLE_TARGET,
            topdown=now.topdown,
            graph=now.graph,
            regions=now.regions,
            stage_ms=now.watch.ms,
        )

    def _look_around(self, reason: str, turns: int) -> Plan:
        return Plan(reason, np.zeros((0, 2)), actions=(Action.TURN_LEFT,) * turns)


def _own_room(now: PlanningState) -> int:
    """The room that the robot is in: that of the vertex that it reaches first; -1 for none."""
    distance_m = now.paths.distance_m
    return int(now.room[np.argmin(distance_m)]) if np.isfinite(distance_m).any() else -1


def _room_name(now: PlanningState, vertex: int) -> str:
    """What to call the room of a vertex."""
    room = int(now.room[vertex])
    if room < 0:
        return "a nook"
    return "the rest of the room" if room == _own_room(now) else f"room {room}"


def _rooms_off(now: PlanningState, nodes: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How far the room of each vertex is: 0 for the robot's own, else to the nearest of these vertices in it [m]."""
    room, distance_m = now.room[nodes], now.paths.distance_m[nodes]
    nearest = np.full(len(now.room) + 1, np.inf)
    np.minimum.at(nearest, room, distance_m)
    nearest[_own_room(now)] = 0.0
    # Nooks have a number in common, and nothing else.
    return np.where(room < 0, distance_m, nearest[room])


def view_headings(regions: tuple[Region, ...], xy_m: Float[np.ndarray, "2"], yaw_rad: float) -> tuple[float, ...]:
    """Yaws to turn to, one after the other, until every region has been well in view.

    Args:
        regions: what is to be looked at.
        xy_m: from where [m].
        yaw_rad: heading before the first turn.
    """
    headings: list[float] = []
    left = list(regions)
    while left:
        left.sort(key=lambda region: abs(_off_axis(region, xy_m, yaw_rad)))
        error = _off_axis(left.pop(0), xy_m, yaw_rad)
        if abs(error) > WELL_IN_VIEW_RAD:
            yaw_rad = wrap_angle(yaw_rad + error - math.copysign(WELL_IN_VIEW_RAD, error))
            headings.append(yaw_rad)
    return tuple(headings)


def _off_axis(region: Region, xy_m: Float[np.ndarray, "2"], yaw_rad: float) -> float:
    """Angle from a heading to a region, counter-clockwise [rad]."""
    towards = region.centre_m[:2] - xy_m
    return wrap_angle(math.atan2(towards[1], towards[0]) - yaw_rad)


def _view_box(view: Observation) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower and upper corner of all that a view shows [m]."""
    rays = pixel_directions(view.intrinsics)[::PIXEL_STEP, ::PIXEL_STEP]
    depth = view.depth_m[::PIXEL_STEP, ::PIXEL_STEP, None]
    points = (rays * depth) @ view.T_world_camera[:2, :3].T
    points = points[np.isfinite(points).all(axis=-1)]
    here = view.T_world_camera[:2, 3]
    corners = np.concatenate([np.zeros((1, 2)), points]) + here
    return corners.min(axis=0), corners.max(axis=0)
