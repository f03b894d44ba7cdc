"""Which frames of a sequence are compared: groups of three, near each other in time whatever the poses say."""

import math
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int64

VIEWS = 24
"""So many frames are read at most."""
_GROUPS = VIEWS // 3
_TURN_RAD = math.radians(20.0)
"""From the first to the last frame of a group the camera turns by about this, if it turns."""
_STARTS = 6
"""So many starts of a group are looked at."""
_LONGEST_S = 0.8
"""And so much time passes at most, where frames are as near as a video's."""


def compared_frames(
    poses: Float64[np.ndarray, "n 4 4"], times_s: Float64[np.ndarray, " n"]
) -> tuple[list[int], Int64[np.ndarray, "d 2"]]:
    """Frames to read, and pairs of them as indices into that list, each both ways round.

    A camera's turn between two frames is the same in every convention of poses, so it says how far apart frames may be.
    """
    count = len(poses)
    if count <= VIEWS:
        frames = list(range(count))
        links = [(a, a + gap) for gap in (1, 2) for a in range(count - gap)]
    else:
        interval_s = float(np.median(np.diff(times_s))) if count > 1 else 0.0
        longest = round(_LONGEST_S / interval_s) if interval_s > 0.0 else 1
        longest = min(max(longest, 3), max(count // _GROUPS, 2))
        bounds = np.linspace(0, count - longest, _GROUPS + 1)
        groups = [_liveliest(poses, low, high, longest) for low, high in pairwise(bounds)]
        frames = sorted({frame for group in groups for frame in group})
        links = sorted(
            {(a, b) for first, middle, last in groups for a, b in ((first, middle), (middle, last), (first, last))}
        )
        place = {frame: at for at, frame in enumerate(frames)}
        links = [(place[a], place[b]) for a, b in links if a != b]
    both = [pair for a, b in links for pair in ((a, b), (b, a))]
    return frames, np.array(both, np.int64).reshape(-1, 2)


def _liveliest(poses: Float64[np.ndarray, "n 4 4"], low: float, high: float, longest: int) -> tuple[int, int, int]:
    """The group from a part of the sequence in which the camera's turning changes most: there a clock tells most."""
    starts = np.unique(np.linspace(low, max(high - 1.0, low), _STARTS).astype(int)).tolist()
    groups = [_group(poses, start, longest) for start in starts]
    return max(groups, key=lambda group: _change(poses, group))


def _change(poses: Float64[np.ndarray, "n 4 4"], group: tuple[int, int, int]) -> float:
    """By how much the mean turn per frame differs between the two parts of a group."""
    first, middle, last = group
    one = _turn_rad(poses[first], poses[middle]) / (middle - first)
    return abs(one - _turn_rad(poses[middle], poses[last]) / max(last - middle, 1))


def _group(poses: Float64[np.ndarray, "n 4 4"], start: int, longest: int) -> tuple[int, int, int]:
    turns = np.array([_turn_rad(poses[start], poses[start + gap]) for gap in range(1, longest + 1)])
    far = np.flatnonzero(turns > _TURN_RAD)
    gap = max(2, int(far[0]) if len(far) else longest)
    return start, start + max(1, gap // 3), min(start + gap, len(poses) - 1)


def _turn_rad(T_one: Float64[np.ndarray, "4 4"], T_other: Float64[np.ndarray, "4 4"]) -> float:
    cosine = (float(np.trace(T_one[:3, :3].T @ T_other[:3, :3])) - 1.0) / 2.0
    return math.acos(min(1.0, max(-1.0, cosine)))
