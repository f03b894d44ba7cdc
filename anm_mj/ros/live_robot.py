"""A robot that speaks ROS 2: implements :class:`anm_mj.protocols.Robot` by its images, its odometry and velocities."""

import logging
import math
import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.control.action_motion import action_motion
from anm_mj.errors import RobotError
from anm_mj.frames import back_project, move_pose, pose_matrix, relative_pose, wrap_angle
from anm_mj.ros.camera_mount import require_view_ahead, turned, turned_pose, turns_to_upright
from anm_mj.ros.commander import PERIOD_S, STILL, Commander, free_way_m
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.health import Health
from anm_mj.ros.navigation import GoalDriver
from anm_mj.ros.poses import Poses
from anm_mj.ros.rgbd_intake import Rgbd, RgbdIntake
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

_NO_WHEELS = WheelSpeeds(0.0, 0.0)
_LATE_S = 0.06
"""The robot drives so long after the velocity that was commanded last [s]."""
_CREEP_MPS, _CREEP_RADPS = 0.02, 0.08
"""The slowest that a robot is driven."""
_COAST = {Action.MOVE_FORWARD: 0.001, Action.TURN_LEFT: 0.003, Action.TURN_RIGHT: 0.003}
"""How far a robot is taken to move on after it is told to stop, at first [m, rad]."""
_LEARN = 0.3
"""The share of an action's error by which that is corrected, so that errors have the mean 0."""
_STRAIGHTEN, _AHEAD_M = 3.0, 0.3
"""Turn rate per heading error on the way [1/s]; the robot heads for a point so far ahead on its line."""
_SIDE = {Action.TURN_LEFT: 1.0, Action.TURN_RIGHT: -1.0}
_STRAY_M, _STRAY_RAD = 0.03, math.radians(4.0)
"""A robot that rests farther from where its last action was to end begins the next one where it is."""
_MOVED_M, _MOVED_RAD = 0.001, 0.003
"""Less in ``stall_s`` is no motion."""
_REST_M, _REST_RAD, _REST_POSES = 5e-4, 1e-3, 3
"""A robot whose poses differ by less for so many of them is at rest."""
_PATIENCE_S = 0.25
"""So long a wait for images or poses lasts before it looks whether the run is to end [s]."""
_BELOW_M, _BELOW_SHARE = 0.15, 0.2
"""More of the first image so far below the floor contradicts the frames or the depth."""
_DRY_S = 1.0
"""A run that only shows looks again after this time [s]."""
_OF_THE_MOMENT = ("_rest_s", "_last", "_way", "_aim", "_coast", "_turns", "_looks_ahead")

_logger = logging.getLogger(__name__)


