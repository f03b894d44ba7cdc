"""Wheel odometry with the errors of a real drive: the odometry motion model."""

import math

import numpy as np

from anm_mj.frames import wrap_angle
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Pose2

_STILL_M = 1e-6
"""A shorter translation has no direction [m]."""
_SHORT_M = 0.01
"""The robot does not turn towards the end of a shorter translation first [m], as in the motion model of nav2_amcl: in a
turn on the spot, wheels that creep or encoders that err move it by less, in any direction."""

_WHOLE, _LEAST = 0.9, 0.03
"""Of an action; a longer motion is one, and a shorter one rather creeps than drives."""


class NoisyOdometry:
    """Adds up what odometry reports between observations, each part with an error of its own.

    A motion is a rotation towards its end, a translation and a rotation to its heading; the variance of each grows with
    the squares of both kinds of motion. Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, table 5.6. The
    squares are those of an action's motion: its parts, where odometry is read more often, add up to the same variance.

    Systematic errors come before that: a wrong radius scales all three, and wheels of unequal radius bend the way.
    Source: Borenstein and Feng, Measurement and Correction of Systematic Odometry Errors in Mobile Robots, IEEE
    Transactions on Robotics and Automation 12(6), 1996.

    Wheels that spin for a moment, where something holds the robot, make single readings worthless.
    """

    def __init__(self, config: SensorConfig, seed: int) -> None:
        scaled = config.scaled()
        self._alpha = scaled.odometry_alpha
        self._scale = 1.0 + scaled.odometry_radius_error
        self._bias_rad_per_m = math.radians(scaled.odometry_yaw_bias_deg_per_m)
        self._slips, self._slip_m = scaled.odometry_slip_share, scaled.odometry_slip_m
        self._slip_rad = math.radians(scaled.odometry_slip_deg)
        is_regular = not any(self._alpha) and self._scale == 1.0 and self._bias_rad_per_m == 0.0
        self._is_exact = is_regular and self._slips == 0.0
        self._seed = seed
        self.restart()

    def restart(self) -> None:
        """Forget the past; the next reading is believed as it is."""
        self._generator = np.random.default_rng([self._seed, 11])
        self._slip_generator = np.random.default_rng([self._seed, 12])
        self._last: Pose2 | None = None
        self._believed: Pose2 | None = None

    def read(self, odometry: Pose2) -> Pose2:
        """Where the robot is believed to stand, from the encoders' pose as it is now."""
        if self._last is None or self._believed is None or self._is_exact:
            self._last = self._believed = odometry
            return odometry
        dx, dy = odometry.x_m - self._last.x_m, odometry.y_m - self._last.y_m
        distance = math.hypot(dx, dy)
        turned = wrap_angle(odometry.yaw_rad - self._last.yaw_rad)
        towards = wrap_angle(math.atan2(dy, dx) - self._last.yaw_rad) if distance > _STILL_M else 0.0
        # A robot that backs up does not turn about for it.
        backwards = abs(towards) > math.pi / 2
        if backwards:
            towards, distance = wrap_angle(towards + math.pi), -distance
        first, aside = (towards, 0.0) if abs(distance) >= _SHORT_M else (0.0, towards)
        second = wrap_angle(turned - first)
        self._last = odometry
        if distance == 0.0 and turned == 0.0:
            return self._believed
        distance *= self._scale
        # An arc's chord points half way between the headings at its ends; backwards the way bends back.
        bend = 0.5 * self._bias_rad_per_m * distance
        first, second = self._scale * first + bend, self._scale * second + bend
        a1, a2, a3, a4 = self._alpha
        noise = self._generator.standard_normal(3)
        part = max(abs(distance) / FORWARD_STEP_M, abs(turned) / TURN_STEP_RAD)
        slip_m, slip_rad = self._slip(part)
        noise *= 1.0 if part > _WHOLE else max(part, _LEAST) ** -0.5
        noisy_first = first + math.sqrt(a1 * first**2 + a2 * distance**2) * noise[0]
        noisy_distance = distance + math.sqrt(a3 * distance**2 + a4 * (first**2 + second**2)) * noise[1]
        noisy_second = second + math.sqrt(a1 * second**2 + a2 * distance**2) * noise[2]
        yaw = self._believed.yaw_rad + noisy_first
        self._believed = Pose2(
            self._believed.x_m + noisy_distance * math.cos(yaw + aside) + slip_m * math.cos(yaw),
            self._believed.y_m + noisy_distance * math.sin(yaw + aside) + slip_m * math.sin(yaw),
            wrap_angle(yaw + noisy_second + slip_rad),
        )
        return self._believed

    def _slip(self, part: float) -> tuple[float, float]:
        """Way [m] and turn [rad] that spinning wheels add to a reading, of a ``part`` of an action."""
        if self._slips == 0.0:
            return 0.0, 0.0
        chance, way, turn = self._slip_generator.random(3)
        if chance >= self._slips * min(part, 1.0):
            return 0.0, 0.0
        return float(2.0 * way - 1.0) * self._slip_m, float(2.0 * turn - 1.0) * self._slip_rad
