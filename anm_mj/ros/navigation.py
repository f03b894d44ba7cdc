"""Goals for a navigation that is not ours: the topic ``goal_pose``, or the action ``NavigateToPose`` of nav2."""

import secrets
import threading
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from anm_mj.ros.names import MAP
from anm_mj.ros.node import STATE, Node
from anm_mj.ros.services import Client, ServiceKind
from anm_mj.types import Pose2

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


def goal_message(node: Node, goal: Pose2, time_s: float) -> Any:
    """A pose in the map as ``PoseStamped``."""
    make = node.messages
    return make.make(POSE_STAMPED, header=make.header(time_s, MAP), pose=make.base_pose(goal))
