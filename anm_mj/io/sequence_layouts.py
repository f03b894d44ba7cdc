"""Recorded RGB-D sequences: TUM RGB-D, nerfstudio, Replica, ROS bags, and a run folder of ours.

The world of a layout is turned so that z points up, and moved so that the floor lies at z = 0.
"""

from __future__ import annotations

import logging
import os
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.frames import T_GL_CV, pixel_directions, transform_points
from anm_mj.io.camera_checks import FARTHEST_M, check_camera, check_time, no_poses
from anm_mj.io.image import read_image
from anm_mj.io.nerfstudio_camera import check_nerfstudio_camera, nerfstudio_camera
from anm_mj.io.read_run import read_json, read_run
from anm_mj.io.rosbag import is_recording, read_recording
from anm_mj.io.run_shapes import Number
from anm_mj.io.sequence import Frame, Sequence, read_sequence, require_count, say_left_out, tum_matrix
from anm_mj.types import Intrinsics
from anm_mj.utils.read_file import convert, is_below, read_table, read_text

TUM_UNIT_M, REPLICA_UNIT_M, MM = 1.0 / 5000.0, 1.0 / 6553.5, 0.001
TUM_MATCH_S = 0.02
"""Images and poses of a TUM sequence belong together up to this difference of their times [s]."""
TUM_CAMERAS = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""fx, fy, cx, cy [px] of the data set's cameras, from its documentation; distortion is left out."""
TUM_CAMERA = (525.0, 525.0, 319.5, 239.5)
REPLICA_TIME_S = 1.0 / 30.0
UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Rotation from a world with this axis up to one with z up."""
BAG = "rosbag"
"""The layout that is no folder of images."""
FLOOR_FRAMES, FLOOR_BIN_M, FLOOR_SHARE = 30, 0.02, 0.3
HEIGHTS_M = (0.05, 50.0)
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
    up: str = "z"
    """Axis of the sequence's world that points up: a key of ``UP``."""
    floor_m: float | None = None
    """Height of the floor along that axis [m]; None = 0 in layouts of ours, found from the depth in others."""
    every: int = 1
    """Only every so-manieth frame is read."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Of a ROS bag, by role; see :mod:`anm_mj.io.rosbag`."""


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
    if options.up not in UP:
        raise RunFolderError(f"--up is '{options.up}'; it must be one of {', '.join(UP)}.")
    if options.every < 1:
        raise RunFolderError(f"--every is {options.every}; give a whole number from 1 up.")
    if options.layout == BAG or (options.layout is None and is_recording(path)):
        sequence, found = read_recording(path, options.topics, options.depth_unit_m, options.camera), BAG
    else:
        sequence, found = _read_folder(path, options)
    if not sequence.frames:
        raise RunFolderError(f"{path} holds no frame that has colour, depth and a pose.")
    if options.camera is not None:
        fx, fy, cx, cy = options.camera
        sequence = replace(sequence, intrinsics=replace(sequence.intrinsics, fx=fx, fy=fy, cx=cx, cy=cy))
    if options.depth_unit_m is not None:
        sequence = replace(sequence, depth_unit_m=options.depth_unit_m)
    check_sequence(sequence)
    if options.floor_m is not None and not abs(options.floor_m) <= FARTHEST_M:
        raise RunFolderError(f"--floor is {options.floor_m}; give the height of the floor in metres.")
    sequence = replace(sequence, frames=sequence.frames[:: options.every])
    T_up = np.eye(4)
    T_up[:3, :3] = UP[options.up]
    sequence = sequence.moved(T_up)
    floor_m = options.floor_m
    if floor_m is None:
        floor_m = 0.0 if found in LAYOUTS and LAYOUTS[found].ours else find_floor_m(sequence)
    _check_heights(sequence, floor_m)
    lowered = np.eye(4)
    lowered[2, 3] = -floor_m
    return sequence.moved(lowered), found


