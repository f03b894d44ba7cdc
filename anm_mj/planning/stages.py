"""The stages that policies share, in order: top-down map, Voronoi graph, shortest paths."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.paths import ShortestPathTree, shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.protocols import Mapper
from anm_mj.types import (
    FORWARD_STEP_M,
    Action,
    ExploredState,
    Footprint,
    Observation,
    Plan,
    Pose2,
    TopDownMap,
    VoronoiGraph,
)
from anm_mj.utils.arrays import Window
from anm_mj.utils.stopwatch import Stopwatch

TRY_AGAIN = "another try to pass what blocked the robot"
"""Reason of a plan after :meth:`Stages.shrink_collisions` or :meth:`Stages.drop_margin`."""


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
    watch: Stopwatch = field(default_factory=Stopwatch)
    """What each stage took."""

    def plan(self, reason: str, **decided: Any) -> Plan:
        """A plan with what it was decided on, for log, replay and film; ``decided`` are its other fields."""
        return Plan(reason, topdown=self.topdown, graph=self.graph, stage_ms=self.watch.ms, **decided)


class Stages:
    """Runs the stages and keeps what they remember between decisions."""

    def __init__(self, config: PlanningConfig, footprint: Footprint, *, coarse_far_field: bool = False):
        """Start with nothing remembered; ``coarse_far_field``: the graph may be rough far away from the robot."""
        self._coarse_far_field = coarse_far_field
        self.config = config
        self._radius_m = footprint.radius_m
        self.safe_m = footprint.radius_m + config.margin_m
        """Clearance that paths keep [m]."""
        self.topdown = TopDownMapper(config, footprint)

    def observe(self, observation: Observation) -> None:
        """Add the robot's place to its trajectory; call it with every observation."""
        self.topdown.visit(observation.pose.xy_m)

    def continue_from(self, prior: ExploredState) -> None:
        """Take over where the robot of a prior run was, and where it collided."""
        self.topdown.continue_from(prior.poses[:, :2])
        for x, y, yaw in prior.collisions:
            self.on_collision(Pose2(x, y, yaw), Action.MOVE_FORWARD)

    def read(self, mapper: Mapper, observation: Observation) -> PlanningState:
        """Top-down map, graph and shortest paths as of now."""
        watch = Stopwatch()
        topdown, _ = self.update_map(mapper, observation, watch)
        return self.update_graph(topdown, observation.pose, watch)

    def update_map(
        self, mapper: Mapper, observation: Observation, watch: Stopwatch
    ) -> tuple[TopDownMap, Window | None]:
        """The first stage alone: the top-down map as of now, and the part of the occupancy grid that it read again."""
        with watch.stage("topdown"):
            known = mapper.occupancy_grid(), mapper.sdf, mapper.truncation_m
            return self.topdown.update(*known, observation.pose, FieldOfView.of(observation))

    def update_graph(self, topdown: TopDownMap, pose: Pose2, watch: Stopwatch) -> PlanningState:
        """The other stages, on the top-down map that :meth:`update_map` gave."""
        with watch.stage("graph"):
            graph = voronoi_graph(topdown, pose.xy_m, self.config, self.safe_m, coarse_far_field=self._coarse_far_field)
        with watch.stage("paths"):
            tight = self.safe_m <= self._radius_m
            paths = shortest_paths(graph, topdown, pose, self.safe_m, joins_edges=tight)
        return PlanningState(pose, topdown, graph, paths, watch)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Mark the place that a forward step from a pose would have led to, so that no plan leads there again."""
        if action is Action.MOVE_FORWARD:
            ahead = np.array([np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)])
            self.topdown.add_collision(pose.xy_m + (self._radius_m + FORWARD_STEP_M) * ahead)

    def is_cut_off(self, reached: Bool[np.ndarray, " n"]) -> bool:
        """Whether collisions keep the robot from most of the graph: paths lead to the vertices that are ``reached``."""
        return self.topdown.any_collision and int(np.count_nonzero(reached)) < 0.5 * len(reached)

    def shrink_collisions(self, reached: Bool[np.ndarray, " n"]) -> bool:
        """Draw what the robot collided with smaller where it is cut off; whether this may open a path."""
        return self.is_cut_off(reached) and self.topdown.shrink_collisions()

    def drop_margin(self) -> bool:
        """Keep no margin to obstacles from now on, where no other path is left; whether this may open one."""
        before, self.safe_m = self.safe_m, self._radius_m
        return self.safe_m < before
