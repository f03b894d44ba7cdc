"""Frontier-based exploration (Yamauchi, CIRA 1997), in the configuration that the paper's tables use as FBE.

The policy has a planar grid of its own, with cells of 5 cm and depth up to 3 m, as in the code published with UPEN
(Georgakis et al., ICRA 2022). A flood from the robot over free cells meets the frontiers, the borders of unknown
ground, one after the other; the robot goes to the first one at least 1 m away and reads the map again every 10 steps. A
second registered name of this policy uses the camera's full range.

Deviations:

- The robot keeps its frontier until it has looked at it or the frontier is gone, as Yamauchi's does. The published code
  chooses again every 10 steps of 25 cm. With steps of 6.5 cm the robot would turn back and forth between two frontiers
  for ever, because the nearer one stops counting a metre before it.
- Dijkstra's algorithm finds paths on the grid, with this project's clearance, instead of a learned point navigator. The
  robot can go back the way it came, although a collision or a scan has marked an obstacle beside it since.
- Where no frontier can be reached, the marks of collisions shrink, as in the map of the other policies.
- The robot gives a frontier up when it looked at it and it stays, when no path comes near (Yamauchi's list of
  inaccessible frontiers), or when it takes more than twice the steps of the path's cost and a look around: at first as
  a whole, and when no other is left only where it was tried. Then the run ends as complete instead of driving
  backwards for ever.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import KDTree
from skimage.graph import MCP

from anm_mj.frames import cell_to_world, world_to_cell, wrap_angle
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.planning.grid_route import GridRoutes
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.planning.policies.continued_run import remembered
from anm_mj.planning.policies.scan_policy import ScanPolicy
from anm_mj.protocols import Mapper
from anm_mj.types import (
    ARRIVED_M,
    FORWARD_STEP_M,
    FREE,
    TURN_STEP_RAD,
    UNKNOWN,
    Candidate,
    ExploredState,
    Observation,
    Plan,
    Pose2,
    StopReason,
    TopDownMap,
)
from anm_mj.utils.settings import setting
from anm_mj.utils.stopwatch import Stopwatch

NEARER_M = 0.1
"""A place to see the frontier from is taken instead of the one before where it is nearer to it by this [m]. Which cells
beside the robot can be reached depends on where it stands, so that two places could take turns for ever."""
OVERTIME = 2.0
"""A frontier is given up after this many times the steps that its path, its crowded parts counted up to twice, and a
look around take."""


@dataclass(frozen=True)
class FrontierConfig(PolicyConfig):
    """How far the policy scans, and when it leaves a frontier for later or gives it up."""

    range_m: float = setting(3.0, at_most=100.0)
    """Depth beyond this is ignored [m]; 3 m as published, 10 m is the camera's range in the paper's protocol."""
    min_distance_m: float = setting(1.0, at_least=0.0)
    """Frontiers nearer than this come after all others [m]."""
    replan_steps: int = 10
    """The policy decides again after this many steps."""
    max_gap_m: float = 0.75
    """A frontier is out of reach when every place the robot can get to is farther from it than this [m]."""
    given_up_m: float = 0.3
    """Frontiers this near to one that was given up are given up with it [m]."""


@dataclass(frozen=True)
class _Frontier:
    contact_xy_m: Float[np.ndarray, "2"]
    """Where a flood from the robot first meets it [m]."""
    num_cells: int
    hops: float
    """Cells between it and the robot."""


class _Target(NamedTuple):
    contact_xy_m: Float[np.ndarray, "2"]
    """The chosen frontier [m]."""
    place_xy_m: Float[np.ndarray, "2"]
    """Where to see it from [m]."""
    last_step: int
    """The frontier is given up after this step."""


class Frontier(ScanPolicy):
    """Goes to the nearest frontier that is not too near."""

    Config = FrontierConfig

    def __init__(self, context: PolicyContext[FrontierConfig]):
        """Start with an empty grid; the policy draws nothing, so the seed has no effect."""
        self.config = context.settings
        super().__init__(context, self.config.range_m)
        self._chosen: _Target | None = None
        self._given_up_xy_m = np.zeros((0, 2))

    def memory(self) -> dict[str, np.ndarray]:
        """The grid, and the frontiers that were given up."""
        return {**super().memory(), "given_up_xy_m": self._given_up_xy_m}

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Take over the grid of a prior run, and the frontiers that it gave up."""
        super().continue_from(prior, mapper)
        given_up = remembered(prior, "given_up_xy_m", (None, 2))
        if given_up is not None:
            self._given_up_xy_m = given_up.astype(float)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The path to a frontier; the policy ignores the neural map."""
        del mapper
        return self._decide(observation)

    def _decide(self, observation: Observation) -> Plan:
        watch = Stopwatch()
        pose = observation.pose
        with watch.stage("topdown"):
            topdown = self.grid.topdown()
            hops = border_hops(topdown, pose)
            found = frontiers(topdown, hops)
        with watch.stage("paths"):
            routes = GridRoutes(topdown, pose, self._safe_m, self._slack_m, self._driven_m)
            kept = self._keep(topdown, hops, routes, observation.step)
            left = self._within_reach(found, routes)
            if kept is None and not left:
                # One frontier may run around the whole known area; giving part of it up leaves the rest.
                left = self._within_reach(frontiers(topdown, self._without_given_up(topdown, hops)), routes)
        if kept is not None:
            self._chosen = kept
            return self._go("the same frontier as before", routes, left, watch)
        if not left and self.grid.shrink_collisions(self._driven_m):
            return self._decide(observation)
        if not left:
            reason = f"none of {len(found)} frontiers can be reached" if found else "no frontier is left"
            return Plan(reason, stop=StopReason.COMPLETE, topdown=topdown, stage_ms=watch.ms)
        away = [math.dist(f.contact_xy_m, pose.xy_m) >= self.config.min_distance_m for f, _ in left]
        frontier, place = left[away.index(True) if any(away) else -1]
        needed = routes.cost_at(place) / FORWARD_STEP_M + NUM_HEADINGS
        self._chosen = _Target(frontier.contact_xy_m, place, observation.step + math.ceil(OVERTIME * needed))
        reason = (
            f"nearest of {len(left)} frontiers at least {self.config.min_distance_m:g} m away: "
            f"{frontier.num_cells} cells, {frontier.hops * topdown.resolution_m:.1f} m off"
        )
        return self._go(reason, routes, left, watch)

    def _keep(
        self, topdown: TopDownMap, hops: Float[np.ndarray, "rows cols"], routes: GridRoutes, step: int
    ) -> _Target | None:
        """The present frontier and where to see it from; None when it is gone or the robot gives it up."""
        target, self._chosen = self._chosen, None
        if target is None:
            return None
        contact, place = target.contact_xy_m, target.place_xy_m
        border = cell_to_world(np.argwhere(np.isfinite(hops)), topdown.origin_xy_m, topdown.resolution_m)
        if not (np.linalg.norm(border - contact, axis=1) < self.config.given_up_m).any():
            return None
        nearest = routes.nearest(contact)
        is_nearer = math.dist(contact, nearest) < math.dist(contact, place) - NEARER_M
        if is_nearer or not math.isfinite(routes.cost_at(place)):
            place = nearest
        is_far = math.dist(contact, place) >= self.config.max_gap_m
        if is_far or step > target.last_step or self._is_looked_at(contact, place, routes.pose):
            self._given_up_xy_m = np.concatenate([self._given_up_xy_m, contact[None]])
            return None
        return target._replace(place_xy_m=place)

    def _go(
        self, reason: str, routes: GridRoutes, left: list[tuple[_Frontier, Float[np.ndarray, "2"]]], watch: Stopwatch
    ) -> Plan:
        """The path to the present target and a look at it."""
        assert self._chosen is not None  # Both callers have just set it.
        contact, place = self._chosen.contact_xy_m, self._chosen.place_xy_m
        return Plan(
            reason,
            routes.path_to(place),
            (self._yaw_to_see(contact, place),),
            valid_steps=self.config.replan_steps,
            candidates=tuple(
                Candidate(p, -f.hops, float(f.num_cells), f.hops * routes.topdown.resolution_m / FORWARD_STEP_M)
                for f, p in left
            ),
            topdown=routes.topdown,
            stage_ms=watch.ms,
        )

    def _within_reach(
        self, found: list[_Frontier], routes: GridRoutes
    ) -> list[tuple[_Frontier, Float[np.ndarray, "2"]]]:
        """The frontiers that the robot can see from a reachable place, each with that place [m]; without those that it
        gave up or looks at already.
        """
        left = []
        for frontier in found:
            contact = frontier.contact_xy_m
            if (np.linalg.norm(self._given_up_xy_m - contact, axis=1) < self.config.given_up_m).any():
                continue
            place = routes.nearest(contact)
            is_near = math.dist(contact, place) < self.config.max_gap_m
            if is_near and not self._is_looked_at(contact, place, routes.pose):
                left.append((frontier, place))
        return left

    def _without_given_up(
        self, topdown: TopDownMap, hops: Float[np.ndarray, "rows cols"]
    ) -> Float[np.ndarray, "rows cols"]:
        """The border without the cells near a frontier that was given up."""
        cells = np.argwhere(np.isfinite(hops))
        kept = hops.copy()
        if len(cells) and len(self._given_up_xy_m):
            xy_m = cell_to_world(cells, topdown.origin_xy_m, topdown.resolution_m)
            rows, cols = cells[KDTree(self._given_up_xy_m).query(xy_m)[0] < self.config.given_up_m].T
            kept[rows, cols] = np.inf
        return kept

    def _yaw_to_see(self, contact_xy_m: Float[np.ndarray, "2"], place_xy_m: Float[np.ndarray, "2"]) -> float:
        """The heading at which the camera looks from a place at a frontier [rad]."""
        towards = contact_xy_m - place_xy_m
        return wrap_angle(math.atan2(towards[1], towards[0]) - self._azimuth_rad)

    def _is_looked_at(
        self, contact_xy_m: Float[np.ndarray, "2"], place_xy_m: Float[np.ndarray, "2"], pose: Pose2
    ) -> bool:
        """Whether the robot stands where it can see a frontier from, and its camera faces it."""
        error = wrap_angle(self._yaw_to_see(contact_xy_m, place_xy_m) - pose.yaw_rad)
        return math.dist(place_xy_m, pose.xy_m) < ARRIVED_M and abs(error) < TURN_STEP_RAD


def border_hops(topdown: TopDownMap, pose: Pose2) -> Float[np.ndarray, "rows cols"]:
    """Cells between the robot and each unknown cell that borders on ground it can flood; +inf for all others."""
    start = world_to_cell(pose.xy_m[None], topdown.origin_xy_m, topdown.resolution_m)[0]
    hops = MCP(np.where(topdown.state == FREE, 1.0, -1.0)).find_costs([tuple(start)])[0]
    padded = np.pad(hops, 1, constant_values=np.inf)
    beside = np.minimum.reduce([padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2]])
    return np.where(topdown.state == UNKNOWN, beside, np.inf)


def frontiers(topdown: TopDownMap, contact: Float[np.ndarray, "rows cols"]) -> list[_Frontier]:
    """The border that :func:`border_hops` gives in pieces, connected over eight neighbours, nearest first."""
    border: Bool[np.ndarray, "rows cols"] = np.isfinite(contact)
    labels = np.empty(border.shape, np.int32)
    count = int(ndimage.label(border, structure=np.ones((3, 3), bool), output=labels))  # pyright: ignore[reportArgumentType]
    if not count:
        return []
    sizes = np.bincount(labels.ravel())
    first = ndimage.minimum_position(contact, labels, range(1, count + 1))
    xy_m = cell_to_world(np.array(first), topdown.origin_xy_m, topdown.resolution_m)
    found = [_Frontier(xy, int(sizes[k + 1]), float(contact[first[k]])) for k, xy in enumerate(xy_m)]
    return sorted(found, key=lambda frontier: frontier.hops)
