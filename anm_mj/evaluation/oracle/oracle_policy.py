"""The oracle: a policy that knows the scene, as a reference for all others.

It knows the true surface, its observable part, the reachable area and the budget. Before its first step it searches for
a tour that covers as much of the observable surface as it can within the budget
(:mod:`anm_mj.evaluation.oracle.tour_annealing`), also from the poses of finished runs. It drives the tour in the
simulator like every other policy and tracks what the frames cover. At the end of a tour it plans another one through
the residual samples (:mod:`anm_mj.evaluation.oracle.residual_tour`). What it covers is a lower bound on the
most possible; :mod:`anm_mj.evaluation.oracle.upper_bound` estimates an upper one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from anm_mj.errors import PlanError
from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.oracle.discretize import shorter_side, turn
from anm_mj.evaluation.oracle.segments import NO_YAW
from anm_mj.evaluation.oracle.tour_annealing import MEASURES, Stop
from anm_mj.evaluation.oracle.tour_planner import TourPlanner
from anm_mj.evaluation.oracle.warm_start import read_trajectories
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.frames import move_pose
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.protocols import Mapper
from anm_mj.types import OCCUPIED, Action, ExploredState, Observation, Plan, Pose2, StopReason
from anm_mj.utils.settings import setting

AHEAD_M = 0.1
"""Distance of an obstacle from the robot's axis after a collision [m]."""


@dataclass(frozen=True)
class OracleConfig(PolicyConfig):
    """How long the policy searches for tours."""

    rounds: int = 100_000
    """Annealing rounds of the first tour."""
    measure: str = setting("auc", choices=MEASURES)
    """What the first tour makes as large as it can: the area under the coverage curve over the run's budget (``auc``),
    or the coverage at its end (``end``)."""
    warm_start: str = ""
    """Folders of finished runs from whose poses the search also begins, separated as the system separates paths."""


class Oracle:
    """Drives tours that a planner with full knowledge of the scene makes."""

    Config = OracleConfig
    REBUILT = ("_scene", "_planner", "_coverage", "_trajectories")

    def __init__(self, context: PolicyContext[OracleConfig]) -> None:
        """Take the scene's truth in. Raises PlanError if the truth or the observable part of the surface is not known,
        or there is no such part, or a folder holds no run.
        """
        if not isinstance(context.truth, SceneTruth):
            raise PlanError("This policy needs the true scene, and the context does not hold it.")
        if context.truth.surface.observable is None:
            raise PlanError("This policy needs the observable surface; pip install embreex computes it.")
        if not context.truth.surface.observable.any():
            raise PlanError(
                f"This policy finds no surface that the camera covers within {context.truth.camera.range_m:g} m from "
                "where the robot can get to; give another start, or a camera that sees farther."
            )
        self._scene = context.truth
        self._settings = context.settings
        self._trajectories = read_trajectories(context.settings.warm_start)
        self._planner: TourPlanner | None = None
        self._first_pose: Pose2 | None = None
        self._stops = list[Stop]()
        """The rest of the present tour."""
        self._stop: Stop | None = None
        """The stop that the robot is on its way to."""
        self._retried: Stop | None = None
        """The last stop whose path met an obstacle."""
        self._place = 0
        """The place that the robot is at, or nearly so."""
        self._former_m = np.zeros((0, 3))
        """Surface that earlier runs saw [m]."""

    def memory(self) -> dict[str, np.ndarray]:
        """Nothing beside the map."""
        return {}

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Count the surface that an earlier run saw as covered."""
        del prior
        grid = mapper.occupancy_grid()
        self._former_m = (np.argwhere(grid.state == OCCUPIED)[:, ::-1] + 0.5) * grid.resolution_m + grid.origin_m

    def observe(self, observation: Observation) -> None:
        """Track what the frames cover; the first one fixes the headings."""
        if self._planner is None:
            self._start(observation.pose)
        depth_mm = reduce_depth(observation.depth_m)
        self._coverage.add(depth_mm, observation.intrinsics, observation.T_world_camera)

    def _start(self, pose: Pose2) -> None:
        self._first_pose = pose
        self._planner = TourPlanner(
            self._scene, self._settings.rounds, pose, self._settings.measure, self._trajectories
        )
        self._coverage = Coverage(self._planner.samples)
        self._coverage.add_points(self._former_m)

    def get_state(self) -> dict[str, Any] | None:
        """What planner and coverage remember, for a checkpoint; None before the first observation."""
        if self._planner is None:
            return None
        return {"planner": self._planner.get_state(), "coverage": self._coverage.get_state()}

    def set_state(self, state: dict[str, Any] | None) -> None:
        """Take over what :meth:`get_state` gave."""
        if state is None or self._first_pose is None:
            return
        self._start(self._first_pose)
        assert self._planner is not None
        self._planner.set_state(state["planner"])
        self._coverage.set_state(state["coverage"])

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The actions to the next stop of the tour, or the end if nothing is left."""
        del mapper  # The truth needs no map.
        assert self._planner is not None, "observe comes first"
        pose = observation.pose
        left = self._coverage.distance_m >= COVERED_M
        while True:
            while self._stops:
                self._stop = self._stops.pop(0)
                actions = self._actions_to(self._planner, pose, self._stop)
                self._place = self._stop[0]
                if actions:
                    covered = 100.0 * (1.0 - left.mean())
                    reason = f"tour: {covered:.1f} % covered, {len(self._stops)} stops left"
                    return Plan(reason, actions=actions)
            budget = max(self._scene.budget_steps - observation.step, 0)
            self._stops = self._planner.next_tour(pose, left, budget)
            self._place = self._planner.place_at(pose)
            if not self._stops:
                return Plan("nothing left to see", stop=StopReason.COMPLETE)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Avoid the spot ahead and replan; retry the stop once, then skip it."""
        assert self._planner is not None, "observe comes first"
        if action is Action.MOVE_FORWARD:
            self._planner.avoid(move_pose(pose, AHEAD_M, 0.0).xy_m)
        self._place = self._planner.place_at(pose)
        if self._stop is not None and self._stop != self._retried:
            self._stops.insert(0, self._stop)
            self._retried = self._stop

    def _actions_to(self, planner: TourPlanner, pose: Pose2, stop: Stop) -> tuple[Action, ...]:
        """The actions from a pose to a stop."""
        place, towards, side = stop
        yaw = planner.yaw_at(pose)
        actions = list[Action]()
        if place != self._place:
            path = planner.path(pose, self._place, place)
            for heading, moves in zip(path.yaws, path.moves, strict=True):
                actions += _turns(yaw, heading, shorter_side(yaw, heading))
                actions += [Action.MOVE_FORWARD] * moves
                yaw = heading
        if towards != NO_YAW:
            actions += _turns(yaw, towards, side)
        return tuple(actions)


def _turns(a: int, b: int, side: int) -> list[Action]:
    """The turns from one heading to another, to the left (1) or to the right (-1)."""
    return [Action.TURN_LEFT if side > 0 else Action.TURN_RIGHT] * len(turn(a, b, side))
