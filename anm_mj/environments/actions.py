"""What an agent may do: the discrete actions, with or without STOP, or a velocity."""

from typing import Any

import numpy as np
from dm_env import specs

from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.errors import TaskError
from anm_mj.types import Action, Twist

ACTION_SETS = ("discrete", "velocity")
CONTROL_S = 0.2
"""Time that a velocity holds [s]."""
MOVES = (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT)
MOVES_AND_STOP = (Action.STOP, *MOVES)


def action_spec(actions: str, stop: bool) -> specs.Array:
    """What an environment of one of ``ACTION_SETS`` takes; ``stop``: whether STOP is among the discrete actions."""
    if actions == "velocity":
        return specs.BoundedArray((2,), np.float32, -1.0, 1.0, name="action")
    return specs.DiscreteArray(len(MOVES_AND_STOP if stop else MOVES), name="action")


def read_action(action: Any, actions: str, stop: bool) -> Action | Twist:
    """The discrete action, or the velocity, that an agent's choice stands for. A velocity is given as shares of the
    highest forward speed and turn rate, in [-1, 1]; values beyond are clipped. Raises TaskError for an invalid choice.
    """
    if actions == "velocity":
        return _read_velocity(action)
    allowed = MOVES_AND_STOP if stop else MOVES
    try:
        # A fraction, and a digit as text, are no choice, though int() takes them.
        number = int(action) if int(action) == action else -1
    except (TypeError, ValueError, OverflowError):
        number = -1
    if not 0 <= number < len(allowed):
        choices = ", ".join(f"{k} {choice.name}" for k, choice in enumerate(allowed))
        raise TaskError(f"{action!r} is no action; give one of {choices}.")
    return allowed[number]


def _read_velocity(action: Any) -> Twist:
    try:
        shares = np.asarray(action, np.float64)
    except (TypeError, ValueError):
        shares = np.zeros(0)
    if shares.shape != (2,) or not np.isfinite(shares).all():
        raise TaskError(f"{action!r} is no velocity; give two numbers from -1 to 1: forward, and turn to the left.")
    forward, turn = np.clip(shares, -1.0, 1.0)
    limits = MotionLimits()
    return Twist(float(forward) * limits.forward_mps, float(turn) * limits.turn_radps)
