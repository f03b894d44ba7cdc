"""What the robot does, and why it stops."""

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum

FORWARD_STEP_M = 0.065
"""Length of one forward step [m] (paper, section V-A)."""
TURN_STEP_RAD = math.radians(10.0)
"""Angle of one turn [rad] (paper, section V-A)."""
ARRIVED_M = 1.5 * FORWARD_STEP_M
"""The robot has reached a place that is nearer than this [m]."""
NEAR_TARGET_M = 2 * ARRIVED_M
"""From nearer than this the robot sees what it came to a target for, even where its path ended early [m]."""


class Action(IntEnum):
    """One discrete action; every one but STOP costs one step of the budget. WAIT lasts as long as a turn."""

    STOP = 0
    MOVE_FORWARD = 1
    TURN_LEFT = 2
    TURN_RIGHT = 3
    WAIT = 4


class StopReason(StrEnum):
    """Why a run ended."""

    COMPLETE = "COMPLETE"
    """Nothing reachable is worth another step."""
    BUDGET = "BUDGET"
    """The budget of steps was spent."""
    NO_REACHABLE_TARGET = "NO_REACHABLE_TARGET"
    """Something is unexplored, but no path leads to it."""
    RETURNED = "RETURNED"
    """The robot is back at its start, because the budget allowed no more than the return."""
    STUCK = "STUCK"
    """The robot collided twelve times on its path without a free step in between."""
    SENSOR_FAULT = "SENSOR_FAULT"
    """The camera stopped measuring: no depth, or the same image again and again."""
    POLICY_ERROR = "POLICY_ERROR"
    """The policy failed, or returned a plan that cannot be executed."""
    MAP_ERROR = "MAP_ERROR"
    """The map could not be trained any further: its loss was not finite again and again."""
    TOPPLED = "TOPPLED"
    """The robot fell over."""
    NO_TRACTION = "NO_TRACTION"
    """The robot did not go where its wheels drove it, again and again, although nothing was in the way."""
    WHEEL_STUCK = "WHEEL_STUCK"
    """A wheel did not turn although it was driven, again and again."""
    DIVERGED = "DIVERGED"
    """The simulation of the robot became unstable."""
    LOST = "LOST"
    """The robot did not know where it was, and no place in its map fitted what it saw."""
    INTERRUPTED = "INTERRUPTED"
    """A person ended the run."""


@dataclass(frozen=True)
class WheelSpeeds:
    """Angular velocities of the two driven wheels, positive when rolling forward."""

    left_radps: float
    right_radps: float


@dataclass(frozen=True)
class Twist:
    """A velocity of the base, in its own axes."""

    forward_mps: float
    turn_radps: float
    """Counter-clockwise."""


@dataclass(frozen=True)
class MotionResult:
    """The outcome of a motion other than a discrete action."""

    collided: bool
    """True when an obstacle prevented or stopped it."""
    wheel_speeds: WheelSpeeds
    """Mean wheel speeds over the motion [rad/s]."""
    moved_m: float
    """Length of the path of the base [m]."""
    turned_rad: float
    """Sum of all turns, to either side [rad]."""
    duration_s: float
    """Duration [s]."""
    fault: StopReason | None = None
    """Why the robot can drive no more, such as TOPPLED; None while it can."""

    @property
    def equivalent_steps(self) -> float:
        """Its cost as a number of discrete actions: its path in forward steps plus its turns in turn steps."""
        return self.moved_m / FORWARD_STEP_M + self.turned_rad / TURN_STEP_RAD


@dataclass(frozen=True)
class ActionResult:
    """The outcome of one action."""

    action: Action
    collided: bool
    """True when an obstacle prevented or stopped the move."""
    wheel_speeds: WheelSpeeds
    """Mean wheel speeds over the action [rad/s]."""
    moved_m: float
    """Distance the base moved [m]."""
    fault: StopReason | None = None
    """Why the robot can drive no more, such as TOPPLED; None while it can."""
    met_person: bool = False
    """Whether the obstacle was a person."""