class LiveRobot:
    """A robot over the wire. It drives only while images, poses and clock are as they should be."""

    REBUILT = ("_intake", "_poses", "_commander", "_health", "_config", "is_over", "goals", *_OF_THE_MOMENT)

    def __init__(
        self, intake: RgbdIntake, poses: Poses, commander: Commander, health: Health, config: DriveConfig
    ) -> None:
        """Combine the parts."""
        self._intake, self._poses, self._commander, self._health = intake, poses, commander, health
        self._config = config
        self.step = 0
        """Number of executed actions, without STOP."""
        self.is_over: Callable[[], bool] = lambda: False
        """Whether the run is to end, for waits that have no end of their own."""
        self.goals: GoalDriver | None = None
        """Drives the robot in place of velocities."""
        self._rest_s = -math.inf
        self._last = Pose2(0.0, 0.0, 0.0)
        self._aim: Pose2 | None = None
        """Where the last action was to end, by the odometry: errors of actions do not add up. None = where it did."""
        self._coast = dict(_COAST)
        self._way: tuple[float, float] = (-math.inf, math.inf)
        """When the way ahead was seen last, and how far it is free then [s, m]."""
        self._turns: int | None = None
        """Turns that make images upright, the same for the whole run; None before the first one."""
        self._looks_ahead = False
        """Whether the camera is known to look ahead."""
        commander.way_m, commander.stamp_s = (lambda: self._way[1]), (lambda: poses.latest_s)
        intake.on_depth = self._see_way

    @property
    def footprint(self) -> Footprint:
        """The cylinder that must stay clear of obstacles."""
        return self._config.ros.footprint

    def get_state(self) -> int | None:
        """How images are turned, for checkpoints: a run keeps its camera."""
        return self._turns

    def set_state(self, turns: int | None) -> None:
        """Take over what :meth:`get_state` gave; checkpoints from before images were turned have none."""
        self._turns = int(turns or 0) % 4

    def observe(self) -> Observation:
        """The first view since the robot came to rest, turned upright; the last one again if the run is to end before
        that. Raises RobotError if there was none, the first view contradicts the frames, or its camera does not look
        ahead.
        """
        while True:
            # A clock that was set back makes the time of rest one to come.
            seen = self._intake.wait_newer(min(self._rest_s, self._poses.latest_s), _PATIENCE_S)
            found = None if seen is None else self._posed(seen)
            if found is not None:
                break
            if self.is_over():
                # No fault of the camera, and no end without the results: the last view is seen again.
                seen = self._intake.wait_newer(-math.inf, 0.0)
                found = None if seen is None or self.step == 0 else self._posed(seen)
                if found is None:
                    raise RobotError("The run was ended while it waited for an image.")
                return found
            if self._health.present() is not None:
                self.rest()
            if seen is not None:
                time.sleep(PERIOD_S)  # Its pose is still on its way.
        if self.step == 0:
            _require_floor(found, self._intake.depth)
        return found

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end, by the poses of the odometry; an obstacle ahead or a stall ends it."""
        if action is Action.STOP:
            self.rest()
            return ActionResult(action, False, _NO_WHEELS, 0.0)
        start, arrived = self._pose(), True
        if self.goals is not None:
            # It drives on while the run looks and decides.
            collided, self._rest_s = self.goals.act(action, self.is_over), self._poses.latest_s
            self.step += 1
            return ActionResult(action, collided, _NO_WHEELS, math.dist(start.xy_m, self._pose().xy_m))
        if self._config.dry:
            time.sleep(_DRY_S)
        elif action is not Action.WAIT:
            begin = self._aim if self._aim is not None and _is_near(self._aim, start) else start
            aim = move_pose(begin, *action_motion(action))
            arrived = self._drive_to(aim, start, action)
            self._aim = aim if arrived else None
        self.step += 1
        end = self._come_to_rest()
        self._learn(action, end)
        return ActionResult(action, not arrived and not self.is_over(), _NO_WHEELS, math.dist(start.xy_m, end.xy_m))

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Drive at a velocity for a time [s], and stop."""
        start, begin = self._pose(), time.monotonic()
        while time.monotonic() - begin < duration_s and not self._commander.is_blocked:
            self._commander.drive(twist)
            time.sleep(PERIOD_S)
        collided, end, self._aim = self._commander.is_blocked, self._come_to_rest(), None
        turned = abs(wrap_angle(end.yaw_rad - start.yaw_rad))
        took_s = time.monotonic() - begin
        return MotionResult(collided, _NO_WHEELS, math.dist(start.xy_m, end.xy_m), turned, took_s)

    def rest(self) -> None:
        """Stop the robot until the next action, where a goal lets it drive on between two of them."""
        if self.goals is not None:
            self.goals.stop()

    def close(self) -> None:
        """Stop the robot."""
        self.rest()
        self._commander.close()

    def _drive_to(self, aim: Pose2, start: Pose2, action: Action) -> bool:
        """Drive by feedback until the robot is to stop; False where something is in the way."""
        limits, forward = self._config.ros, action is Action.MOVE_FORWARD
        moved_at, since = start, time.monotonic()
        speed = rate = 0.0
        while not self.is_over():
            pose = self._poses.wait_newer(self._poses.latest_s, _PATIENCE_S)
            if pose is None or self._health.present() is not None:
                # The commander has stopped the robot; it goes on from wherever it stands.
                since = time.monotonic()
                continue
            left = _left(aim, pose, action)
            if left < self._coast[action]:
                return True
            if self._commander.is_blocked:
                return False
            turned = abs(wrap_angle(pose.yaw_rad - moved_at.yaw_rad))
            if math.dist(pose.xy_m, moved_at.xy_m) > _MOVED_M or turned > _MOVED_RAD:
                moved_at, since = pose, time.monotonic()
            elif time.monotonic() - since > limits.stall_s:
                _logger.warning("The robot did not move for %g s although it was driven.", limits.stall_s)
                return False
            if forward:
                speed = _profile(left - speed * _LATE_S, limits.forward_mps2, _CREEP_MPS, limits.forward_mps)
                aside_m = relative_pose(aim, pose).y_m
                rate = -_STRAIGHTEN * (wrap_angle(pose.yaw_rad - aim.yaw_rad) + aside_m / _AHEAD_M)
            else:
                ahead_rad = left - abs(rate) * _LATE_S
                rate = _SIDE[action] * _profile(ahead_rad, limits.turn_radps2, _CREEP_RADPS, limits.turn_radps)
            self._commander.drive(Twist(speed, rate), left if forward else math.inf)
        return False

    def _learn(self, action: Action, end: Pose2) -> None:
        """Let the next action of this kind end nearer to where it is to."""
        if self._aim is not None and action is not Action.WAIT and _is_near(self._aim, end):
            most = _LEARN * _COAST[action]
            self._coast[action] -= float(np.clip(_LEARN * _left(self._aim, end, action), -most, most))

    def _come_to_rest(self) -> Pose2:
        """Stop, and wait until the robot stands."""
        self._commander.drive(STILL)
        self._commander.stop()
        pose, still = self._pose(), 0
        while still < _REST_POSES and not self.is_over():
            new = self._poses.wait_newer(self._poses.latest_s, _PATIENCE_S)
            if new is None:
                continue
            near = math.dist(new.xy_m, pose.xy_m) < _REST_M
            near &= abs(wrap_angle(new.yaw_rad - pose.yaw_rad)) < _REST_RAD
            still, pose = still + 1 if near or self._config.dry else 0, new
        self._rest_s = self._poses.latest_s
        return pose

    def _pose(self) -> Pose2:
        """The last pose that is known."""
        self._last = self._poses.base(self._poses.latest_s) or self._last
        return self._last

    def _posed(self, seen: Rgbd) -> Observation | None:
        """An image with its pose; None while that is not known."""
        if self.goals is not None:
            # It drives on: the last pose from before the image is not that of the image.
            self._poses.wait_newer(math.nextafter(seen.time_s, -math.inf), _PATIENCE_S)
        pose, T_base_camera = self._poses.base(seen.time_s), self._poses.camera(seen.frame, seen.time_s)
        if pose is None or T_base_camera is None:
            return None
        seen, T_base_camera = self._upright(seen, T_base_camera)
        return Observation(
            step=self.step,
            time_s=seen.time_s,
            rgb=seen.rgb,
            depth_m=seen.depth_m,
            intrinsics=seen.intrinsics,
            T_world_camera=pose_matrix(pose) @ T_base_camera,
            pose=pose,
            range_m=self._config.ros.max_range_m or math.inf,
        )

    def _upright(self, seen: Rgbd, T_base_camera: Float[np.ndarray, "4 4"]) -> tuple[Rgbd, Float[np.ndarray, "4 4"]]:
        """An image and its camera as nearly upright as quarter turns make them. Raises RobotError if the first one's
        camera does not look ahead.
        """
        if not self._looks_ahead:
            require_view_ahead(T_base_camera, seen.frame, self._poses.base_frame)
            self._looks_ahead = True
        if self._turns is None:
            self._turns = turns_to_upright(T_base_camera)
        return turned(seen, self._turns), turned_pose(T_base_camera, self._turns)

    def _see_way(self, time_s: float, depth_m: Float32[np.ndarray, "h w"], camera: Intrinsics, frame: str) -> None:
        ros = self._config.ros
        T_base_camera: Float[np.ndarray, "4 4"] | None = self._poses.camera(frame, time_s)
        if T_base_camera is None:
            base = self._poses.base_frame
            self._health.fault(frame, f"the frames on tf do not say where '{frame}' is on '{base}' at this time")
            return
        heights = ros.low_m, ros.height_m
        self._way = time_s, free_way_m(depth_m, camera, T_base_camera, ros.radius_m, heights)