def _read_folder(path: Path, options: SequenceOptions) -> tuple[Sequence, str]:
    """A sequence that is a folder of files, and its layout."""
    folder = path.parent if path.name == "transforms.json" else path
    if options.topics:
        raise RunFolderError(f"{path} is no ROS bag, so it has no topics; leave out --topic.")
    if not os.path.isdir(folder):  # Unlike Path.is_dir, never an error.
        raise RunFolderError(f"{folder} is not a folder; give that of a recorded sequence.")
    found = options.layout or next((name for name, layout in LAYOUTS.items() if (folder / layout.sign).exists()), None)
    if found is None:
        signs = ", ".join(f"{layout.sign} ({name})" for name, layout in LAYOUTS.items())
        raise RunFolderError(f"{folder} is no recorded sequence; it has none of {signs}.")
    try:
        return LAYOUTS[found].read(folder), found
    except (OSError, KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as err:
        raise RunFolderError(f"{folder} cannot be read in the layout {found} ({err!r}).") from err


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
    times = np.array(sequence.time_s)
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
    _check_places(path, sequence.frames)


def _check_heights(sequence: Sequence, floor_m: float) -> None:
    """Warn of cameras that stand where nobody carries one: a unit, an axis or a floor is another one."""
    height_m = float(np.median([frame.T_world_camera[2, 3] for frame in sequence.frames])) - floor_m
    low, high = HEIGHTS_M
    if not low <= height_m <= high:
        _logger.warning(
            "The cameras of %s are %.4g m above the floor: check the unit of depth (--depth-unit), the axis that "
            "points up (--up) and the floor (--floor).",
            sequence.path,
            height_m,
        )


def _check_places(folder: Path, frames: Iterable[Frame]) -> None:
    """Raises RunFolderError where an image lies outside of a sequence's folder."""
    for frame in frames:
        for file in (frame.colour, frame.depth):
            if isinstance(file, Path) and not is_below(file, folder):
                raise RunFolderError(f"{folder} names {file}, which lies outside of it; copy the image there.")


def find_floor_m(sequence: Sequence) -> float:
    """Height of the floor: the lowest level that holds many of the points below the cameras [m]."""
    some = replace(sequence, frames=sequence.frames[:: max(1, len(sequence) // FLOOR_FRAMES)])
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
    levels, count = np.unique(np.floor(z / FLOOR_BIN_M), return_counts=True)
    # A level of points and its neighbours: the floor may lie on the border of two.
    total = np.concatenate([[0], np.cumsum(count)])
    both = total[np.searchsorted(levels, levels + 1.0, "right")] - total[np.searchsorted(levels, levels - 1.0)]
    lowest = levels[np.argmax(both >= FLOOR_SHARE * both.max())]
    near = z[np.abs(z - (lowest + 1.0) * FLOOR_BIN_M) < 2 * FLOOR_BIN_M]
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
    return Sequence(folder, run.intrinsics, MM, frames, resize=True, keeps_corner_pixels=True)


def _tum(folder: Path) -> Sequence:
    depth, colour = _listed(folder / "depth.txt"), _listed(folder / "rgb.txt")
    truth = read_table(folder / "groundtruth.txt")
    poses = sorted(((float(line[0]), line[1:]) for line in truth), key=itemgetter(0))
    require_count(len(depth))
    image_at, pose_at = _Nearest(colour), _Nearest(poses)
    frames = []
    for time_s, name in depth:
        image, pose = image_at(time_s), pose_at(time_s)
        if image is not None and pose is not None:
            frames.append(Frame(time_s, folder / image, folder / name, tum_matrix(pose[:3], pose[3:])))
    say_left_out(folder, len(frames), len(depth), f"no image or no pose is within {TUM_MATCH_S:g} s of their depth")
    known = next((camera for key, camera in TUM_CAMERAS.items() if key in folder.resolve().name), TUM_CAMERA)
    _check_places(folder, frames[:1])
    height, width = read_image(frames[0].colour, "RGB").shape[:2] if frames else (480, 640)
    return Sequence(folder, _from_pixel_centres(width, height, known), TUM_UNIT_M, tuple(frames), resize=True)


class _TransformsFrame(Struct):
    """A frame of nerfstudio's ``transforms.json``."""

    file_path: str
    transform_matrix: list[tuple[Number, Number, Number, Number]]
    depth_file_path: str | None = None
    time: Number = 0.0
    w: int | None = None
    h: int | None = None
    fl_x: Number | None = None
    fl_y: Number | None = None
    cx: Number | None = None
    cy: Number | None = None


class _Transforms(Struct):
    """``transforms.json`` of nerfstudio."""

    frames: Annotated[list[_TransformsFrame], Meta(min_length=1)]
    depth_unit_scale_factor: Number = MM
    camera_model: str = "OPENCV"


class _ReplicaCamera(Struct):
    """The camera in Replica's ``cam_params.json``."""

    w: int
    h: int
    fx: Number
    fy: Number
    cx: Number
    cy: Number
    scale: Annotated[float, Meta(gt=0.0, le=1e12)] = 1.0 / REPLICA_UNIT_M


class _ReplicaParameters(Struct):
    """``cam_params.json`` of Replica."""

    camera: _ReplicaCamera


def _nerfstudio(folder: Path) -> Sequence:
    facts = read_json(folder / "transforms.json")
    shape = convert(facts, _Transforms)
    check_nerfstudio_camera(folder, facts, shape.camera_model)
    require_count(len(facts["frames"]))
    frames = []
    for index, entry in enumerate(sorted(facts["frames"], key=lambda one: one["file_path"])):
        if entry.get("depth_file_path") is None:
            raise RunFolderError(f"{folder / 'transforms.json'} gives {entry['file_path']} no depth_file_path.")
        matrix = np.array(entry["transform_matrix"], dtype=np.float64) @ T_GL_CV
        time_s = float(entry.get("time", index * REPLICA_TIME_S))
        frames.append(Frame(time_s, folder / entry["file_path"], folder / entry["depth_file_path"], matrix))
    first = facts["frames"][0]
    values = {key: facts.get(key, first.get(key)) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")}
    camera = nerfstudio_camera(values)
    unit = float(facts.get("depth_unit_scale_factor", MM))
    # Images of ours keep the first pixel of each block.
    ours = facts.get("depth_pixels") == "first of each block"
    return Sequence(folder, camera, unit, tuple(frames), resize=True, keeps_corner_pixels=ours)


def _replica(folder: Path) -> Sequence:
    poses = read_table(folder / "traj.txt").reshape(-1, 4, 4)
    images = folder / "results" if (folder / "results").is_dir() else folder
    colour, depth = (
        sorted(images.glob("frame*.jpg")) or sorted(images.glob("frame*.png")),
        sorted(images.glob("depth*")),
    )
    beside = [place / "cam_params.json" for place in (folder, folder.parent)]
    stated = next((read_json(path) for path in beside if path.is_file()), None)
    if stated is None:
        raise RunFolderError(f"{folder} has no cam_params.json, neither in it nor beside it.")
    facts = convert(stated, _ReplicaParameters).camera
    camera = _from_pixel_centres(facts.w, facts.h, (facts.fx, facts.fy, facts.cx, facts.cy))
    numbers = [{path.stem.lstrip("framedpth") for path in images} for images in (colour, depth)]
    if numbers[0] != numbers[1]:
        alone = sorted(numbers[0] ^ numbers[1])
        raise RunFolderError(
            f"{images} has a colour or a depth image without its partner (number {alone[0]}, {len(alone)} in all): "
            "copy it again, or remove the other one."
        )
    say_left_out(folder, min(len(poses), len(colour)), len(colour), "traj.txt has no pose for them")
    frames = tuple(
        Frame(index * REPLICA_TIME_S, image, measured, pose)
        for index, (image, measured, pose) in enumerate(zip(colour, depth, poses, strict=False))
    )
    return Sequence(folder, camera, 1.0 / facts.scale, frames, resize=True)


@dataclass(frozen=True)
class Layout:
    """How a kind of sequence is recognised and read."""

    sign: str
    """A file that only this layout has."""
    read: Callable[[Path], Sequence]
    ours: bool = False
    """Whether the floor is at z = 0 by definition."""


LAYOUTS = {
    "run": Layout("frames.jsonl", _run, ours=True),
    "anm-mj": Layout("poses.tum", read_sequence, ours=True),
    "tum": Layout("groundtruth.txt", _tum),
    "nerfstudio": Layout("transforms.json", _nerfstudio),
    "replica": Layout("traj.txt", _replica),
}


def _from_pixel_centres(width: int, height: int, camera: tuple[float, ...]) -> Intrinsics:
    """Intrinsics whose principal point was measured from the centre of the first pixel."""
    fx, fy, cx, cy = camera
    return Intrinsics(int(width), int(height), fx, fy, cx + 0.5, cy + 0.5)


def _listed(path: Path) -> list[tuple[float, str]]:
    """Times and names in a list of a TUM sequence, by time."""
    lines = [line.split() for line in read_text(path).splitlines() if line and line[0] != "#"]
    return sorted(((float(words[0]), words[1]) for words in lines if words), key=itemgetter(0))


class _Nearest:
    """Finds what is nearest in time."""

    def __init__(self, entries: list[tuple[float, Any]]) -> None:
        """Take pairs of time [s] and thing, in order."""
        self._entries = entries
        self._times = [time_s for time_s, _ in entries]

    def __call__(self, time_s: float) -> Any:
        """The thing of the nearest time; None if that is too far away."""
        after = bisect_left(self._times, time_s)
        near = self._entries[max(0, after - 1) : after + 1]
        found = min(near, key=lambda entry: abs(entry[0] - time_s), default=None)
        return None if found is None or not abs(found[0] - time_s) <= TUM_MATCH_S else found[1]
