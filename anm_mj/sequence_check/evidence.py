"""Reads the frames that the check compares."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.errors import AnmError
from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.choose_frames import compared_frames
from anm_mj.sequence_check.views import View, reduced_camera, reduced_view
from anm_mj.types import Intrinsics

_FEWEST_POINTS = 30
"""A view with fewer pixels of depth tells nothing."""


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
    frames, pairs = compared_frames(poses, times)
    views, camera, place = [], None, {}
    for at, frame in enumerate(frames):
        try:
            observation = next(replace(sequence, frames=(sequence.frames[frame],)).observations())
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
