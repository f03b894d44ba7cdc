"""The times of a run as those of a clock on the wall, which players and other recordings have."""

import dataclasses
from datetime import UTC, datetime

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import Run

LATEST_S = 2.0**31
"""ROS counts the seconds of a stamp in 32 bits [s since 1970]."""
_LONG_S = 1e8
"""A run that begins later than this by its own times has them from such a clock [s]."""


def on_wall_clock(run: Run, start_s: float | None) -> Run:
    """A run with times since 1970, which that of a live robot has already. ``start_s`` is when it began [s since 1970],
    None = as it says. Raises RunFolderError if ROS has no stamps for these times.
    """
    first_s = run.frames[0].time_s
    on_it = first_s > _LONG_S
    if start_s is None:
        start_s = first_s if on_it else began_s(run)
    shift_s = start_s - (first_s if on_it else 0.0)
    frames = tuple(dataclasses.replace(frame, time_s=frame.time_s + shift_s) for frame in run.frames)
    if not (frames[0].time_s >= 0.0 and frames[-1].time_s < LATEST_S):
        raise RunFolderError(f"The run would begin at {frames[0].time_s:g} s; give a --start from 1970 to 2037, or 0.")
    return dataclasses.replace(run, frames=frames)


def began_s(run: Run) -> float:
    """When a run began [s since 1970]: by its manifest, and where an older one does not say it, by its first file."""
    try:
        return datetime.fromisoformat(run.manifest["started"]).timestamp()
    except (KeyError, TypeError, ValueError):
        return run.folder.camera.stat().st_mtime


def parse_start(text: str) -> float:
    """Seconds since 1970 of a date and time in ISO 8601, UTC unless it names a zone, or of such a number. Raises
    ValueError if it is neither.
    """
    try:
        return float(text)
    except ValueError:
        at = datetime.fromisoformat(text)
        return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
