"""The stages of the paper's policy, beyond those that all share: decision vertices, rooms and regions of interest."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from anm_mj.planning.borders import borders_unknown, traversable_frontier
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.decision_vertices import decision_vertices, prune_spurs
from anm_mj.planning.policies.anm_s.graph_rooms import segment_rooms
from anm_mj.planning.policies.anm_s.region_finder import RegionFinder
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.protocols import EstimatesErrors, Mapper
from anm_mj.types import Footprint, Observation, Plan, Region


@dataclass(frozen=True, kw_only=True)
class RegionState(PlanningState):
    """A planning state with what the paper's policy weighs."""

    regions: tuple[Region, ...]
    """The regions of interest."""
    decisions: Int[np.ndarray, " k"]
    """Vertices at which there is something to decide."""
    frontier_xy_m: Float[np.ndarray, "f 2"]
    """Border of the unknown that the robot fits into [m]."""
    room: Int[np.ndarray, " n"]
    """The room of each vertex; -1 for none, and where rooms are not looked for."""

    def plan(self, reason: str, **decided: Any) -> Plan:
        """A plan with what it was decided on, regions too."""
        return super().plan(reason, regions=self.regions, **decided)


class RegionStages(Stages):
    """Runs the shared stages, then those of the paper's policy."""

    def __init__(self, config: PlanningConfig, footprint: Footprint, *, with_rooms: bool = False):
        """Start with nothing remembered; ``with_rooms``: look for rooms."""
        super().__init__(config, footprint)
        self._with_rooms = with_rooms
        self.region_finder = RegionFinder(config)

    def read(self, mapper: Mapper, observation: Observation) -> RegionState:
        """Top-down map, graph, shortest paths, decision vertices, rooms and regions as of now."""
        now = super().read(mapper, observation)
        graph, xy_m = now.graph, now.pose.xy_m
        with now.watch.stage("rooms"):
            frontier = traversable_frontier(now.topdown, self.safe_m)
            kept = prune_spurs(graph, borders_unknown(graph, frontier))
            decisions = decision_vertices(graph, kept)
            room = np.full(len(graph.vertex_xy_m), -1)
            if self._with_rooms:
                room = segment_rooms(graph, now.topdown, self.topdown.trajectory_xy_m[0])
        with now.watch.stage("regions"):
            radius_m = self.config.region_radius_m
            # Of what is higher, no region is made.
            error_m, height_m = None, self.config.region_max_height_m
            if self.config.region_known_by == "error" and isinstance(mapper, EstimatesErrors):
                # They are of all points.
                error_m, height_m = mapper.surface_errors(xy_m, radius_m).error_m, math.inf
            self.region_finder.limit_range(observation.range_m)
            self.region_finder.update(mapper.surface(xy_m, radius_m, height_m), xy_m, radius_m, error_m)
            camera_height_m = float(observation.T_world_camera[2, 3])
            regions = self.region_finder.regions(graph, mapper.occupancy_grid(), camera_height_m, decisions)
        return RegionState(**vars(now), regions=regions, decisions=decisions, frontier_xy_m=frontier, room=room)
