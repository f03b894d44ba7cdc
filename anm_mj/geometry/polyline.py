"""Paths as polylines: shortcuts, and legs along the headings of a robot that turns by whole steps."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from anm_mj.frames import wrap_angle
from anm_mj.types import TURN_STEP_RAD

NUM_HEADINGS = round(math.tau / TURN_STEP_RAD)
"""Headings of a robot that turns by whole steps."""


def shortcut(
    points_m: Float[np.ndarray, "k 2"],
    are_clear: Callable[[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]], Bool[np.ndarray, " n"]],
) -> Float[np.ndarray, "j 2"]:
    """A polyline [m] without the corners that a clear straight segment can skip (greedy, farthest first).

    ``are_clear`` says whether segments are clear, given their starts and ends [m].
    """
    kept = [0]
    while kept[-1] < len(points_m) - 1:
        ahead = np.arange(kept[-1] + 1, len(points_m))
        clear = are_clear(np.broadcast_to(points_m[kept[-1]], (len(ahead), 2)), points_m[ahead])
        kept.append(int(ahead[clear].max(initial=ahead[0])))
    return points_m[kept]


def divided(points_m: Float[np.ndarray, "k 2"], length_m: float) -> Float[np.ndarray, "j 2"]:
    """A polyline [m] with further corners, so that no segment is longer than ``length_m``."""
    parts = np.maximum(np.ceil(np.linalg.norm(np.diff(points_m, axis=0), axis=1) / length_m), 1.0).astype(int)
    at = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(parts))])
    return np.stack([np.interp(at, np.arange(len(points_m)), axis) for axis in points_m.T], axis=1)


def heading_legs(
    delta_m: Float[np.ndarray, "2"], yaw_rad: float
) -> tuple[tuple[int, int], tuple[float, float], tuple[float, float]]:
    """The two legs, along the headings next to a straight line, that lead to its end. ``delta_m`` leads from the line's
    start to its end [m]; heading 0 is ``yaw_rad``. Returns the heading below and above the line (not wrapped), the
    angle from the line to each [rad], and the length of the leg along each [m], by the law of sines.
    """
    bearing = wrap_angle(math.atan2(delta_m[1], delta_m[0]) - yaw_rad) / TURN_STEP_RAD
    low = math.floor(bearing)
    angles = (low - bearing) * TURN_STEP_RAD, (low + 1.0 - bearing) * TURN_STEP_RAD
    length_m = float(np.hypot(*delta_m))
    below_m, above_m = (length_m * abs(math.sin(angle)) / math.sin(TURN_STEP_RAD) for angle in reversed(angles))
    return (low, low + 1), angles, (below_m, above_m)
