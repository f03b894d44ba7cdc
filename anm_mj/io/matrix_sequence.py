"""Reads sequences with a file of 4 x 4 numbers for each pose: 7-Scenes, and what ScanNet's exporter writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.io.image import read_image
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, from_pixel_centres, require_below, require_count
from anm_mj.io.sequence_text import in_number_order, number_rows

_UNIT_M = 0.001
_KINECT = (585.0, 585.0, 319.5, 239.5)
"""fx, fy, cx, cy [px] of the depth camera of 7-Scenes, from its documentation."""


def read_seven_scenes(folder: Path) -> Sequence:
    """The frames ``frame-000000.color.png``, ``.depth.png`` and ``.pose.txt``.

    Raises:
        OSError, ValueError, RunFolderError: a pose or the first image is missing or damaged.
    """
    named = {path.name.removesuffix(".depth.png"): path for path in folder.glob("frame-*.depth.png")}
    frames, left_out = _frames(
        folder,
        [(folder / f"{name}.color.png", named[name], folder / f"{name}.pose.txt") for name in sorted(named)],
    )
    camera = from_pixel_centres(*_size(folder, frames), _KINECT)
    return Sequence(folder, camera, _UNIT_M, frames, resize=True, assumes_camera=True, left_out=(left_out,))


def read_scannet(folder: Path) -> Sequence:
    """The frames ``color/0.jpg``, ``depth/0.png`` and ``pose/0.txt``, with ``intrinsic/intrinsic_depth.txt``.

    Raises:
        OSError, ValueError, RunFolderError: the camera, a pose or the first image is missing or damaged.
    """
    matrix = number_rows(folder / "intrinsic" / "intrinsic_depth.txt")
    if matrix.shape not in ((3, 3), (4, 4)):
        raise ValueError(f"intrinsic_depth.txt holds {matrix.shape} numbers, not 4 x 4")
    colours = {path.stem: path for path in (folder / "color").glob("*")}
    depths = sorted((folder / "depth").glob("*.png"), key=lambda path: in_number_order(path.stem))
    frames, left_out = _frames(
        folder,
        [(colours.get(path.stem, folder / "color"), path, folder / "pose" / f"{path.stem}.txt") for path in depths],
    )
    width, height = _size(folder, frames)
    camera = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return Sequence(
        folder, from_pixel_centres(width, height, camera), _UNIT_M, frames, resize=True, left_out=(left_out,)
    )


def _frames(folder: Path, files: list[tuple[Path, Path, Path]]) -> tuple[tuple[Frame, ...], LeftOut]:
    """Frames of colour, depth and pose; those without one of these files are left out."""
    require_count(len(files))
    whole = [(index, *each) for index, each in enumerate(files) if all(path.is_file() for path in each)]
    if not whole:
        raise RunFolderError(f"{folder} holds no frame that has colour, depth and a pose.")
    left_out = LeftOut(len(files) - len(whole), len(files), "their colour image or their pose is missing")
    frames = (Frame(index * FRAME_S, colour, depth, _matrix(pose)) for index, colour, depth, pose in whole)
    return tuple(frames), left_out


def _matrix(path: Path) -> Float[np.ndarray, "4 4"]:
    matrix = number_rows(path)
    if matrix.shape != (4, 4):
        raise ValueError(f"{path.name} holds {matrix.shape} numbers, not 4 x 4")
    return matrix


def _size(folder: Path, frames: tuple[Frame, ...]) -> tuple[int, int]:
    """Width and height of the first depth image [px]."""
    require_below(folder, frames[:1])
    first = frames[0].depth
    height, width = read_image(first).shape if isinstance(first, Path) else (0, 0)
    return width, height
