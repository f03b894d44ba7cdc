"""The stages that every planning policy reads in the same order: top-down map, graph, paths, rooms, regions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.paths import ShortestPathTree, shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.contracted_edges import contract
from anm_mj.planning.policies.anm_s.decision_vertices import decision_vertices
from anm_mj.planning.policies.anm_s.graph_rooms import find_rooms
from anm_mj.planning.policies.anm_s.region_finder import RegionFinder
from anm_mj.planning.policies.anm_s.spurs import prune_spurs
from anm_mj.planning.policies.anm_s.traversable_frontier import borders_unknown, traversable_frontier
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.protocols import EstimatesErrors, Mapper
from anm_mj.types import (
    FORWARD_STEP_M,
    Action,
    Footprint,
    FormerRun,
    Observation,
    Pose2,
    Region,
    TopDownMap,
    VoronoiGraph,
)
from anm_mj.utils.stopwatch import Stopwatch

TRY_AGAIN = "another try to pass what blocked the robot"
"""Reason of a plan after :meth:`Stages.may_pass`."""


@dataclass(frozen=True)
class PlanningState:
    """What the stages read out of the map for one decision."""

    pose: Pose2
    """Where the robot stands."""
    topdown: TopDownMap
    """The top-down map."""
    graph: VoronoiGraph
    """The Voronoi graph; its vertices are the places to go to."""
    paths: ShortestPathTree
    """The shortest path to every vertex of the graph."""
    regions: tuple[Region, ...]
    """The regions of interest."""
    camera_height_m: float
    """Height of the camera above the floor [m]."""
    watch: Stopwatch = field(default_factory=Stopwatch)
    """What each stage took."""
    decisions: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Vertices at which there is something to decide; read together with the regions."""
    frontier_xy_m: Float[np.ndarray, "f 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    """Border of the unknown that the robot fits into [m]; read together with the regions."""
    room: Int[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0, np.int64))
    """The room of each vertex, -1 for none and where rooms are not looked for; read together with the regions."""


class Stages:
    """Runs the stages and keeps what they remember between decisions."""

    def __init__(
        self, config: PlanningConfig, footprint: Footprint, *, coarse_far_field: bool = False, with_rooms: bool = False
    ):
        """Start with nothing remembered.

        Args:
            config: the planner's settings.
            footprint: the body.
            coarse_far_field: whether the graph may be rough far away from the robot.
            with_rooms: whether rooms are looked for.
        """
        self._coarse_far_field = coarse_far_field
        self._with_rooms = with_rooms
        self.config = config
        self._radius_m = footprint.radius_m
        self.safe_m = footprint.radius_m + config.margin_m
        """Clearance that paths keep [m]."""
        self.topdown = TopDownMapper(config, footprint)
        self.region_finder = RegionFinder(config)

    def observe(self, observation: Observation) -> None:
        """Add the robot's place to its trajectory; to be told of every observation."""
        self.topdown.visit(observation.pose.xy_m)

    def continue_from(self, former: FormerRun) -> None:
        """Take over where a former run was, and what refused it."""
        self.topdown.continue_from(former.poses[:, :2])
        for x, y, yaw in former.refused:
            self.on_collision(Pose2(x, y, yaw), Action.MOVE_FORWARD)

    def read(self, mapper: Mapper, observation: Observation) -> PlanningState:
        """Top-down map, graph, shortest paths and regions as of now."""
        watch = Stopwatch()
        return self.update_graph(mapper, observation, self.update_map(mapper, observation, watch), watch)

    def update_map(self, mapper: Mapper, observation: Observation, watch: Stopwatch) -> TopDownMap:
        """The first stage alone: the top-down map as of now."""
        with watch.stage("topdown"):
            camera = FieldOfView.of(observation)
            self.region_finder.limit_range(camera.range_m)
            return self.topdown.update(mapper.occupancy, mapper.sdf, observation.pose, camera)

    def update_graph(
        self,
        mapper: Mapper,
        observation: Observation,
        topdown: TopDownMap,
        watch: Stopwatch,
        *,
        with_regions: bool = True,
    ) -> PlanningState:
        """The other stages, on the top-down map that :meth:`update_map` gave."""
        pose = observation.pose
        with watch.stage("graph"):
            graph = voronoi_graph(topdown, pose.xy_m, self.config, self.safe_m, coarse_far_field=self._coarse_far_field)
        with watch.stage("paths"):
            paths = shortest_paths(graph, topdown, pose, self.safe_m)
        height = float(observation.T_world_camera[2, 3])
        regions: tuple[Region, ...] = ()
        decisions, frontier, room = np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0, np.int64)
        if with_regions:
            with watch.stage("rooms"):
                frontier = traversable_frontier(topdown, self.safe_m)
                kept = prune_spurs(graph, borders_unknown(graph, frontier))
                decisions = decision_vertices(graph, contract(graph, kept))
                room = np.full(len(graph.vertex_xy_m), -1)
                if self._with_rooms:
                    room = find_rooms(graph, topdown, self.topdown.trajectory_xy_m[0]).room
            with watch.stage("regions"):
                radius = self.config.region_radius_m
                # Of what is higher, no region is made.
                error_m, height_m = None, self.config.region_max_height_m
                if self.config.region_known_by == "error" and isinstance(mapper, EstimatesErrors):
                    # They are of all points.
                    error_m, height_m = mapper.surface_errors(pose.xy_m, radius).error_m, math.inf
                surface = mapper.surface(pose.xy_m, radius, height_m)
                self.region_finder.update(surface, pose.xy_m, radius, error_m)
                regions = self.region_finder.regions(graph, mapper.occupancy, height, decisions)
        return PlanningState(pose, topdown, graph, paths, regions, height, watch, decisions, frontier, room)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Stamp the place that a refused forward step would have led to, so that no plan leads there again."""
        if action is Action.MOVE_FORWARD:
            ahead = np.array([np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)])
            reach_m = self._radius_m + FORWARD_STEP_M
            self.topdown.add_blocked(pose.xy_m + reach_m * ahead)

    def is_cut_off(self, reached: Bool[np.ndarray, " n"]) -> bool:
        """Whether refused steps keep the robot from most of the graph.

        Args:
            reached: whether a path leads to each vertex of the graph.
        """
        return self.topdown.any_blocked and int(np.count_nonzero(reached)) < 0.5 * len(reached)

    def may_pass(self, reached: Bool[np.ndarray, " n"]) -> bool:
        """Draw what refused steps smaller if it keeps the robot from most of the graph; whether this may open a way.

        Args:
            reached: whether a path leads to each vertex of the graph.
        """
        return self.is_cut_off(reached) and self.topdown.shrink_blocked()

    def squeeze(self) -> bool:
        """Keep no margin from now on, where no other way is left; whether this may open one."""
        before, self.safe_m = self.safe_m, self._radius_m
        return self.safe_m < before
