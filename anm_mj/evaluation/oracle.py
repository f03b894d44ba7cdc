"""The oracle: a policy that knows the scene, for what the others are to be measured by.

It knows the true surface, which of it can be seen and where the robot can go, and looks for a short tour of views that
covers it (:mod:`anm_mj.evaluation.oracle_tour`). It drives that tour in the simulator like every other policy. On its
way it keeps account of what the frames have covered: views that have become needless are left out, and the tour through
the others is planned anew on every arrival, so that what is seen in passing is not looked at again. Its steps are an
estimate of the fewest possible from above, not a proof: no tour is known to be shorter, and none is known not to be.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from anm_mj.errors import PlanError
from anm_mj.evaluation.coverage import COVERED_M, Coverage
from anm_mj.evaluation.depth import reduce_depth
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.observable import Floor
from anm_mj.evaluation.oracle_tour import Start, View, cover, shorten, step_costs
from anm_mj.evaluation.oracle_views import Views
from anm_mj.evaluation.oracle_ways import Ways, spread_places
from anm_mj.evaluation.pixel_rays import NUM_YAWS, Mount, PixelRays
from anm_mj.evaluation.raycast import RayCaster
from anm_mj.frames import move_pose
from anm_mj.protocols import Mapper
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, Observation, Plan, Pose2, StopReason

LEVELS = (0.90, 0.95, 0.99, 1.0)
"""Shares of the observable surface that are gone for one after the other: the shortest tour for the last would be a
long one for the first."""
SLACK = 0.003
"""Planned beyond a level, so that what a view promises and does not keep costs no extra way."""
PLACE_SPACING_M = 0.35
"""Spacing of the places to look from [m], wider in scenes with more than ``MAX_PLACES``."""
MAX_PLACES = 1500
NUM_SAMPLES = 12_000
"""Samples of the observable surface that are planned with."""
SEED = 0
AHEAD_M = 0.1
"""How far before the robot an obstacle is that has blocked it [m], beyond its own radius."""


class Oracle:
    """Goes where it knows that something is left to see."""

    def __init__(self, truth: GroundTruth, floor: Floor, mount: Mount) -> None:
        """Look at the scene from everywhere.

        Args:
            truth: The true surface, with its observable part.
            floor: Where the robot can get to.
            mount: Its camera.

        Raises:
            PlanError: It is not known which part of the surface can be seen.
        """
        if truth.observable is None:
            raise PlanError(
                "The policy 'oracle' needs the observable surface; pip install 'anm-mj[embree]' brings what finds it."
            )
        observable = truth.samples[truth.observable]
        chosen = np.random.default_rng(SEED).permutation(len(observable))[:NUM_SAMPLES]
        self._samples = observable[np.sort(chosen)]
        self._coverage = Coverage(self._samples)
        self._ways = Ways(floor)
        self._cells = _places(floor, self._ways)
        self._places_m = self._ways.xy_m(self._cells)
        rays = PixelRays(RayCaster(truth.vertices, truth.faces), mount)
        self._views = Views(self._samples, self._places_m, rays)
        self._refused = np.zeros(len(self._samples), bool)
        """Samples given up: a view said that it would cover them and did not."""
        self._target: View | None = None
        self._expected = np.zeros(0, np.int32)

    def observe(self, observation: Observation) -> None:
        """Keep account of what the frames cover."""
        depth_mm = reduce_depth(observation.depth_m)
        self._coverage.add(depth_mm, observation.intrinsics, observation.T_world_camera)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The next view of a tour through what is left, or the end when nothing is."""
        del mapper  # What is true needs no map.
        left = self._coverage.distance_m >= COVERED_M
        pose = observation.pose
        # A view on the way is kept as long as most of what it is for is left.
        if self._target is not None and 2 * np.count_nonzero(left[self._expected]) < len(self._expected):
            self._target = None
        if self._target is not None and self._is_at(self._target, pose):
            # Whatever it still does not show from here it will not show the next time.
            self._refused[self._expected[left[self._expected]]] = True
            self._target = None
        if self._target is None:
            self._target = self._next_view(left & ~self._refused, len(left) - int(left.sum()), pose)
            if self._target is not None:
                expected = self._views.covered(self._target.place, self._target.yaw, self._target.yaw)
                self._expected = expected[left[expected] & ~self._refused[expected]]
        if self._target is None:
            return Plan("nothing is left to see", np.zeros((0, 2)), stop=StopReason.COMPLETE)
        place_m = self._places_m[self._target.place]
        path_m = np.zeros((0, 2))
        if math.dist(place_m, pose.xy_m) >= ARRIVED_M:
            target = (int(self._cells[self._target.place, 0]), int(self._cells[self._target.place, 1]))
            path_m = self._ways.path_m(self._ways.cell(pose.xy_m), target)
            path_m[0] = pose.xy_m
        done = 100.0 * (1.0 - left.mean())
        return Plan(
            f"{done:.1f} % covered, {len(self._expected)} samples to be seen next",
            path_m,
            headings_rad=(self._target.yaw * TURN_STEP_RAD,),
        )

    def blocked(self, pose: Pose2, action: Action) -> None:
        """Make the spot ahead dear, so that the next way leads round it."""
        self._ways.avoid(move_pose(pose, AHEAD_M, 0.0).xy_m)
        self._target = None
        del action  # Only moves forward are ever blocked.

    def _next_view(self, left: np.ndarray, num_covered: int, pose: Pose2) -> View | None:
        """The first view of a short tour to the next level."""
        total = len(left)
        start = Start(pose.xy_m, pose.yaw_rad, self._distances(self._ways.cell(pose.xy_m), keep=False))
        for level in LEVELS:
            enough = math.ceil(min(level + SLACK, 1.0) * total) - num_covered
            if num_covered >= level * total or enough <= 0:
                continue
            tour = cover(self._views, left, enough, start, self._places_m, self._distances_of)
            costs = step_costs(tour, start, self._places_m, self._distances_of)
            for k in shorten(costs)[1:]:
                view = tour[k - 1]
                if not self._is_at(view, pose):
                    return view
                # What the robot has before its eyes and does not cover is for another place to cover.
                before = self._views.covered(view.place, (view.yaw - 1) % NUM_YAWS, (view.yaw + 1) % NUM_YAWS)
                self._refused[before[left[before]]] = True
        return None

    def _distances_of(self, place: int) -> Float[np.ndarray, " p"]:
        return self._distances((int(self._cells[place, 0]), int(self._cells[place, 1])), keep=True)

    def _distances(self, cell: tuple[int, int], keep: bool) -> Float[np.ndarray, " p"]:
        return self._ways.distances_m(cell, keep)[tuple(self._cells.T)]

    def _is_at(self, view: View, pose: Pose2) -> bool:
        near = math.dist(self._places_m[view.place], pose.xy_m) < ARRIVED_M
        return near and abs(math.remainder(view.yaw * TURN_STEP_RAD - pose.yaw_rad, math.tau)) < TURN_STEP_RAD


def _places(floor: Floor, ways: Ways) -> np.ndarray:
    """Cells (n, 2) to look from: one in every block of the floor, with as much room as there is."""
    spacing = max(1, round(PLACE_SPACING_M / floor.resolution_m))
    while True:
        cells = spread_places(floor.reachable, spacing, ways.edge_m)
        if len(cells) <= MAX_PLACES:
            return cells
        spacing = math.ceil(1.2 * spacing)
