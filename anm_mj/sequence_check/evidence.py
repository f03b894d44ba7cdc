"""Chooses and reads the frames of a sequence that are compared: groups of three, near each other in time whatever the
poses say.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.errors import AnmError
from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.views import View, reduced_camera, reduced_view
from anm_mj.types import Intrinsics

_FEWEST_POINTS = 30
"""A view with fewer pixels of depth tells nothing."""
_VIEWS = 24
"""So many frames are read at most."""
_GROUPS = _VIEWS // 3
_TURN_RAD = math.radians(20.0)
"""From the first to the last frame of a group the camera turns by about this, if it turns."""
_STARTS = 6
"""So many starts of a group are looked at."""
_LONGEST_S = 0.8
"""And so much time passes at most, where frames are as near as a video's."""


@dataclass(frozen=True)
class Evidence:
    """What a sequence states, and what of it was read."""

    poses: Float64[np.ndarray, "n 4 4"]
    """Of all frames, as stated."""
    times_s: Float64[np.ndarray, " n"]
    views: tuple[View, ...]
    camera: Intrinsics
    """Of the views, as stated."""
    pairs: Int64[np.ndarray, "d 2"]
    """Indices into the views, each pair both ways round, one after the other."""


def gather(sequence: Sequence) -> Evidence | None:
    """What some frames of a sequence show; None where fewer than three can be read.

    A frame that cannot be read is left out; mapping will say so.
    """
    poses = np.array([frame.T_world_camera for frame in sequence.frames], np.float64)
    times = np.array([frame.time_s for frame in sequence.frames])
    frames, pairs = _compared_frames(poses, times)
    views, camera, place = [], None, {}
    for at, frame in enumerate(frames):
        try:
            # It is to raise, whatever share of the sequence may be bad.
            alone = replace(sequence, frames=(sequence.frames[frame],), max_bad=0.0)
            observation = next(alone.observations())
        except AnmError:
            continue
        if camera is not None and observation.intrinsics != camera:
            continue
        view = reduced_view(frame, observation)
        if np.isfinite(view.inverse_m).sum() < _FEWEST_POINTS:
            continue
        camera = observation.intrinsics
        place[at] = len(views)
        views.append(view)
    if camera is None or len(views) < 3:
        return None
    kept = np.array([(place[a], place[b]) for a, b in pairs.tolist() if a in place and b in place], np.int64)
    if not len(kept):
        return None
    return Evidence(poses, times, tuple(views), reduced_camera(camera), kept)


def _compared_frames(
    poses: Float64[np.ndarray, "n 4 4"], times_s: Float64[np.ndarray, " n"]
) -> tuple[list[int], Int64[np.ndarray, "d 2"]]:
    """Frames to read, and pairs of them as indices into that list, each both ways round.

    A camera's turn between two frames is the same in every convention of poses, so it says how far apart frames may be.
    """
    count = len(poses)
    if count <= _VIEWS:
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
