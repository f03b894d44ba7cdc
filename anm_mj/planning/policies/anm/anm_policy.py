"""Active Neural Mapping (Yan et al., ICCV 2023): greedily to the most uncertain piece of surface.

The map is one network (a mapping preset of its own), and all its weights are perturbed. The policy clusters the most
uncertain tenth of the surface near the robot. Every cluster gives one target half a metre before it, at the robot's
height. The robot goes to the target of highest variance, preferring those more than a metre away, until it is within
0.8 m of it or has spent 100 steps; then the policy forgets all candidates. It has no graph and no memory of regions.

Deviations:

- Dijkstra's algorithm finds paths on a grid of the policy's own instead of a learned point navigator, which tends to
  get stuck. This makes the baseline stronger than the published one.
- Targets must lie over free ground that the robot can reach.
- The policy reads uncertainty within 5 m of the robot and, when it finds no target there, everywhere.
- When no target of the most uncertain tenth can be reached, the next tenth gives the targets, and so on.
- When no target at all can be reached the robot makes one full rotation; then the run ends.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from anm_mj.geometry.connected_components import connected_components
from anm_mj.planning.grid_route import GridRoutes
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.planning.policies.scan_policy import ScanPolicy
from anm_mj.protocols import Mapper
from anm_mj.types import ARRIVED_M, FORWARD_STEP_M, Action, Candidate, Observation, Plan, StopReason, SurfacePoints
from anm_mj.utils.settings import setting
from anm_mj.utils.stopwatch import Stopwatch

EVERYWHERE_M = 1e4


@dataclass(frozen=True)
class AnmConfig(PolicyConfig):
    """Which surface counts as uncertain, and where the targets before it lie."""

    range_m: float = setting(10.0, at_most=100.0)
    """Depth beyond this is left out of the policy's own grid [m]."""
    near_m: float = 5.0
    """Half width of the local horizon [m]."""
    percentile: float = setting(90.0, at_most=99.9)
    """Surface above this percentile of uncertainty counts as uncertain [%] (paper; the released code keeps four
    fifths)."""
    link_m: float = 0.3
    """Points nearer to each other than this belong to one cluster [m]."""
    min_share: float = setting(0.005, at_most=1.0)
    """Clusters with a smaller share of the uncertain points are dropped."""
    stand_off_m: float = 0.5
    """Targets lie this far before the surface [m]."""
    min_distance_m: float = setting(1.0, at_least=0.0)
    """Targets nearer than this are taken only when there is no other [m]."""
    arrived_m: float = 0.8
    """The robot has reached a target when it is this near to it [m]."""
    max_steps: int = 100
    """The policy decides again after this many steps."""
    full_rotation_turns: int = 36
    """Turns of the rotation when no target can be reached, of 10 degrees each."""


