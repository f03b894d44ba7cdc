"""Settings of the exploration task."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from anm_mj.config import DRIVES
from anm_mj.errors import TaskError
from anm_mj.types import FORWARD_STEP_M

REACH_M = 1000.0
"""No robot gets farther from its start than this in an episode [m]; bounds the observed position in every scene."""
MAX_STEPS = int(REACH_M / (FORWARD_STEP_M + 0.001))
"""Longest episode [steps]; a millimetre is what the physics drive may overshoot a step by."""


@dataclasses.dataclass(frozen=True)
class ExploreConfig:
    """What an episode of exploration is like, apart from the scene."""

    num_steps: int | None = None
    """Steps until the episode is cut off; None = the scene's own budget, or that of its number of rooms."""
    start: tuple[float, float, float] | None = None
    """Start pose x [m], y [m], yaw [deg] of every episode; None = drawn anew for each from where the robot can go."""
    drive: str = "kinematic"
    """How actions are executed: ``kinematic`` (exactly) or ``physics`` (wheel torque and contact)."""
    image_px: int = 128
    """Width and height of the camera's pictures [px]. From 128 on the reward is that of the evaluation; fewer pixels
    hit a little less."""
    topdown: bool = False
    """Whether a map of what has been seen, from above, is part of the observation."""

    def __post_init__(self) -> None:
        """Refuse what no episode can be like.

        Raises:
            TaskError: a choice is unknown or a number out of range.
        """
        if self.num_steps is not None and not 1 <= self.num_steps <= MAX_STEPS:
            raise TaskError(f"num_steps is {self.num_steps}; an episode has 1 to {MAX_STEPS} steps.")
        if self.drive not in DRIVES:
            raise TaskError(f'There is no drive "{self.drive}"; choose one of {", ".join(DRIVES)}.')
        if not 16 <= self.image_px <= 2048:
            raise TaskError(f"image_px is {self.image_px}; it must lie between 16 and 2048.")


def explore_config(**options: Any) -> ExploreConfig:
    """The configuration with these fields.

    Raises:
        TaskError: there is no such field, the start is no pose, or a value is out of range.
    """
    known = [field.name for field in dataclasses.fields(ExploreConfig)]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise TaskError(f'The task has no option "{unknown[0]}"; it has {", ".join(known)}.')
    if options.get("start") is not None:
        require_start(options["start"])
    return ExploreConfig(**options)


def require_start(start: Any) -> None:
    """Accept three finite numbers.

    Raises:
        TaskError: if it is anything else.
    """
    try:
        good = len(start) == 3 and all(math.isfinite(value) for value in start)
    except TypeError:
        good = False
    if not good:
        raise TaskError(f"The start {start!r} is no pose; give three numbers: x [m], y [m], yaw [deg].")
