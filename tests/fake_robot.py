"""A robot without a simulator: a point that obeys actions in an analytic world and looks at a wall far away."""

from __future__ import annotations

import numpy as np

from anm_mj.control.action_motion import action_motion
from anm_mj.events import Decided, Observed, Stepped
from anm_mj.frames import move_pose
from anm_mj.types import (
    Action,
    ActionResult,
    Footprint,
    Intrinsics,
    MotionResult,
    Observation,
    Pose2,
    Twist,
    WheelSpeeds,
)
from tests.box_room import camera_pose


class FakeRobot:
    """Moves exactly; a move that would bring it within its radius of a box is refused."""

    footprint = Footprint(0.18, 0.05, 1.35)

    def __init__(self, world, pose):
        self.world = world
        self.pose = pose
        self.steps = 0

    def observe(self) -> Observation:
        T_world_camera = camera_pose(self.pose)
        return Observation(
            self.steps,
            0.1 * self.steps,
            np.zeros((4, 4, 3), np.uint8),
            # Beyond what any map takes in, and never the same twice.
            np.full((4, 4), 30.0 + 1e-3 * self.steps, np.float32),
            Intrinsics.from_fov(4, 4, np.pi / 2),
            T_world_camera,
            self.pose,
        )

    def act(self, action: Action) -> ActionResult:
        self.steps += 1
        moved = move_pose(self.pose, *action_motion(action))
        outside = np.maximum(self.world.boxes[:, :2] - moved.xy_m, moved.xy_m - self.world.boxes[:, 2:])
        collided = action is Action.MOVE_FORWARD and bool(
            (np.linalg.norm(np.maximum(outside, 0), axis=1) < self.footprint.radius_m).any()
        )
        before = self.pose
        if not collided:
            self.pose = moved
        distance = float(np.hypot(self.pose.x_m - before.x_m, self.pose.y_m - before.y_m))
        return ActionResult(action, collided, WheelSpeeds(0.0, 0.0), distance)

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        forward_m, turn_rad = twist.forward_mps * duration_s, twist.turn_radps * duration_s
        self.pose = move_pose(self.pose, forward_m, turn_rad)
        return MotionResult(False, WheelSpeeds(0.0, 0.0), abs(forward_m), abs(turn_rad), duration_s)


class ListRecorder:
    """Keeps everything in memory."""

    def __init__(self):
        self.observations, self.steps, self.plans = [], [], []

    def on_event(self, event):
        if isinstance(event, Observed):
            self.observation(event.observation)
        elif isinstance(event, Decided):
            self.plan(event.step, event.plan)
        elif isinstance(event, Stepped):
            self.step(event.step, event.result, event.observation.pose, event.update, event.stage_ms)

    def observation(self, observation):
        self.observations.append(observation)

    def step(self, step, result, pose: Pose2, update, stage_ms):
        self.steps.append((step, result, pose, stage_ms))

    def plan(self, step, plan):
        self.plans.append((step, plan))
