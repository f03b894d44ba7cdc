"""Sends velocities to a live robot: within limits, and none while anything is wrong or in the way."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable

import numpy as np

from anm_mj.ros.blocked_way import is_way_blocked
from anm_mj.ros.drive_config import RosConfig
from anm_mj.ros.health import Health
from anm_mj.ros.names import TWIST, TWIST_STAMPED
from anm_mj.ros.node import Node
from anm_mj.types import Twist

PERIOD_S = 0.02
_AFTER_S = 0.4
"""Zeros are sent for so long after the robot was to stop [s]; then others may drive it."""
_LAST_ZEROS = 5
STILL = Twist(0.0, 0.0)

_logger = logging.getLogger(__name__)


class Commander:
    """A thread that sends velocities. Close it, or use it in a ``with`` statement: the robot is stopped then."""

    def __init__(self, node: Node, config: RosConfig, health: Health, *, dry: bool = False) -> None:
        """Begin with a robot at rest. Nothing is driven while ``health`` knows of a fault, and nothing sent at all if
        it is ``dry``.
        """
        self._node, self._config, self._health, self.dry = node, config, health, dry
        kind = TWIST_STAMPED if config.stamped else TWIST
        self._to = None if dry else node.publisher(config.command, kind)
        self._wanted = self._now = STILL
        self._reach_m = math.inf
        self._active_until_s = 0.0
        self._said: str | None = None
        self.stamp_s: Callable[[], float] = time.time
        """The robot's clock, for stamped velocities."""
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

    def __enter__(self) -> Commander:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

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
                self._now = self._limited(Twist(0.0, wanted.turn_radps) if self.is_blocked else wanted)
            if self._wanted != STILL:
                self._active_until_s = time.monotonic() + _AFTER_S
            if time.monotonic() < self._active_until_s:
                self._send()

    def _say(self, fault: str | None) -> None:
        """Tell why the robot stops, and that it goes on."""
        if fault is not None and self._said is None and self._wanted != STILL:
            self._said = fault
            _logger.warning("The robot stops: %s.", fault)
        elif fault is None and self._said is not None:
            self._said = None
            _logger.warning("The robot goes on: everything is back.")

    def _limited(self, wanted: Twist) -> Twist:
        config, now = self._config, self._now
        most, most_turn = config.forward_mps2 * PERIOD_S, config.turn_radps2 * PERIOD_S
        forward = float(np.clip(wanted.forward_mps, -config.forward_mps, config.forward_mps))
        turn = float(np.clip(wanted.turn_radps, -config.turn_radps, config.turn_radps))
        return Twist(
            now.forward_mps + float(np.clip(forward - now.forward_mps, -most, most)),
            now.turn_radps + float(np.clip(turn - now.turn_radps, -most_turn, most_turn)),
        )

    def _send(self) -> None:
        if self._to is None:
            return
        make = self._node.messages
        twist = make.twist(self._now.forward_mps, self._now.turn_radps)
        if self._config.stamped:
            twist = make.make(TWIST_STAMPED, header=make.header(self.stamp_s(), "base_link"), twist=twist)
        self._to.publish(twist)
