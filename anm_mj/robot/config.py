"""Settings of the robot and the location of its MJCF; loads no simulator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from anm_mj.errors import RobotError
from anm_mj.utils.package_data import data_folder

MODELS = data_folder("models")
"""One folder per builtin robot."""
DEFAULT_ROBOT = "diff_drive"


@dataclass(frozen=True)
class RobotConfig:
    """Names of the robot's parts in its MJCF, where they differ from the usual ones, and the noise of its encoders."""

    left_wheel: str = ""
    """Name of the left wheel's hinge; empty = one of the usual names (``wheel_left``, ``left_wheel``, …)."""
    right_wheel: str = ""
    """Name of the right wheel's hinge; empty = one of the usual names."""
    camera: str = ""
    """Name of the camera; empty = ``camera``, or the only one in the file."""
    wheel_noise: float = 0.0
    """Standard deviation of a wheel's measured rotation after one radian [rad]; it grows with the square root of the
    rotation and affects wheel odometry only. 0.02 causes about 2 degrees of drift in a hundred actions."""

    def __post_init__(self) -> None:
        """Check the noise.

        Raises:
            RobotError: the noise is not within [0, 0.5].
        """
        if not 0.0 <= self.wheel_noise <= 0.5:
            raise RobotError(f"model.wheel_noise is {self.wheel_noise}; it must lie within 0 and 0.5.")


def robot_path(name_or_file: str) -> Path:
    """The MJCF file of a builtin robot, by its name, or of the user's robot, by its path.

    Raises:
        RobotError: if neither exists.
    """
    builtin = MODELS / name_or_file / f"{name_or_file}.xml"
    if Path(name_or_file).name == name_or_file and builtin.is_file():
        return builtin
    path = Path(name_or_file)
    if not path.is_file():
        known = ", ".join(sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir()))
        raise RobotError(f"There is no robot file {name_or_file}; give an MJCF file or a builtin name: {known}.")
    return path
