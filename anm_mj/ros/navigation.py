"""Drives by goals for a navigation that is not ours: the topic ``goal_pose``, or nav2's action ``NavigateToPose``."""

import logging
import math
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, relative_pose, wrap_angle
from anm_mj.loop_state import LoopState
from anm_mj.ros.health import Health
from anm_mj.ros.names import MAP
from anm_mj.ros.node import STATE, Node
from anm_mj.ros.poses import Poses
from anm_mj.ros.services import Client, ServiceKind
from anm_mj.types import ARRIVED_M, FORWARD_STEP_M, TURN_STEP_RAD, Action, Pose2

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
GOAL_TOPIC, ACTION = "goal_pose", "navigate_to_pose"
_NAME = "nav2_msgs/action/NavigateToPose"
_UUID = "unique_identifier_msgs/UUID goal_id\n"
SEND_GOAL = ServiceKind(
    f"{_NAME}_SendGoal",
    f"{_UUID}geometry_msgs/PoseStamped pose\nstring behavior_tree\n",
    "bool accepted\nbuiltin_interfaces/Time stamp\n",
)
GET_RESULT = ServiceKind(f"{_NAME}_GetResult", _UUID, "int8 status\n", reply_bytes=1)
"""Distributions differ in what follows the status."""
CANCEL = ServiceKind(
    "action_msgs/srv/CancelGoal",
    f"{_UUID}builtin_interfaces/Time stamp\n",
    "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
)
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
"""Of ``action_msgs/GoalStatus``."""
_PATIENCE_S = 0.25
_QUARTER_RAD, _AHEAD_M = math.pi / 2, 1.0
"""A turn on the spot, or a forward move without a target, is a goal so far ahead; navigations take less than a step for
arrived, and a robot that has yet to start must not be near it."""
_RESTS_S = 1.0
"""Where nobody says that a goal is reached: a robot near it that has not moved for so long is there [s]."""
_NEAR_M = 0.5
_MOVED_M, _MOVED_RAD = 0.01, 0.02
"""Less is no motion."""
_STUCK_S = 20.0
"""A robot that has not moved for so long on its way is stuck; navigations take their time to recover [s]."""

_logger = logging.getLogger(__name__)


def goal_message(node: Node, goal: Pose2, time_s: float) -> Any:
    """A pose in the map as ``PoseStamped``."""
    make = node.messages
    return make.make(POSE_STAMPED, header=make.header(time_s, MAP), pose=make.base_pose(goal))


class Told(NamedTuple):
    """What the navigation says of the present goal."""

    is_over: bool = False
    reached: bool = False


@runtime_checkable
class Navigation(Protocol):
    """Drives a robot to one goal after another."""

    def send(self, goal: Pose2, time_s: float) -> None:
        """Drive to a pose in the map from now on, wherever the robot is on its way to."""
        ...

    def cancel(self, at: Pose2, time_s: float) -> None:
        """Stop, at this pose in the map."""
        ...

    @property
    def told(self) -> Told:
        """Of the present goal."""
        ...


class GoalTopic:
    """``PoseStamped`` on ``goal_pose``; nobody says when a goal is reached."""

    def __init__(self, node: Node) -> None:
        """Announce the topic."""
        self._node, self._to = node, node.publisher(GOAL_TOPIC, POSE_STAMPED, STATE)

    def send(self, goal: Pose2, time_s: float) -> None:
        """See :class:`Navigation`."""
        self._to.publish(goal_message(self._node, goal, time_s))

    def cancel(self, at: Pose2, time_s: float) -> None:
        """See :class:`Navigation`: the goal is where the robot is."""
        self.send(at, time_s)

    @property
    def told(self) -> Told:
        """Nothing."""
        return Told()


class NavigateAction:
    """The action ``NavigateToPose``, where ROS 2 runs on Cyclone DDS on the other side."""

    def __init__(self, node: Node) -> None:
        """Look for the server."""
        self._node, self._goal = node, b""
        self._told, self._lock = Told(), threading.Lock()
        self._send = Client(node, f"{ACTION}/_action/send_goal", SEND_GOAL)
        self._result = Client(node, f"{ACTION}/_action/get_result", GET_RESULT)
        self._cancel = Client(node, f"{ACTION}/_action/cancel_goal", CANCEL)

    @property
    def is_there(self) -> bool:
        """Whether a server offers the action."""
        return self._send.is_there and self._result.is_there

    def send(self, goal: Pose2, time_s: float) -> None:
        """See :class:`Navigation`; a new goal takes the place of the last one."""
        number = secrets.token_bytes(16)
        with self._lock:
            self._goal, self._told = number, Told()
        accepted = self._about(number, lambda reply: None if reply.accepted else Told(is_over=True))
        self._send.call(
            lambda reply: (accepted(reply), reply.accepted and self._ask(number)),
            goal_id=self._uuid(number),
            pose=goal_message(self._node, goal, time_s),
            behavior_tree="",
        )

    def cancel(self, at: Pose2, time_s: float) -> None:
        """See :class:`Navigation`."""
        with self._lock:
            number, self._goal = self._goal, b""
        if number:
            stamp = self._node.messages.stamp(0.0)
            self._cancel.call(lambda _: None, goal_id=self._uuid(number), stamp=stamp)

    @property
    def told(self) -> Told:
        """See :class:`Navigation`."""
        with self._lock:
            return self._told

    def _ask(self, number: bytes) -> None:
        over = self._about(number, lambda reply: Told(is_over=True, reached=reply.status == SUCCEEDED))
        self._result.call(over, goal_id=self._uuid(number))

    def _about(self, number: bytes, tell: Callable[[Any], Told | None]) -> Callable[[Any], None]:
        """Takes in a reply, if it is about the present goal."""

        def heard(reply: Any) -> None:
            with self._lock:
                if number == self._goal:
                    self._told = tell(reply) or self._told

        return heard

    def _uuid(self, number: bytes) -> Any:
        return self._node.messages.make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(number, np.uint8))


