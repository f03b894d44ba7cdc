"""Recorded RGB-D sequences: TUM RGB-D, nerfstudio, Replica, 7-Scenes, ScanNet, ROS bags, and a run folder of ours.

The world of a layout is turned so that z points up, and moved so that the floor lies at z = 0.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.frames import pixel_directions, rigid_transform, transform_points
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.camera_checks import FARTHEST_M, check_camera, check_time, no_poses
from anm_mj.io.matrix_sequence import read_scannet, read_seven_scenes
from anm_mj.io.nerfstudio_sequence import read_nerfstudio
from anm_mj.io.read_run import read_run
from anm_mj.io.replica_sequence import read_replica
from anm_mj.io.rosbag import is_recording, read_recording
from anm_mj.io.sequence import Frame, Sequence, ranges_text, read_sequence, require_below
from anm_mj.io.tum_sequence import read_tum

UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Rotation from a world with this axis up to one with z up."""
BAG = "rosbag"
"""The layout that is no folder of images."""
_FLOOR_FRAMES, _FLOOR_BIN_M, _FLOOR_SHARE = 30, 0.02, 0.3
_GUESSED_M = 1.0
"""A camera of which nothing is known stands so high [m]."""
_MOST_LEFT_OUT = 0.2
"""A sequence with a larger share of frames without a pose is refused."""
_ASSUMED_SIZE = (640, 480)
"""Of the images of the TUM data set [px]."""
_HEIGHTS_M = (0.05, 50.0)
"""Cameras stand between these above the floor [m]."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SequenceOptions:
    """What the files of a sequence do not say, or say wrongly; None = as they say, or as the layout has it."""

    layout: str | None = None
    """A key of ``LAYOUTS``."""
    camera: tuple[float, float, float, float] | None = None
    """fx, fy, cx, cy [px]; the principal point measured from the corner of the image."""
    depth_unit_m: float | None = None
    """Metres per unit of a depth PNG."""
    up: str | None = None
    """Axis of the sequence's world that points up: a key of ``UP``; None = z. Without poses that world is the first
    camera's: None = -y, a camera that is held level."""
    floor_m: float | None = None
    """Height of the floor along that axis [m]; None = 0 in layouts of ours, found from the depth in others, without
    poses from that of the first frame."""
    every: int = 1
    """Only every n-th frame is read."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Of a ROS bag, by role; see :mod:`anm_mj.io.rosbag`."""
    needs_poses: bool = True
    """Whether frames without a pose are left out; else they are interpolated, or there are none at all."""
    ignores_poses: bool = False
    """Whether the poses of the files are not used."""
    distortion: LensDistortion | Literal["files"] | None = "files"
    """Of the lens; None = there is none, ``files`` = as they say."""
    judge: Callable[[Sequence, str], tuple[Sequence, str]] | None = None
    """Looks at the sequence as its files state it, and at the axis that is taken to point up, before the floor is
    looked for; gives both back, put right."""


