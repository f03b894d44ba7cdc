"""Converts a plan to discrete actions: forward if the heading error is small, else a turn towards the path."""

import copy
import math

import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import action_motion
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, Plan, Pose2

LOOKAHEAD_M = 0.5
"""Distance of the steering point along the path [m]; a longer one causes fewer small turns."""
CORNER_M = 0.15
"""The robot steers for a corner farther away than this [m]; a point beyond would cut the corner."""
TURN_ABOVE_RAD = 0.55 * TURN_STEP_RAD
"""Heading errors above this cause a turn [rad]: just over half a turn step, so that no turn increases the error."""


class Follower:
    """Executes plans one action at a time."""

    def __init__(self) -> None:
        self._plan: Plan | None = None
        self._steps = 0
        self._leg = 0
        self._headings: list[float] = []

    @property
    def has_fixed_actions(self) -> bool:
        """Whether the present plan names its actions instead of a path."""
        return self._plan is not None and bool(self._plan.actions)

    def start(self, plan: Plan) -> None:
        """Replace the present plan."""
        self._plan = plan
        self._steps = 0
        self._leg = 0
        self._headings = list(plan.headings_rad)

    def drop(self) -> None:
        """Abandon the plan: the next call of ``next_action`` returns None."""
        self._plan = None

    def put_off(self) -> None:
        """The last action was not executed: a fixed one comes next again."""
        if self.has_fixed_actions:
            self._steps -= 1

    def next_action(self, pose: Pose2) -> Action | None:
        """The next action of the plan from a pose; None once the plan is done, outdated or dropped."""
        plan = self._plan
        if plan is None:
            return None
        if plan.actions:
            action = plan.actions[self._steps] if self._steps < len(plan.actions) else None
        elif plan.valid_steps and self._steps >= plan.valid_steps:
            action = None
        else:
            action = self._along_path(pose, plan.path_xy_m) or self._towards_headings(pose)
        self._steps += 1
        if action is None:
            self._plan = None
        return action

    def coming_actions(self, pose: Pose2, count: int) -> list[Action]:
        """What :meth:`next_action` would return one time after another, from this pose and where the actions lead to.

        Nothing changes. Fewer than ``count`` where the plan is done before.
        """
        ahead = copy.copy(self)
        ahead._headings = list(self._headings)
        actions: list[Action] = []
        while len(actions) < count and (action := ahead.next_action(pose)) is not None:
            actions.append(action)
            pose = move_pose(pose, *action_motion(action))
        return actions

    def _along_path(self, pose: Pose2, path_xy_m: Float[np.ndarray, "k 2"]) -> Action | None:
        # Plain numbers: the path is a few points, and NumPy takes several times as long for each.
        path = path_xy_m.tolist()
        if not path or math.dist(path[-1], (pose.x_m, pose.y_m)) < ARRIVED_M:
            self._leg = len(path)
        if self._leg >= len(path):
            return None
        x_m, y_m = self._lookahead_point(pose.x_m, pose.y_m, path)
        error = wrap_angle(math.atan2(y_m - pose.y_m, x_m - pose.x_m) - pose.yaw_rad)
        return _turn(error) or Action.MOVE_FORWARD

    def _lookahead_point(self, x_m: float, y_m: float, path_xy_m: list[list[float]]) -> list[float]:
        """The point ``LOOKAHEAD_M`` along the path from the point nearest to the robot; it never moves backwards."""
        best, best_leg = math.inf, self._leg
        point = path_xy_m[best_leg]
        for leg in range(self._leg, min(self._leg + 3, len(path_xy_m) - 1)):
            nearest = _nearest_on_leg(x_m, y_m, path_xy_m[leg], path_xy_m[leg + 1])
            distance = math.dist(nearest, (x_m, y_m))
            if distance < best - 1e-9:
                best, best_leg, point = distance, leg, nearest
        self._leg = best_leg
        left = LOOKAHEAD_M
        for corner in path_xy_m[best_leg + 1 :]:
            length = math.dist(corner, point)
            if length >= left:
                return _between(point, corner, left / length)
            left -= length
            if LOOKAHEAD_M - left > CORNER_M:
                return corner
            point = corner
        return point

    def _towards_headings(self, pose: Pose2) -> Action | None:
        while self._headings:
            action = _turn(wrap_angle(self._headings[0] - pose.yaw_rad))
            if action is not None:
                return action
            self._headings.pop(0)
        return None


def _nearest_on_leg(x_m: float, y_m: float, start_m: list[float], end_m: list[float]) -> list[float]:
    along_x, along_y = end_m[0] - start_m[0], end_m[1] - start_m[1]
    share = (x_m - start_m[0]) * along_x + (y_m - start_m[1]) * along_y
    share /= max(along_x * along_x + along_y * along_y, 1e-12)
    return _between(start_m, end_m, min(max(share, 0.0), 1.0))


def _between(start_m: list[float], end_m: list[float], share: float) -> list[float]:
    return [start + share * (end - start) for start, end in zip(start_m, end_m, strict=True)]


def _turn(error_rad: float) -> Action | None:
    if abs(error_rad) <= TURN_ABOVE_RAD:
        return None
    return Action.TURN_LEFT if error_rad > 0 else Action.TURN_RIGHT
