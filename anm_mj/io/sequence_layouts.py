"""Recorded RGB-D sequences of data sets, phones, ROS bags, and run folders of ours.

The world of a layout is turned so that z points up, and moved so that the floor lies at z = 0; and so that the first
camera is not far from its origin.
"""

import logging
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.frames import rigid_transform
from anm_mj.io.bag_files import files_in, is_recording
from anm_mj.io.camera_checks import FARTHEST_M, LATEST_S
from anm_mj.io.layout_table import LAYOUTS, is_there
from anm_mj.io.plausible_sequence import (
    check_assumed_camera,
    check_heights,
    check_sequence,
    say_assumed_unit,
    say_left_out,
    with_poses_alone,
)
from anm_mj.io.rosbag import read_recording
from anm_mj.io.sequence import Sequence, SequenceOptions, ranges_text
from anm_mj.io.sequence_floor import find_floor_m, floor_below_first_m, levelled

UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Rotation from a world with this axis up to one with z up."""
BY_FLOOR = "floor"
"""In place of such an axis, without poses: up is what the floor in the first image says."""
BAG = "rosbag"
"""The layout that is no folder of images."""
_FAR_M = 1000.0
"""A map of places farther from the origin would be coarser than its depth: numbers of 32 bits lie 0.06 mm apart there,
and 62 mm where poses are of a national grid [m]."""
_WHOLE_HUNDREDS = -2
"""To so many decimals such places are rounded, so that what they are moved by can be kept in mind."""

_logger = logging.getLogger(__name__)


def open_sequence(path: Path, options: SequenceOptions | None = None) -> tuple[Sequence, str]:
    """Open a recorded sequence, and say in which layout it is. ``path`` is its folder, a ``transforms.json``, or a bag:
    its folder, a ``.mcap``, ``.db3`` or ``.bag`` file. Raises RunFolderError if the folder is none of the layouts, a
    file is missing or damaged, or an option is out of range.
    """
    options = options or SequenceOptions()
    _check_options(options)
    if options.layout == BAG or (options.layout is None and (is_recording(path) or _holds_bag_alone(path))):
        sequence, found = read_recording(path, options), BAG
    else:
        sequence, found = _read_folder(path, options)
    sequence = replace(sequence, max_bad=options.max_bad)
    sequence = sequence.without_poses() if options.ignores_poses else with_poses_alone(sequence)
    say_left_out(sequence)
    if sequence.has_poses and sequence.interpolated:
        _logger.warning(
            "%s: %d of %d frames have no pose (%s); it is interpolated, as a prior.",
            path,
            len(sequence.interpolated),
            len(sequence),
            ranges_text(list(sequence.interpolated)),
        )
    sequence = _with_camera(sequence, options)
    check_sequence(sequence)
    return _above_floor(sequence, path, found, options), found


def _check_options(options: SequenceOptions) -> None:
    """Raises RunFolderError for one that is out of range."""
    if options.layout is not None and options.layout not in (*LAYOUTS, BAG):
        raise RunFolderError(f"There is no layout '{options.layout}'; choose from {', '.join((*LAYOUTS, BAG))}.")
    if options.up is not None and options.up not in (*UP, BY_FLOOR):
        raise RunFolderError(f"--up is '{options.up}'; it must be one of {', '.join((*UP, BY_FLOOR))}.")
    if options.every < 1:
        raise RunFolderError(f"--every is {options.every}; give a whole number from 1 up.")
    if not 0.0 <= options.max_bad <= 1.0:
        raise RunFolderError(f"--max-bad is {options.max_bad:g}; give a share from 0 to 1.")
    for name, value in (("--match", options.match_s), ("--max-gap", options.max_gap_s)):
        if not 0.0 < value < LATEST_S:
            raise RunFolderError(f"{name} is {value:g}; give a time above 0 in seconds.")
    if options.floor_m is not None and not abs(options.floor_m) <= FARTHEST_M:
        raise RunFolderError(f"--floor is {options.floor_m}; give the height of the floor in metres.")


def _with_camera(sequence: Sequence, options: SequenceOptions) -> Sequence:
    """With the camera, its distortion and the unit of depth that options give; else as the files have them."""
    if options.distortion != "files":
        sequence = replace(sequence, distortion=options.distortion)
    if options.camera is not None:
        fx, fy, cx, cy = options.camera
        frames = tuple(replace(frame, camera=None) for frame in sequence.frames)
        camera = replace(sequence.intrinsics, fx=fx, fy=fy, cx=cx, cy=cy)
        sequence = replace(sequence, intrinsics=camera, frames=frames)
    elif sequence.assumes_camera:
        check_assumed_camera(sequence)
    if options.depth_unit_m is not None:
        scale = options.depth_unit_m if sequence.states_metres else 1.0
        sequence = replace(sequence, depth_unit_m=options.depth_unit_m, depth_scale=sequence.depth_scale * scale)
    elif sequence.assumes_camera:
        say_assumed_unit(sequence)
    return sequence


def _above_floor(sequence: Sequence, path: Path, found: str, options: SequenceOptions) -> Sequence:
    """In a world with z up and the floor at 0, and what options leave of its frames; ``found`` is its layout."""
    layout = LAYOUTS.get(found)
    usual = "z" if layout is None else layout.up
    levels = options.up == BY_FLOOR
    if levels and sequence.has_poses:
        raise RunFolderError(f"--up is {BY_FLOOR}, but {path} has poses; give an axis of their world.")
    up = (None if levels else options.up) or (usual if sequence.has_poses else "-y")
    if sequence.has_poses and up == usual != "z":
        _logger.info("%s: %s points up, as the layout %s has it (--up).", path, up, found)
    if options.judge is not None:
        sequence, up = options.judge(sequence, up)
    # Offsets in time are told by poses that follow one another closely.
    sequence = replace(sequence, frames=sequence.frames[:: options.every])
    turn = levelled(sequence, UP[up]) if levels else UP[up]
    sequence = sequence.moved(rigid_transform(turn.ravel(), np.zeros(3)))
    floor_m = options.floor_m
    if floor_m is None and sequence.has_poses:
        floor_m = 0.0 if layout is not None and layout.ours else find_floor_m(sequence)
    elif floor_m is None:
        floor_m = floor_below_first_m(sequence)
    check_heights(sequence, floor_m)
    return _near_origin(sequence, floor_m)


def _near_origin(sequence: Sequence, floor_m: float) -> Sequence:
    """The same frames in a world with the floor at 0 and the first camera not far from its origin, with a warning where
    that moves them along the floor.
    """
    shift_m = np.array([0.0, 0.0, -floor_m])
    first_m = sequence.frames[0].T_world_camera[:2, 3]
    distance_m = float(np.hypot(*first_m))
    if distance_m > _FAR_M:
        shift_m[:2] = -np.round(first_m, _WHOLE_HUNDREDS)
        _logger.warning(
            "The first camera of %s is %.3g km from the origin of its world, where the 32 bits of a map tell places "
            "only to %.2g mm: the world of the results begins at x = %.0f, y = %.0f m of that one (origin_m in "
            "manifest.json).",
            sequence.path,
            distance_m / 1e3,
            1e3 * np.spacing(np.float32(np.abs(first_m).max())),
            *-shift_m[:2],
        )
    x, y, z = (0.0 - shift_m).tolist()
    return replace(sequence.moved(rigid_transform(np.eye(3).ravel(), shift_m)), origin_m=(x, y, z))


def _holds_bag_alone(path: Path) -> bool:
    """Whether a folder holds files of a bag, and nothing that tells of another layout."""
    if not os.path.isdir(path) or any(
        is_there(path, sign) for each in LAYOUTS.values() for sign in (each.sign, each.unposed_sign)
    ):
        return False
    try:
        return bool(files_in(path))
    except OSError:
        return False


def _read_folder(path: Path, options: SequenceOptions) -> tuple[Sequence, str]:
    folder = path.parent if path.name == "transforms.json" else path
    if options.topics:
        raise RunFolderError(f"{path} is no ROS bag, so it has no topics; leave out --topic.")
    if path.suffix == ".r3d" or (os.path.isdir(folder) and is_there(folder, "rgbd/*.depth")):
        raise RunFolderError(
            f"{path} is a recording of Record3D itself, whose depth is packed as LZFSE: let the app export it as EXR "
            "and RGB, and give that folder."
        )
    if not os.path.isdir(folder):  # Unlike Path.is_dir, never an error.
        raise RunFolderError(f"{folder} is not a folder; give that of a recorded sequence.")
    signs = {name: layout.sign if options.needs_poses else layout.unposed_sign for name, layout in LAYOUTS.items()}
    found = options.layout or next((name for name, sign in signs.items() if is_there(folder, sign)), None)
    if found is None:
        # Two parts of a layout are no accident.
        there = {name: sum(is_there(folder, need) for need in each.needs) for name, each in LAYOUTS.items()}
        best = min(LAYOUTS, key=lambda name: (there[name] < 2, len(LAYOUTS[name].needs) - there[name], -there[name]))
        if there[best] < 2:
            signs = ", ".join(f"{sign.replace('|', ' or ')} ({name})" for name, sign in signs.items())
            raise RunFolderError(f"{folder} is no recorded sequence; it has none of {signs}.")
        track = "; give --track to find its poses" if is_there(folder, LAYOUTS[best].unposed_sign) else ""
        raise RunFolderError(
            f"{folder} looks like a sequence of the layout {best}, but has no "
            f"{signs[best].replace('|', ' or ')}{track}."
        )
    needs = (signs[found], *LAYOUTS[found].needs)
    missing = [need.replace("|", " or ") for need in needs if not is_there(folder, need)]
    if missing:
        raise RunFolderError(
            f"{folder} is no whole sequence of the layout {found}: it has no {', no '.join(missing)}; copy or export "
            "it whole."
        )
    try:
        given = {name: getattr(options, name) for name in LAYOUTS[found].options}
        return LAYOUTS[found].read(folder, **given), found
    except (OSError, KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as err:
        said = str(err) if isinstance(err, OSError | ValueError | OverflowError) else repr(err)
        raise RunFolderError(f"{folder} cannot be read in the layout {found} ({said}).") from err
