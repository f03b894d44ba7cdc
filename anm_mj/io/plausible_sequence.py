"""What can be true of a recorded sequence: its camera, its unit of depth, its poses and its files."""

import logging
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.io.camera_checks import FARTHEST_M, check_camera, check_time, no_poses
from anm_mj.io.image import require_below
from anm_mj.io.sequence import LeftOut, Sequence, ranges_text

_ASSUMED_SIZE = (640, 480)
"""Of the images of the TUM data set [px]."""
_FLOAT_SUFFIXES = (".tif", ".tiff", ".npy", ".exr", ".pfm")
"""Files of depth that mostly hold floating point."""
_HEIGHTS_M = (0.05, 6.0)
"""Cameras stand between these above the floor [m]."""
_CARRIED_M = (0.2, 2.5)
"""Most do between these."""

_logger = logging.getLogger(__name__)


def check_assumed_camera(sequence: Sequence) -> None:
    """Warn of a camera that no file states. Raises RunFolderError if its images have another size than those of the
    data set.
    """
    camera = sequence.intrinsics
    numbers = f"{camera.fx:g} px, as in the data set of its layout"
    if (camera.width, camera.height) != _ASSUMED_SIZE:
        raise RunFolderError(
            f"No file of {sequence.path} states its camera. A focal length of {numbers}, would be that of images of "
            f"{_ASSUMED_SIZE[0]} x {_ASSUMED_SIZE[1]} pixels, but they have {camera.width} x {camera.height}; give "
            f"--camera FX,FY,CX,CY, and --depth-unit where it is not {sequence.depth_unit_m:g} m."
        )
    _logger.warning("No file of %s states its camera: it is assumed to be %s (--camera).", sequence.path, numbers)


def say_assumed_unit(sequence: Sequence) -> None:
    """Warn of a unit of depth that no file states; depth in floating point is in metres."""
    first = sequence.frames[0].depth
    if isinstance(first, Path) and first.suffix.lower() in _FLOAT_SUFFIXES:
        return
    _logger.warning(
        "No file of %s states its unit of depth: %g m is assumed (--depth-unit).", sequence.path, sequence.depth_unit_m
    )


def with_poses_alone(sequence: Sequence) -> Sequence:
    """The frames whose pose can be one; all of them where too many have none."""
    wrong = no_poses(np.array([frame.T_world_camera for frame in sequence.frames]).reshape(-1, 4, 4))
    count = int(np.count_nonzero(wrong))
    if not 0 < count <= sequence.max_bad * len(wrong):
        return sequence
    numbers = ranges_text(np.flatnonzero(wrong).tolist())
    left_out = LeftOut(count, len(wrong), f"their pose is none (nan, zeros or no rotation): {numbers}")
    frames = tuple(frame for frame, bad in zip(sequence.frames, wrong, strict=True) if not bad)
    return replace(sequence, frames=frames, interpolated=(), left_out=(*sequence.left_out, left_out))


def say_left_out(sequence: Sequence) -> None:
    """Warn of the frames that are not read. Raises RunFolderError if they are more than ``max_bad`` allows, or all."""
    told = [each for each in sequence.left_out if each.frames > 0]
    for each in told:
        _logger.warning("%s: %d of %d frames are left out, because %s.", sequence.path, each.frames, each.of, each.why)
    if not sequence.frames:
        worst = max(told, key=lambda each: each.frames, default=None)
        because = "" if worst is None else f": {worst.frames} of {worst.of} are left out, because {worst.why}"
        raise RunFolderError(f"{sequence.path} holds no frame that has colour, depth and a pose{because}.")
    bad = {each.why: each.frames if each.bad is None else each.bad for each in told}
    total = len(sequence) + sum(bad.values())
    if sum(bad.values()) > sequence.max_bad * total:
        raise RunFolderError(
            f"{sum(bad.values())} of {total} frames of {sequence.path} cannot be used, more than "
            f"{100.0 * sequence.max_bad:g} % (--max-bad), mostly because {max(bad, key=lambda why: bad[why])}."
        )


def check_sequence(sequence: Sequence) -> None:
    """Accept a camera, poses and files that can be those of a recording, whoever wrote them. Raises RunFolderError if
    something cannot be true, or a file lies outside of the sequence's folder.
    """
    path = sequence.path
    try:
        check_camera(sequence.intrinsics)
    except ValueError as err:
        raise RunFolderError(f"The camera of {path} has {err}; give the true ones by --camera.") from err
    if not 0.0 < sequence.depth_unit_m < 1e3:
        raise RunFolderError(
            f"A unit of depth is {sequence.depth_unit_m:g} m in {path}; give the true one by --depth-unit."
        )
    poses = np.array([frame.T_world_camera for frame in sequence.frames])
    wrong = no_poses(poses)
    if wrong.any():
        raise RunFolderError(
            f"Pose {int(np.argmax(wrong))} of {path} is no pose of a camera: a rotation, a place within "
            f"{FARTHEST_M / 1000:g} km, and the last row 0 0 0 1."
        )
    for index, frame in enumerate(sequence.frames):
        try:
            check_time(frame.time_s)
        except ValueError as err:
            raise RunFolderError(f"Frame {index} of {path} has {err}; give times in seconds, from 0 on.") from err
    times = np.array([frame.time_s for frame in sequence.frames])
    backwards = np.flatnonzero(np.diff(times) < 0.0)
    if len(backwards):
        at = int(backwards[0])
        _logger.warning(
            "The times of %s run backwards (frame %d at %g s, the next at %g s): its frames are taken in the order of "
            "the files.",
            path,
            at,
            times[at],
            times[at + 1],
        )
    images = ((frame.colour, frame.depth, frame.confidence) for frame in sequence.frames)
    require_below(path, chain.from_iterable(images))


def check_heights(sequence: Sequence, floor_m: float) -> None:
    """Warn of cameras that stand where nobody carries one: a unit, an axis or a floor is another one."""
    height_m = float(np.median([frame.T_world_camera[2, 3] for frame in sequence.frames])) - floor_m
    if not _HEIGHTS_M[0] <= height_m <= _HEIGHTS_M[1]:
        tenths = [unit for unit in (0.1, 0.001, 10.0, 1000.0) if _CARRIED_M[0] <= unit * height_m <= _CARRIED_M[1]]
        guess = f", as in --depth-unit {tenths[0] * sequence.stated_unit_m:g}" if tenths else ""
        _logger.warning(
            "The cameras of %s are %.4g m above the floor: check the unit of depth (--depth-unit%s), the axis that "
            "points up (--up) and the floor (--floor).",
            sequence.path,
            height_m,
            guess,
        )
