"""Packages that only some commands need, and how to install them."""

import platform
import sys

EXTRAS = {
    "torch": "torch",
    "dm_control": "environments",
    "dm_env": "environments",
    "gymnasium": "environments",
    "stable_baselines3": "learn",
    "rosbags": "ros",
    "cyclonedds": "ros",
    "robot_descriptions": "robots",
    "ray": "ray",
    "imageio_ffmpeg": "video",
    "OpenEXR": "exr",
    "pandas": "pandas",
}
"""The extra of ``anm-mj`` that brings a module which the package itself does without."""


def missing_package(error: ModuleNotFoundError) -> str | None:
    """What to say where a package is not installed: one sentence with the command that installs it. Returns the
    sentence; None where the module belongs to no extra.
    """
    module = (error.name or "").partition(".")[0]
    return install(module) if module in EXTRAS else None


def install(module: str) -> str:
    """The sentence for a module of an extra that is not installed."""
    if module == "cyclonedds" and not _is_wheel_there():
        return (
            "This needs the package cyclonedds, which has no wheel for this Python and processor: build the C library "
            "of Cyclone DDS, let CYCLONEDDS_HOME name its folder, and pip install cyclonedds."
        )
    return f"This needs the package {module}, which is not installed: pip install 'anm-mj[{EXTRAS[module]}]'."


def _is_wheel_there() -> bool:
    """Whether the extra ``ros`` brings Cyclone DDS here: its condition in pyproject.toml."""
    return sys.version_info < (3, 14) and (platform.machine() == "x86_64" or sys.platform == "darwin")
