"""A simulated robot as a ROS 2 robot, in real time or faster: it publishes what it senses and follows ``cmd_vel``."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from anm_mj.control.speed_and_acceleration import clipped, slewed
from anm_mj.errors import ConfigError
from anm_mj.frames import pose_matrix, relative_pose
from anm_mj.ros import names
from anm_mj.ros.node import LATCHED, STATE, Delivery, Node
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import Observation, Twist

PERIOD_S = 0.02
"""Of the motion, the odometry and the clock [simulated s]."""
COMMAND_TIMEOUT_S = 0.5
"""Without a command for so long the robot brakes [simulated s]."""
_HZ, _RATE = (0.1, 50.0), (0.01, 100.0)
_STILL = Twist(0.0, 0.0)
_IMAGES = Delivery(reliable=True, depth=5)
"""Subscribers of both kinds match."""


@dataclass(frozen=True)
class Served:
    """How it went."""

    simulated_s: float
    wall_s: float
    contacts: int
    """Periods in which an obstacle stopped or prevented the motion, each series of them counted once."""
    images: int
    """Pairs of colour and depth."""
    skipped: int
    """Pairs that were left out so that the clock keeps its rate."""

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        return self.simulated_s / max(self.wall_s, 1e-9)


def require_rate(rate: float) -> None:
    """Accept so many simulated or recorded seconds per second. Raises ConfigError if they are out of range."""
    _require_within("--rate", rate, _RATE)


def _require_within(name: str, value: float, limits: tuple[float, float]) -> None:
    low, high = limits
    if not low <= value <= high:
        raise ConfigError(f"{name} is {value:g}; give a number from {low:g} to {high:g}.")


class SimulatedRosRobot:
    """Publishes colour, depth, calibration, odometry, frames, joints, the clock, and the truth on a topic of its own.

    The robot follows ``geometry_msgs/Twist`` and ``TwistStamped`` within its limits of speed and acceleration. Odometry
    begins at zero where the robot stands, as on most robots. Frames: ``odom``, ``base_link``, ``camera_optical_frame``.
    """

    def __init__(self, robot: SimRobot, node: Node, *, image_hz: float = 10.0, rate: float = 1.0) -> None:
        """Announce all topics. ``robot`` knows its pose by odometry alone, from zero on; ``image_hz`` are pairs of
        colour and depth per simulated second, ``rate`` simulated seconds per second. Raises ConfigError if a rate is
        out of range.
        """
        _require_within("--image-hz", image_hz, _HZ)
        require_rate(rate)
        self._robot, self._node, self._rate = robot, node, rate
        self._image_period_s = 1.0 / image_hz
        self._wanted, self._wanted_s, self._now = _STILL, -math.inf, _STILL
        kinds = {
            names.COLOUR: (names.IMAGE, _IMAGES),
            names.DEPTH: (names.IMAGE, _IMAGES),
            names.COLOUR_INFO: (names.CAMERA_INFO, STATE),
            names.DEPTH_INFO: (names.CAMERA_INFO, STATE),
            names.ODOMETRY: (names.ODOMETRY_TYPE, STATE),
            names.TRUTH: (names.ODOMETRY_TYPE, STATE),
            names.JOINTS: (names.JOINT_STATE, STATE),
            names.TF: (names.TF_TYPE, STATE),
            names.TF_STATIC: (names.TF_TYPE, LATCHED),
            names.CLOCK: (names.CLOCK_TYPE, STATE),
        }
        self._to = {topic: node.publisher(topic, kind, delivery) for topic, (kind, delivery) in kinds.items()}
        node.subscribe(names.COMMAND, names.TWIST, lambda message, _: self._command(message))
        node.subscribe(names.COMMAND, names.TWIST_STAMPED, lambda message, _: self._command(message.twist))

    def _command(self, twist: Any) -> None:
        wanted = Twist(float(twist.linear.x), float(twist.angular.z))
        if not (math.isfinite(wanted.forward_mps) and math.isfinite(wanted.turn_radps)):
            raise ValueError(f"a velocity of {wanted.forward_mps} m/s and {wanted.turn_radps} rad/s is left out")
        self._wanted, self._wanted_s = wanted, time.monotonic()

    def serve(self, until: Callable[[], bool], duration_s: float = math.inf) -> Served:
        """Run until a function says so, or for a time [simulated s]."""
        robot, begin = self._robot, time.monotonic()
        first = robot.observe()
        T_base_camera = np.linalg.inv(pose_matrix(first.pose)) @ first.T_world_camera
        mount = (names.BASE, names.CAMERA, T_base_camera)
        self._to[names.TF_STATIC].publish(self._node.messages.transforms(0.0, [mount]))
        contacts = images = skipped = 0
        # A camera whose images come late has taken none before the beginning.
        touched, next_image_s, start_s = False, first.image_age_s, robot.data.time
        while robot.data.time - start_s < duration_s and not until():
            self._now = self._limited()
            before, before_s = robot.pose, robot.data.time
            motion = robot.drive(self._now, PERIOD_S)
            # MuJoCo sets the clock of a simulation that diverges back.
            moved, took_s = relative_pose(before, robot.pose), max(robot.data.time - before_s, PERIOD_S)
            contacts += motion.collided and not touched
            touched = motion.collided
            self._publish_state(Twist(moved.x_m / took_s, moved.yaw_rad / took_s))
            now_s = robot.data.time - start_s
            ahead_s = begin + now_s / self._rate - time.monotonic()
            if now_s >= next_image_s:
                next_image_s += self._image_period_s
                # Late by more than a picture: the clock counts more than the picture.
                if ahead_s * self._rate > -max(self._image_period_s, 2 * PERIOD_S):
                    self._publish_images(robot.observe())
                    images += 1
                else:
                    skipped += 1
                ahead_s = begin + now_s / self._rate - time.monotonic()
            if ahead_s > 0.0:
                time.sleep(ahead_s)
        return Served(robot.data.time - start_s, time.monotonic() - begin, contacts, images, skipped)

    def _limited(self) -> Twist:
        """The velocity of the next period: towards the command as fast as the limits allow."""
        is_late = (time.monotonic() - self._wanted_s) * self._rate > COMMAND_TIMEOUT_S
        limits = self._robot.limits
        wanted = clipped(_STILL if is_late else self._wanted, limits)
        return slewed(self._now, wanted, limits, PERIOD_S)

    def _publish_state(self, moves: Twist) -> None:
        robot, make, now_s = self._robot, self._node.messages, self._robot.data.time
        twist = make.twist(moves.forward_mps, moves.turn_radps)
        odometry = robot.odometry
        self._to[names.CLOCK].publish(make.make(names.CLOCK_TYPE, clock=make.stamp(now_s)))
        self._to[names.ODOMETRY].publish(make.odometry(now_s, names.ODOM, names.BASE, odometry, twist))
        self._to[names.TF].publish(make.transforms(now_s, [make.base_link(names.ODOM, names.BASE, odometry)]))
        self._to[names.TRUTH].publish(make.odometry(now_s, names.WORLD, names.BASE, robot.pose, twist))
        joint_names, positions, velocities = robot.joints()
        joints = make.make(
            names.JOINT_STATE,
            header=make.header(now_s, ""),
            name=joint_names,
            position=positions,
            velocity=velocities,
            effort=np.zeros(0),
        )
        self._to[names.JOINTS].publish(joints)

    def _publish_images(self, seen: Observation) -> None:
        make, now_s = self._node.messages, seen.time_s - seen.image_age_s
        info = make.camera_info(now_s, names.CAMERA, seen.intrinsics)
        self._to[names.COLOUR_INFO].publish(info)
        self._to[names.DEPTH_INFO].publish(info)
        self._to[names.COLOUR].publish(make.image(now_s, names.CAMERA, seen.rgb))
        self._to[names.DEPTH].publish(make.image(now_s, names.CAMERA, seen.depth_m))