def _is_near(aim: Pose2, pose: Pose2) -> bool:
    return math.dist(aim.xy_m, pose.xy_m) < _STRAY_M and abs(wrap_angle(aim.yaw_rad - pose.yaw_rad)) < _STRAY_RAD


def _left(aim: Pose2, pose: Pose2, action: Action) -> float:
    """What an action has still to do, forward [m] or by its turn [rad]; negative beyond its end."""
    if action is Action.MOVE_FORWARD:
        return -relative_pose(aim, pose).x_m
    return _SIDE[action] * wrap_angle(aim.yaw_rad - pose.yaw_rad)


def _profile(left: float, acceleration: float, slowest: float, fastest: float) -> float:
    """The speed from which a robot can brake within what is left, both in metres or both in radians."""
    return min(max(math.sqrt(2.0 * acceleration * max(left, 0.0)), slowest), fastest)


def _require_floor(seen: Observation, topic: str) -> None:
    """Raises RobotError where much of the first image lies below the floor."""
    points = back_project(seen.depth_m, seen.intrinsics, seen.T_world_camera)
    below = float(np.mean(points[:, 2] < -_BELOW_M)) if len(points) else 0.0
    if below > _BELOW_SHARE:
        raise RobotError(
            f"{below:.0%} of the first image on {topic} lies more than {_BELOW_M:g} m below the floor, which is at the "
            "height of the base frame: check the pose of the camera on tf_static, ros.base_frame and ros.depth_unit_m."
        )
