"""Settings of the exploration task."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from anm_mj.config import DRIVES
from anm_mj.errors import TaskError
from anm_mj.sim.sensors.presets import SENSORS
from anm_mj.types import FORWARD_STEP_M

REACH_M = 1000.0
"""Largest distance from the start within an episode [m]; bounds the observed position in every scene."""
MAX_STEPS = int(REACH_M / (FORWARD_STEP_M + 0.001))
"""Longest episode [steps]; the physics drive may overshoot a step by a millimetre."""


@dataclasses.dataclass(frozen=True)
class ExploreConfig:
    """Settings of an episode of exploration, apart from the scene."""

    num_steps: int | None = None
    """Steps until truncation; None = the scene's budget, or the default for its number of rooms."""
    start: tuple[float, float, float] | None = None
    """Start pose x [m], y [m], yaw [deg] of every episode; None = a random reachable pose per episode."""
    drive: str = "kinematic"
    """Execution of actions: ``kinematic`` (exact) or ``physics`` (wheel torque and contact)."""
    image_px: int = 128
    """Width and height of the camera's images [px]. From 128 on the reward equals the evaluation's measure; fewer
    pixels cover slightly less."""
    sensor: str = "exact"
    """Name of the sensor whose errors the observations have; the reward counts what it truly saw."""
    topdown: bool = False
    """Whether the observation includes an occupancy map around the robot."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TaskError: an unknown drive, or a number out of range.
        """
        if self.num_steps is not None and not 1 <= self.num_steps <= MAX_STEPS:
            raise TaskError(f"num_steps is {self.num_steps}; an episode has 1 to {MAX_STEPS} steps.")
        if self.drive not in DRIVES:
            raise TaskError(f'There is no drive "{self.drive}"; choose one of {", ".join(DRIVES)}.')
        if not 16 <= self.image_px <= 2048:
            raise TaskError(f"image_px is {self.image_px}; it must lie between 16 and 2048.")
        if self.sensor not in SENSORS:
            raise TaskError(f"There is no sensor '{self.sensor}'; choose one of {', '.join(SENSORS)}.")


def explore_config(**options: Any) -> ExploreConfig:
    """A configuration from keyword options.

    Raises:
        TaskError: an unknown option, an invalid start, or a value out of range.
    """
    known = [field.name for field in dataclasses.fields(ExploreConfig)]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise TaskError(f'The task has no option "{unknown[0]}"; it has {", ".join(known)}.')
    if options.get("start") is not None:
        require_start(options["start"])
    return ExploreConfig(**options)


def require_start(start: Any) -> None:
    """Check that a start is three finite numbers.

    Raises:
        TaskError: if it is not.
    """
    try:
        good = len(start) == 3 and all(math.isfinite(value) for value in start)
    except TypeError:
        good = False
    if not good:
        raise TaskError(f"The start {start!r} is no pose; give three numbers: x [m], y [m], yaw [deg].")
