"""Sends velocities to a live robot: within limits, and none while anything is wrong or in the way."""

import logging
import math
import threading
import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.control.speed_and_acceleration import MotionLimits, clipped, slewed
from anm_mj.errors import RobotError
from anm_mj.frames import pixel_directions
from anm_mj.ros.drive_config import RosConfig
from anm_mj.ros.health import Health
from anm_mj.ros.names import TWIST, TWIST_STAMPED
from anm_mj.ros.node import Node
from anm_mj.types import Intrinsics, Twist

PERIOD_S = 0.02
_AFTER_S = 0.4
"""Zeros are sent for so long after the robot was to stop [s]; then others may drive it."""
_LAST_ZEROS = 5
STILL = Twist(0.0, 0.0)
_REACTION_S = 0.15
"""What a robot drives before a command is effective: images, wire and motors are late by this [s]."""
_POINTS = 5000
"""About so many pixels are looked at for obstacles."""
_LONG_S = 2.0
"""A robot at rest says what is wrong once it has lasted so long [s]: a busy machine hears of nothing for moments."""
_FEWEST = 4
"""Fewer points are noise rather than an obstacle."""

_logger = logging.getLogger(__name__)


def free_way_m(
    depth_m: Float32[np.ndarray, "h w"],
    camera: Intrinsics,
    T_base_camera: Float[np.ndarray, "4 4"],
    half_width_m: float,
    heights_m: tuple[float, float],
) -> float:
    """How far ahead of its axis a robot's way is free, by raw depth [m]; +inf where nothing is seen in it. Depth is
    planar; ``half_width_m`` is that of the way, ``heights_m`` are the lower and the upper end of what meets the robot.
    """
    every = max(1, round(math.sqrt(depth_m.size / _POINTS)))
    depth = depth_m[::every, ::every].astype(float)
    there = np.isfinite(depth)
    points = pixel_directions(camera)[::every, ::every][there] * depth[there][:, None]
    x, y, z = T_base_camera[:3, :3] @ points.T + T_base_camera[:3, 3:]
    low, high = heights_m
    ahead = np.sort(x[(np.abs(y) < half_width_m) & (z > low) & (z < high) & (x > 0.0)])
    return float(ahead[_FEWEST - 1]) if len(ahead) >= _FEWEST else math.inf


def is_way_blocked(way_m: float, forward_mps: float, reach_m: float, config: RosConfig) -> bool:
    """Whether a robot that goes forward at a speed [m/s] must stop for what it would meet, way to rest included.
    ``way_m`` is what :func:`free_way_m` gave; it is to stop within ``reach_m`` anyway [m].
    """
    speed = max(forward_mps, 0.0)
    braking_m = speed * _REACTION_S + speed**2 / (2.0 * config.forward_mps2)
    return way_m < config.radius_m + config.clearance_m + min(braking_m, reach_m)


class Commander:
    """A thread that sends velocities. Close it: the robot is stopped then."""

    def __init__(self, node: Node, config: RosConfig, health: Health, *, dry: bool = False) -> None:
        """Begin with a robot at rest. Nothing is driven while ``health`` knows of a fault, and nothing sent at all if
        it is ``dry``.
        """
        self._node, self._config, self._health, self.dry = node, config, health, dry
        self._limits = MotionLimits(config.forward_mps, config.forward_mps2, config.turn_radps, config.turn_radps2)
        kind = TWIST_STAMPED if config.stamped else TWIST
        self._to = None if dry else node.publisher(config.command, kind)
        self._wanted = self._now = STILL
        self._reach_m = math.inf
        self._active_until_s = 0.0
        self._said: str | None = None
        self._well_s = time.monotonic()
        """When nothing was wrong last [s]."""
        self.stamp_s: Callable[[], float] = time.time
        """The robot's clock, for stamped velocities; one that raises RobotError is a fault."""
        self._stamped_s = 0.0
        self.way_m: Callable[[], float] = lambda: math.inf
        """How far the way ahead of the robot's axis is free [m]."""
        self.is_blocked = False
        """Whether an obstacle ahead keeps the robot from driving forward."""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="commander", daemon=True)
        self._thread.start()

    def drive(self, twist: Twist, reach_m: float = math.inf) -> None:
        """Drive at a velocity until told otherwise, as far as limits, faults and obstacles allow. It will be told to
        stop within ``reach_m``; what lies beyond is not in its way.
        """
        self._wanted, self._reach_m = twist, reach_m
        self._active_until_s = time.monotonic() + _AFTER_S

    def stop(self) -> None:
        """Brake at once."""
        self._wanted = self._now = STILL
        self._send()

    def close(self) -> None:
        """Stop the robot, whatever else fails; a second time does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join(1.0)
        self._wanted = self._now = STILL
        for _ in range(_LAST_ZEROS):
            self._send()
            time.sleep(PERIOD_S)

    def _run(self) -> None:
        while not self._closing.wait(PERIOD_S):
            fault = self._health.present()
            self._say(fault)
            wanted = STILL if fault is not None else self._wanted
            self.is_blocked = wanted.forward_mps > 0.0 and is_way_blocked(
                self.way_m(), self._now.forward_mps, self._reach_m, self._config
            )
            if fault is not None:
                self._now = STILL
            else:
                wanted = clipped(Twist(0.0, wanted.turn_radps) if self.is_blocked else wanted, self._limits)
                self._now = slewed(self._now, wanted, self._limits, PERIOD_S)
            if self._wanted != STILL:
                self._active_until_s = time.monotonic() + _AFTER_S
            if time.monotonic() < self._active_until_s:
                self._send()

    def _say(self, fault: str | None) -> None:
        """Tell why the robot stops, or does not begin to move, and that it goes on."""
        now_s, drives = time.monotonic(), self._wanted != STILL
        if fault is None:
            self._well_s = now_s
        elif self._said is None and (drives or now_s - self._well_s > _LONG_S):
            self._said = fault
            _logger.warning("The robot %s: %s.", "stops" if drives else "waits", fault)
        if fault is None and self._said is not None:
            self._said = None
            _logger.warning("The robot goes on: everything is back.")

    def _send(self) -> None:
        if self._to is None:
            return
        make = self._node.messages
        twist = make.twist(self._now.forward_mps, self._now.turn_radps)
        if self._config.stamped:
            twist = make.make(TWIST_STAMPED, header=make.header(self._stamp_s(), "base_link"), twist=twist)
        self._to.publish(twist)

    def _stamp_s(self) -> float:
        """The robot's clock; where nobody knows it, the last stamp again, because the robot has to be stopped."""
        try:
            self._stamped_s = self.stamp_s()
        except RobotError as err:
            self._health.fault("stamp", str(err).removesuffix("."))
        return self._stamped_s
