"""What fails about the motion of a simulated robot: settings, light enough for the command line."""

from __future__ import annotations

from dataclasses import dataclass

from anm_mj.errors import RobotError
from anm_mj.utils.settings import check_settings, setting

MOTION_FAULTS = ("none", "left-wheel", "right-wheel")
"""No fault; the wheels of a side stick."""


@dataclass(frozen=True)
class MotionConfig:
    """A fault of the robot's wheels, to try how a run takes it."""

    fault: str = setting("none", choices=MOTION_FAULTS)
    """What fails, to try how a run takes it: ``none``, or ``left-wheel`` or ``right-wheel``, the wheels of that side
    stick."""
    fault_step: int = setting(40, at_least=0, at_most=1e9)
    """The fault begins with the action after this many steps."""

    def __post_init__(self) -> None:
        """Refuse a fault that there is not.

        Raises:
            RobotError: a choice is unknown, or a number out of range.
        """
        check_settings(self, "motion", RobotError)
