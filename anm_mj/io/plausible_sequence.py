"""What can be true of a recorded sequence: its camera, its unit of depth, its poses and its files."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.io.camera_checks import FARTHEST_M, check_camera, check_time, no_poses
from anm_mj.io.sequence import Sequence, ranges_text, require_below

_MOST_LEFT_OUT = 0.2
"""A sequence with a larger share of frames without a pose is refused."""
_ASSUMED_SIZE = (640, 480)
"""Of the images of the TUM data set [px]."""
_HEIGHTS_M = (0.05, 50.0)
"""Cameras stand between these above the floor [m]."""

_logger = logging.getLogger(__name__)


def check_assumed_camera(sequence: Sequence) -> None:
    """Warn of a camera that no file states.

    Raises:
        RunFolderError: its images have another size than those of the data set.
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
    """Warn of a unit of depth that no file states."""
    _logger.warning(
        "No file of %s states its unit of depth: %g m is assumed (--depth-unit).", sequence.path, sequence.depth_unit_m
    )


def with_poses_alone(sequence: Sequence) -> Sequence:
    """The frames whose pose can be one, with a warning; all of them where too many have none."""
    shapes = {np.shape(frame.T_world_camera) for frame in sequence.frames}
    if shapes != {(4, 4)}:
        return sequence
    wrong = no_poses(np.array([frame.T_world_camera for frame in sequence.frames]))
    if not 0 < np.count_nonzero(wrong) <= _MOST_LEFT_OUT * len(wrong):
        return sequence
    _logger.warning(
        "%s: %d of %d frames are left out, because their pose is none (nan, zeros or no rotation): %s.",
        sequence.path,
        np.count_nonzero(wrong),
        len(wrong),
        ranges_text(np.flatnonzero(wrong).tolist()),
    )
    frames = tuple(frame for frame, bad in zip(sequence.frames, wrong, strict=True) if not bad)
    return replace(sequence, frames=frames, interpolated=())


def check_sequence(sequence: Sequence) -> None:
    """Accept a camera, poses and files that can be those of a recording, whoever wrote them.

    Raises:
        RunFolderError: something cannot be true, or a file lies outside of the sequence's folder.
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
    shapes = {np.shape(frame.T_world_camera) for frame in sequence.frames}
    if shapes != {(4, 4)}:
        raise RunFolderError(f"Poses of {path} are matrices of {sorted(shapes)} numbers, not of 4 x 4.")
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
    require_below(path, sequence.frames)


def check_heights(sequence: Sequence, floor_m: float) -> None:
    """Warn of cameras that stand where nobody carries one: a unit, an axis or a floor is another one."""
    height_m = float(np.median([frame.T_world_camera[2, 3] for frame in sequence.frames])) - floor_m
    if not _HEIGHTS_M[0] <= height_m <= _HEIGHTS_M[1]:
        _logger.warning(
            "The cameras of %s are %.4g m above the floor: check the unit of depth (--depth-unit), the axis that "
            "points up (--up) and the floor (--floor).",
            sequence.path,
            height_m,
        )
