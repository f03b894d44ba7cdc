"""A navigation that is not ours: drives the fake robot straight to goals, by topic or by the action of nav2."""

import math
import threading
import time

import numpy as np

from anm_mj.frames import wrap_angle
from anm_mj.ros import names
from anm_mj.ros.navigation import (
    ABORTED,
    ACTION,
    CANCEL,
    CANCELED,
    GET_RESULT,
    GOAL_TOPIC,
    POSE_STAMPED,
    SEND_GOAL,
    SUCCEEDED,
)
from anm_mj.ros.node import STATE, Node
from anm_mj.ros.services import serve
from anm_mj.types import Pose2
from tests.ros.fake_ros_robot import FakeRosRobot

NEAR_M, NEAR_RAD = 0.1, 0.2
"""It takes less for arrived, as nav2 does."""


class FakeNavigator:
    """Its map is the frame of the odometry."""

    def __init__(self, node: Node, robot: FakeRosRobot, *, action: bool) -> None:
        self.goals: list[Pose2] = []
        self.statuses: list[int] = []
        self.cancelled = 0
        self._node, self._robot = node, robot
        self._goal: Pose2 | None = None
        self._uuid = b""
        self._answers: dict = {}
        self._to = node.publisher(names.COMMAND, names.TWIST)
        if action:
            serve(node, f"{ACTION}/_action/send_goal", SEND_GOAL, self._accept)
            serve(node, f"{ACTION}/_action/get_result", GET_RESULT, self._keep)
            serve(node, f"{ACTION}/_action/cancel_goal", CANCEL, self._cancel)
        else:
            node.subscribe(GOAL_TOPIC, POSE_STAMPED, lambda message, _: self._drive_to(message), STATE)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

        """Once the client has told the type."""

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()

    def _drive_to(self, message) -> None:
        assert message.header.frame_id == "map"
        at, turn = message.pose.position, message.pose.orientation
        self._goal = Pose2(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
        self.goals.append(self._goal)

    def _accept(self, request, answer) -> None:
        self._finish(ABORTED)
        self._uuid = request.goal_id.uuid.tobytes()
        self._drive_to(request.pose)
        answer(accepted=True, stamp=self._node.messages.stamp(time.time()))

    def _keep(self, request, answer) -> None:
        self._answers[request.goal_id.uuid.tobytes()] = answer

    def _cancel(self, request, answer) -> None:
        assert request.goal_id.uuid.tobytes() == self._uuid
        self.cancelled += 1
        self._goal = None
        self._finish(CANCELED)
        answer(return_code=0, goals_canceling=[])

    def _finish(self, status: int) -> None:
        if self._uuid in self._answers:
            self._answers.pop(self._uuid)(status=status)
            self.statuses.append(status)

    def _serve(self) -> None:
        while not self._end.wait(0.05):
            goal, pose = self._goal, self._robot.pose
            forward = turn = 0.0
            if goal is not None:
                left_m = math.dist(goal.xy_m, pose.xy_m)
                towards = math.atan2(goal.y_m - pose.y_m, goal.x_m - pose.x_m) if left_m > NEAR_M else goal.yaw_rad
                error = wrap_angle(towards - pose.yaw_rad)
                turn = float(np.clip(2.0 * error, -1.0, 1.0))
                forward = 0.3 if left_m > NEAR_M and abs(error) < 0.5 else 0.0
                if left_m <= NEAR_M and abs(error) < NEAR_RAD:
                    self._goal, forward, turn = None, 0.0, 0.0
                    self._finish(SUCCEEDED)
            self._to.publish(self._node.messages.twist(forward, turn))