class Anm(ScanPolicy):
    """Drives to the target of highest variance, then chooses again."""

    Config = AnmConfig

    def __init__(self, context: PolicyContext[AnmConfig]):
        """Start with an empty grid; the policy draws nothing, so the seed has no effect."""
        self.config = context.settings
        super().__init__(context, self.config.range_m)
        self._footprint = context.footprint
        self._rotated = False

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The path to the most uncertain piece of surface, up to ``arrived_m`` before its target."""
        watch = Stopwatch()
        pose = observation.pose
        with watch.stage("topdown"):
            topdown = self.grid.topdown()
        with watch.stage("paths"):
            routes = GridRoutes(topdown, pose, self._safe_m, self._slack_m, self._driven_m)
        with watch.stage("regions"):
            found, where = self._first_candidates(mapper, routes)
        if not found:
            if self._rotated:
                reason, stop = "no target can be reached, even after a full rotation", StopReason.NO_REACHABLE_TARGET
                return Plan(reason, stop=stop, topdown=topdown, stage_ms=watch.ms)
            self._rotated = True
            turns = (Action.TURN_LEFT,) * self.config.full_rotation_turns
            return Plan("no target can be reached: one full turn", actions=turns)
        self._rotated = False
        away = [c for c in found if math.dist(c.xy_m, pose.xy_m) > self.config.min_distance_m]
        best = max(away or found, key=lambda c: c.score)
        path = self._path_to(best.xy_m, routes)
        towards = best.xy_m - path[-1]
        return Plan(
            f"highest variance of {len(found)} clusters {where}, {best.cost_steps * FORWARD_STEP_M:.1f} m away",
            path,
            (math.atan2(towards[1], towards[0]),),
            valid_steps=self.config.max_steps,
            candidates=tuple(found),
            topdown=topdown,
            stage_ms=watch.ms,
        )

    def _first_candidates(self, mapper: Mapper, routes: GridRoutes) -> tuple[list[Candidate], str]:
        """The targets of the most uncertain share of surface that has any, and where that is, in words."""
        share, near_m = 100.0 - self.config.percentile, self.config.near_m
        surface = functools.cache(lambda radius_m: mapper.surface(routes.pose.xy_m, radius_m))
        for number in range(math.ceil(100.0 / share)):
            high = 100.0 - number * share
            for radius_m, where in ((near_m, f"within {near_m:g} m"), (EVERYWHERE_M, "anywhere")):
                found = self._candidates(surface(radius_m), routes, (max(high - share, 0.0), high))
                if found:
                    return found, where + f", less uncertain than {100.0 - high:g} % of the surface" * (number > 0)
        return [], ""

    def _candidates(
        self, surface: SurfacePoints, routes: GridRoutes, percentiles: tuple[float, float]
    ) -> list[Candidate]:
        """One target per cluster of surface of some uncertainty that the robot can reach and has not reached already.

        The uncertainty lies between two percentiles [%], the higher one left out where it is not the highest.
        """
        low = surface.xyz_m[:, 2] < self._footprint.z_max_m
        points, normals = surface.xyz_m[low], surface.normal[low]
        uncertainty = surface.uncertainty[low]
        if not len(points):
            return []
        least, most = np.percentile(uncertainty, percentiles)
        top = (uncertainty >= least) & ((uncertainty < most) | (percentiles[1] == 100.0))
        links = KDTree(points[top].astype(float)).query_pairs(self.config.link_m, output_type="ndarray")
        labels = connected_components(links, int(top.sum()))
        found = []
        for label in np.flatnonzero(np.bincount(labels) >= max(self.config.min_share * len(labels), 2)):
            mine = labels == label
            target = (points[top][mine] + self.config.stand_off_m * normals[top][mine]).mean(axis=0)[:2].astype(float)
            cost_m = routes.cost_at(target)
            if not math.isfinite(cost_m):
                continue
            # Where the path ends at the robot, the robot has reached the target already.
            if math.dist(self._path_to(target, routes)[-1], routes.pose.xy_m) > ARRIVED_M:
                variance = float(uncertainty[top][mine].mean())
                found.append(Candidate(target, variance, float(mine.sum()), cost_m / FORWARD_STEP_M))
        return found

    def _path_to(self, target_xy_m: Float[np.ndarray, "2"], routes: GridRoutes) -> Float[np.ndarray, "k 2"]:
        """The path that the robot drives for a target: up to ``arrived_m`` before it [m]."""
        return _cut_end(routes.path_to(target_xy_m), self.config.arrived_m)


def _cut_end(path_xy_m: Float[np.ndarray, "k 2"], length_m: float) -> Float[np.ndarray, "j 2"]:
    """A path without its last ``length_m``; its first point stays [m]."""
    path = path_xy_m
    while len(path) > 1:
        leg = path[-1] - path[-2]
        length = math.hypot(*leg)
        if length > length_m:
            return np.concatenate([path[:-1], (path[-1] - leg * (length_m / length))[None]])
        length_m -= length
        path = path[:-1]
    return path
