"""What a robot does that does not know where it is: it turns on the spot until it is found, or gives up."""

import numpy as np

from anm_mj.types import TURN_STEP_RAD, Action, Plan, StopReason

FULL_TURN = round(2.0 * np.pi / TURN_STEP_RAD)
"""Turns of a whole rotation."""
MOST_LOST_STEPS = 3 * FULL_TURN
"""A robot that is lost for longer gives up."""


def look_around(lost_steps: int) -> Plan | None:
    """The next plan of a robot whose pose is not known; None where it is known.

    Args:
        lost_steps: since the pose was known the last time.
    """
    if not lost_steps:
        return None
    nowhere = np.zeros((0, 2))
    if lost_steps > MOST_LOST_STEPS:
        return Plan(
            f"lost for {lost_steps} steps: no place in the map fits what the camera sees", nowhere, stop=StopReason.LOST
        )
    return Plan("lost: looks around until a place in the map fits", nowhere, actions=(Action.TURN_LEFT,) * 6)
