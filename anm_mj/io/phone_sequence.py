"""Reads what apps for phones with a depth camera export: Stray Scanner, Record3D and Polycam.

ARKit's world has y up. Depth comes smaller than colour; where its confidence is low, nothing was measured.
"""

import functools
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct, defstruct

from anm_mj.frames import T_GL_CV
from anm_mj.io.image import first_shape
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number, Pixels
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, require_count, with_cameras
from anm_mj.io.sequence_poses import tum_matrix
from anm_mj.io.sequence_text import files_in_order, number_rows, seconds
from anm_mj.io.video_frames import VideoFrames, video_size
from anm_mj.types import Intrinsics
from anm_mj.utils.read_file import convert

_UNIT_M = 0.001


def read_stray(folder: Path) -> Sequence:
    """Stray Scanner: ``odometry.csv``, ``camera_matrix.csv``, ``depth/``, ``confidence/``, ``rgb/`` or ``rgb.mp4``.
    Raises OSError, ValueError or RunFolderError if a table or the video is missing or damaged, or no image can be read.
    """
    lines = number_rows(folder / "odometry.csv", 9, 13)
    if not (np.abs(lines[:, 1]) < 1e9).all():
        raise ValueError("odometry.csv holds frame numbers that are none")
    matrix = number_rows(folder / "camera_matrix.csv")
    if matrix.shape != (3, 3):
        raise ValueError(f"camera_matrix.csv holds {matrix.shape} numbers, not 3 x 3")
    require_count(len(lines))
    named = [f"{int(line[1]):06d}" for line in lines]
    depths = [_existing(folder / "depth", name, (".png", ".npy")) for name in named]
    colours = [_existing(folder / "rgb", name, (".jpg", ".png")) for name in named]
    video = None
    if not any(path.is_file() for path in colours):
        size = video_size(folder / "rgb.mp4")
        rows, cols = first_shape(folder, depths)
        video = VideoFrames(folder / "rgb.mp4", cols, rows, int(lines[:, 1].max()) + 1)
    else:
        size = first_shape(folder, colours, "RGB")[::-1]
    frames, cameras = [], []
    for index, (line, colour, depth) in enumerate(zip(lines, colours, depths, strict=True)):
        trust = folder / "confidence" / f"{named[index]}.png"
        pose = _posed(line[2:5], line[5:9])
        picture = colour if video is None else functools.partial(video.read, int(line[1]))
        frames.append(Frame(float(line[0]), picture, depth, pose, trust if trust.is_file() else None))
        numbers = line[9:] if len(line) == 13 else matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        cameras.append(Intrinsics(*size, *numbers.tolist()))
    return _whole(folder, frames, cameras)


_POSE = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))
_PolycamCamera: Any = defstruct(
    "_PolycamCamera",
    [*((name, Number) for name in ("fx", "fy", "cx", "cy", *_POSE)), ("width", Pixels), ("height", Pixels)],
)
"""A file of ``keyframes/cameras``: three rows of the pose with the axes of OpenGL."""


def read_polycam(folder: Path) -> Sequence:
    """Polycam's raw data: ``keyframes/`` with ``cameras/``, ``images/``, ``depth/`` and ``confidence/``.

    Cameras and images that the app corrected after the scan are taken instead, where they are there. Raises OSError,
    ValueError or RunFolderError if a camera is damaged, or no frame is whole.
    """
    place = folder / "keyframes"
    prefix = "corrected_" if any((place / "corrected_cameras").glob("[!.]*.json")) else ""
    files = files_in_order(place / f"{prefix}cameras", "*.json")
    require_count(len(files))
    frames, cameras = [], []
    times = seconds([float(path.stem) for path in files])
    for path, time_s in zip(files, times, strict=True):
        said = convert(read_json(path), _PolycamCamera)
        matrix = np.eye(4)
        matrix[:3] = np.reshape([getattr(said, name) for name in _POSE], (3, 4))
        colour = _existing(place / f"{prefix}images", path.stem, (".jpg", ".png"))
        trust = place / "confidence" / f"{path.stem}.png"
        depth = place / "depth" / f"{path.stem}.png"
        frames.append(Frame(time_s, colour, depth, matrix @ T_GL_CV, trust if trust.is_file() else None))
        cameras.append(Intrinsics(said.width, said.height, said.fx, said.fy, said.cx, said.cy))
    return _whole(folder, frames, cameras)


class _Record3D(Struct):
    """``metadata.json`` of Record3D."""

    w: Pixels
    h: Pixels
    K: Annotated[list[Number], Meta(min_length=9, max_length=9)]
    """Column by column."""
    poses: list[Annotated[list[Number], Meta(min_length=7, max_length=7)]]
    """Quaternion, scalar last, and position of the camera with the axes of OpenGL."""
    fps: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0 / FRAME_S
    perFrameIntrinsicCoeffs: list[Annotated[list[Number], Meta(min_length=4, max_length=4)]] = []


def read_record3d(folder: Path) -> Sequence:
    """Record3D's export of EXR and colour: ``metadata.json``, ``rgb/`` and ``depth/``, in ``EXR_RGBD/`` or not. Raises
    OSError, ValueError or RunFolderError if the metadata are damaged, or no frame is whole.
    """
    place = folder / "EXR_RGBD" if (folder / "EXR_RGBD").is_dir() else folder
    said = place / "metadata.json"
    facts = convert(read_json(said if said.is_file() else folder / "metadata.json"), _Record3D)
    require_count(len(facts.poses))
    whole = (facts.K[0], facts.K[4], facts.K[6], facts.K[7])
    each = facts.perFrameIntrinsicCoeffs
    own = each if len(each) == len(facts.poses) else [whole] * len(facts.poses)
    frames, cameras = [], []
    for index, (pose, numbers) in enumerate(zip(facts.poses, own, strict=True)):
        colour = _existing(place / "rgb", str(index), (".jpg", ".png"))
        depth = _existing(place / "depth", str(index), (".exr", ".png", ".npy", ".tiff"))
        matrix = _posed(np.array(pose[4:]), np.array(pose[:4])) @ T_GL_CV
        frames.append(Frame(index / facts.fps, colour, depth, matrix))
        cameras.append(Intrinsics(facts.w, facts.h, *numbers))
    return _whole(folder, frames, cameras)


def _whole(folder: Path, frames: list[Frame], cameras: list[Intrinsics]) -> Sequence:
    """A sequence of the frames whose files are there."""
    there = [all(path.is_file() for path in (frame.colour, frame.depth) if isinstance(path, Path)) for frame in frames]
    left_out = LeftOut(there.count(False), len(frames), "their colour or their depth image is missing")
    if not any(there):
        raise ValueError("no frame has both colour and depth")
    kept = [index for index, is_whole in enumerate(there) if is_whole]
    camera, whole = with_cameras([frames[k] for k in kept], [cameras[k] for k in kept])
    return Sequence(folder, camera, _UNIT_M, whole, resize=True, left_out=(left_out,))


def _posed(xyz_m: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """A pose, of NaN where it is none."""
    good = np.isfinite(xyz_m).all() and np.isfinite(quaternion).all() and quaternion.any()
    return tum_matrix(xyz_m, quaternion) if good else np.full((4, 4), np.nan)


def _existing(folder: Path, stem: str, suffixes: tuple[str, ...]) -> Path:
    """The first of the files that is there, else the first one."""
    files = [folder / f"{stem}{suffix}" for suffix in suffixes]
    return next((path for path in files if path.is_file()), files[0])