def open_sequence(path: Path, options: SequenceOptions | None = None) -> tuple[Sequence, str]:
    """Open a recorded sequence, and say in which layout it is.

    Args:
        path: Its folder, a ``transforms.json``, or a bag: its folder, a ``.mcap`` or a ``.bag`` file.
        options: What the files do not say.

    Raises:
        RunFolderError: The folder is none of the layouts, a file is missing or damaged, or an option is out of range.
    """
    options = options or SequenceOptions()
    if options.layout is not None and options.layout not in (*LAYOUTS, BAG):
        raise RunFolderError(f"There is no layout '{options.layout}'; choose from {', '.join((*LAYOUTS, BAG))}.")
    if options.up is not None and options.up not in UP:
        raise RunFolderError(f"--up is '{options.up}'; it must be one of {', '.join(UP)}.")
    if options.every < 1:
        raise RunFolderError(f"--every is {options.every}; give a whole number from 1 up.")
    if options.layout == BAG or (options.layout is None and is_recording(path)):
        sequence = read_recording(
            path, options.topics, options.depth_unit_m, options.camera, needs_poses=options.needs_poses
        )
        found = BAG
    else:
        sequence, found = _read_folder(path, options)
    if not sequence.frames:
        raise RunFolderError(f"{path} holds no frame that has colour, depth and a pose.")
    if options.ignores_poses:
        sequence = sequence.without_poses()
    if sequence.has_poses and sequence.interpolated:
        _logger.warning(
            "%s: %d of %d frames have no pose (%s); it is interpolated, as a prior.",
            path,
            len(sequence.interpolated),
            len(sequence),
            ranges_text(list(sequence.interpolated)),
        )
    if options.distortion != "files":
        sequence = replace(sequence, distortion=options.distortion)
    if options.camera is not None:
        fx, fy, cx, cy = options.camera
        sequence = replace(sequence, intrinsics=replace(sequence.intrinsics, fx=fx, fy=fy, cx=cx, cy=cy))
    elif sequence.assumes_camera:
        _check_assumed_camera(sequence)
    if options.depth_unit_m is not None:
        sequence = replace(sequence, depth_unit_m=options.depth_unit_m)
    elif sequence.assumes_camera:
        _say_assumed_unit(sequence)
    sequence = _with_poses_alone(sequence)
    check_sequence(sequence)
    if options.floor_m is not None and not abs(options.floor_m) <= FARTHEST_M:
        raise RunFolderError(f"--floor is {options.floor_m}; give the height of the floor in metres.")
    sequence = replace(sequence, frames=sequence.frames[:: options.every])
    up = options.up or ("z" if sequence.has_poses else "-y")
    if options.judge is not None:
        sequence, up = options.judge(sequence, up)
    sequence = sequence.moved(rigid_transform(UP[up].ravel(), np.zeros(3)))
    floor_m = options.floor_m
    if floor_m is None:
        ours = sequence.has_poses and found in LAYOUTS and LAYOUTS[found].ours
        floor_m = 0.0 if ours else find_floor_m(sequence) if sequence.has_poses else _floor_below_first_m(sequence)
    _check_heights(sequence, floor_m)
    return sequence.moved(rigid_transform(np.eye(3).ravel(), np.array([0.0, 0.0, -floor_m]))), found