class GoalDriver:
    """One goal for each plan; an action ends once the robot has moved by as much, and the robot drives on."""

    def __init__(self, navigation: Navigation, poses: Poses, health: Health, state: LoopState) -> None:
        """Combine the parts. The robot is stopped while ``health`` knows of a fault; the plan of the loop's ``state``
        names the target.
        """
        self._navigation, self._poses, self._health, self._state = navigation, poses, health, state
        self._serves: object = None
        """What the present goal is for; None = there is no goal."""
        self._odometry = Pose2(0.0, 0.0, 0.0)
        """The last pose that is known."""
        self._meeting: tuple[Pose2, Pose2] = (self._odometry, self._odometry)
        """The same place by the odometry and in the map."""
        self._latest_s = 0.0

    def act(self, action: Action, is_over: Callable[[], bool]) -> bool:
        """Let the robot move by about one action, or stop it to wait; whether it cannot."""
        if action is Action.WAIT:
            self.stop()
            self._poses.wait_newer(self._poses.latest_s, _PATIENCE_S)
            return False
        start = pose = self._last()
        turned, moved_at, since, goes_on = 0.0, start, time.monotonic(), False
        self._send_for(action)
        while not is_over():
            new = self._poses.wait_newer(self._poses.latest_s, _PATIENCE_S)
            if new is None or self._health.present() is not None:
                self.stop()
                since = time.monotonic()
                continue
            if self._serves is None:
                self._send_for(action)
            turned += wrap_angle(new.yaw_rad - pose.yaw_rad)
            self._odometry = pose = new
            if math.dist(pose.xy_m, start.xy_m) >= FORWARD_STEP_M or abs(turned) >= TURN_STEP_RAD:
                return False
            turned_rad = abs(wrap_angle(pose.yaw_rad - moved_at.yaw_rad))
            if math.dist(pose.xy_m, moved_at.xy_m) > _MOVED_M or turned_rad > _MOVED_RAD:
                moved_at, since = pose, time.monotonic()
            told, rests_s = self._navigation.told, time.monotonic() - since
            if told.is_over or (rests_s > _RESTS_S and math.dist(self._in_map().xy_m, self._goal.xy_m) < _NEAR_M):
                has_target, self._serves = not isinstance(self._serves, int), None
                if not (has_target or goes_on) and (told.reached or not told.is_over):
                    # Its goal is reached, and the action wants to go on: one more is far enough for that.
                    self._send_for(action)
                    since, goes_on = time.monotonic(), True
                    continue
                # A navigation stops within its own tolerance; the policy decides from there.
                self._state.follower.drop()
                reached = told.reached or not told.is_over
                stays = math.dist(pose.xy_m, start.xy_m) < _MOVED_M
                return not reached or (stays and action is Action.MOVE_FORWARD)
            if rests_s > _STUCK_S:
                _logger.warning("The robot did not move for %g s towards its goal.", _STUCK_S)
                self.stop()
                return True
        return False

    def stop(self) -> None:
        """Take the goal back, also where nobody knows any more where the robot is."""
        if self._serves is None:
            return
        self._serves = None
        try:
            here, self._latest_s = self._in_map(), self._poses.latest_s
        except RobotError as err:
            _logger.warning("The goal is taken back where the robot was last known to be. %s", err)
            here = self._moved_to(self._odometry)
        self._navigation.cancel(here, self._latest_s)

    def _send_for(self, action: Action) -> None:
        plan, here = self._state.plan, self._in_map()
        target = None if plan is None else plan.target_xy_m
        side = {Action.TURN_LEFT: 1, Action.TURN_RIGHT: -1}.get(action, 0)
        # A robot that drove on while the run decided may be there already: the navigation says so.
        if plan is not None and target is not None and (not side or math.dist(target, here.xy_m) > ARRIVED_M):
            way = target - (plan.path_xy_m[-2] if len(plan.path_xy_m) > 1 else here.xy_m)
            yaw = plan.headings_rad[0] if plan.headings_rad else math.atan2(way[1], way[0])
            serves, goal = plan, Pose2(float(target[0]), float(target[1]), float(yaw))
        else:
            serves, goal = side, move_pose(here, 0.0 if side else _AHEAD_M, side * _QUARTER_RAD)
        if serves is not self._serves or (self._serves is not None and self._navigation.told.is_over):
            self._serves, self._goal, self._latest_s = serves, goal, self._poses.latest_s
            self._navigation.send(goal, self._latest_s)

    def _last(self) -> Pose2:
        self._odometry = self._poses.base(self._poses.latest_s) or self._odometry
        return self._odometry

    def _in_map(self) -> Pose2:
        """Where the robot is in the map: its last estimate there, and what the odometry has measured since."""
        seen = self._state.observation
        then = None if seen is None else self._poses.base(seen.time_s)
        # A long action outlasts what is kept of the odometry.
        if seen is not None and then is not None:
            self._meeting = then, seen.pose
        return self._moved_to(self._last())

    def _moved_to(self, odometry: Pose2) -> Pose2:
        """A pose by the odometry as one in the map."""
        then, origin = self._meeting
        since, c, s = relative_pose(then, odometry), math.cos(origin.yaw_rad), math.sin(origin.yaw_rad)
        x_m, y_m = origin.x_m + c * since.x_m - s * since.y_m, origin.y_m + s * since.x_m + c * since.y_m
        return Pose2(x_m, y_m, wrap_angle(origin.yaw_rad + since.yaw_rad))