def _read_folder(path: Path, options: SequenceOptions) -> tuple[Sequence, str]:
    folder = path.parent if path.name == "transforms.json" else path
    if options.topics:
        raise RunFolderError(f"{path} is no ROS bag, so it has no topics; leave out --topic.")
    if not os.path.isdir(folder):  # Unlike Path.is_dir, never an error.
        raise RunFolderError(f"{folder} is not a folder; give that of a recorded sequence.")
    signs = {name: layout.sign if options.needs_poses else layout.unposed_sign for name, layout in LAYOUTS.items()}
    found = options.layout or next((name for name, sign in signs.items() if (folder / sign).exists()), None)
    if found is None:
        if options.needs_poses and (folder / LAYOUTS["tum"].unposed_sign).exists():
            raise RunFolderError(f"{folder} has no groundtruth.txt; give --track to find its poses.")
        signs = ", ".join(f"{sign} ({name})" for name, sign in signs.items())
        raise RunFolderError(f"{folder} is no recorded sequence; it has none of {signs}.")
    try:
        return LAYOUTS[found].read(folder, options.needs_poses), found
    except (OSError, KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as err:
        raise RunFolderError(f"{folder} cannot be read in the layout {found} ({err!r}).") from err


def _check_assumed_camera(sequence: Sequence) -> None:
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


def _say_assumed_unit(sequence: Sequence) -> None:
    _logger.warning(
        "No file of %s states its unit of depth: %g m is assumed (--depth-unit).", sequence.path, sequence.depth_unit_m
    )


def _with_poses_alone(sequence: Sequence) -> Sequence:
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


def _check_heights(sequence: Sequence, floor_m: float) -> None:
    """Warn of cameras that stand where nobody carries one: a unit, an axis or a floor is another one."""
    height_m = float(np.median([frame.T_world_camera[2, 3] for frame in sequence.frames])) - floor_m
    if not _HEIGHTS_M[0] <= height_m <= _HEIGHTS_M[1]:
        _logger.warning(
            "The cameras of %s are %.4g m above the floor: check the unit of depth (--depth-unit), the axis that "
            "points up (--up) and the floor (--floor).",
            sequence.path,
            height_m,
        )


def _floor_below_first_m(sequence: Sequence) -> float:
    """Height of the floor below the first camera [m], which is the origin; a guess is said."""
    try:
        return find_floor_m(sequence.first())
    except RunFolderError:
        _logger.warning(
            "The first frame of %s shows nothing below the camera: the floor is taken to be %g m below (--floor).",
            sequence.path,
            _GUESSED_M,
        )
        return -_GUESSED_M


def find_floor_m(sequence: Sequence) -> float:
    """Height of the floor: the lowest level that holds many of the points below the cameras [m]."""
    some = replace(sequence, frames=sequence.frames[:: max(1, len(sequence) // _FLOOR_FRAMES)])
    heights = []
    for observation in some.observations():
        depth_m = observation.depth_m[::4, ::4]
        measured = np.isfinite(depth_m)
        points = pixel_directions(observation.intrinsics)[::4, ::4][measured] * depth_m[measured][:, None]
        heights.append(transform_points(observation.T_world_camera, points)[:, 2])
    below = np.median([frame.T_world_camera[2, 3] for frame in some.frames])
    z = np.concatenate(heights)
    z = z[z < below]
    if not len(z):
        raise RunFolderError(f"{sequence.path} shows nothing below its cameras; give the floor's height by --floor.")
    levels, count = np.unique(np.floor(z / _FLOOR_BIN_M), return_counts=True)
    # A level of points and its neighbours: the floor may lie on the border of two.
    total = np.concatenate([[0], np.cumsum(count)])
    both = total[np.searchsorted(levels, levels + 1.0, "right")] - total[np.searchsorted(levels, levels - 1.0)]
    lowest = levels[np.argmax(both >= _FLOOR_SHARE * both.max())]
    near = z[np.abs(z - (lowest + 1.0) * _FLOOR_BIN_M) < 2 * _FLOOR_BIN_M]
    return float(np.median(near))


def _run(folder: Path) -> Sequence:
    run = read_run(folder)
    kept = [frame for frame in run.frames if run.folder.image(frame.step).is_file()]
    if not kept:
        raise RunFolderError(f"{folder} keeps no colour images, so it cannot be mapped again.")
    frames = tuple(
        Frame(frame.time_s, run.folder.image(frame.step), run.folder.depth(frame.step), frame.T_world_camera)
        for frame in kept
    )
    return Sequence(folder, run.intrinsics, 0.001, frames, resize=True, keeps_corner_pixels=True)


@dataclass(frozen=True)
class Layout:
    """How a kind of sequence is recognised and read."""

    sign: str
    """A file that only this layout has."""
    read: Callable[[Path, bool], Sequence]
    """From its folder, and whether poses are needed."""
    unposed: str | None = None
    """A file that it has even without poses; None = it always has them."""
    ours: bool = False
    """Whether the floor is at z = 0 by definition."""

    @property
    def unposed_sign(self) -> str:
        """How it is recognised where poses are not needed."""
        return self.unposed or self.sign


LAYOUTS = {
    "run": Layout("frames.jsonl", lambda folder, _: _run(folder), ours=True),
    "anm-mj": Layout(
        "poses.tum", lambda folder, needed: read_sequence(folder, needs_poses=needed), "camera.json", ours=True
    ),
    "tum": Layout("groundtruth.txt", lambda folder, needed: read_tum(folder, needs_poses=needed), "depth.txt"),
    "nerfstudio": Layout("transforms.json", lambda folder, _: read_nerfstudio(folder)),
    "replica": Layout("traj.txt", lambda folder, _: read_replica(folder)),
    "7scenes": Layout("frame-000000.pose.txt", lambda folder, _: read_seven_scenes(folder)),
    "scannet": Layout("intrinsic/intrinsic_depth.txt", lambda folder, _: read_scannet(folder)),
}
