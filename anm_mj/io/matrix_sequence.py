"""Reads sequences whose poses are 4 x 4 numbers: 7-Scenes, what ScanNet's exporter writes, and Open3D's."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.io.image import first_shape
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number, Pixels
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, from_pixel_centres, require_count
from anm_mj.io.sequence_text import files_in_order, number_rows, numbers_in, paired_by_number, rows
from anm_mj.utils.read_file import convert

_UNIT_M = 0.001
_KINECT = (585.0, 585.0, 319.5, 239.5)
"""fx, fy, cx, cy [px] of the depth camera of 7-Scenes, from its documentation."""
_PRIMESENSE = (525.0, 525.0, 319.5, 239.5)
"""The same of the camera that Open3D takes where none is given."""
_LOG_NUMBERS = 19
"""Of a pose in ``trajectory.log``."""


def read_seven_scenes(folder: Path) -> Sequence:
    """The frames ``frame-000000.color.png``, ``.depth.png`` and ``.pose.txt``. Raises OSError, ValueError or
    RunFolderError if a pose is damaged, or no depth image can be read.
    """
    names = [path.name.removesuffix(".depth.png") for path in files_in_order(folder, "frame-*.depth.png")]
    kinds = ("color.png", "depth.png", "pose.txt")
    files = [tuple(folder / f"{name}.{kind}" for kind in kinds) for name in names]
    frames, left_out = _frames(folder, files)
    camera = from_pixel_centres(*_size(folder, frames), _KINECT)
    return Sequence(folder, camera, _UNIT_M, frames, resize=True, assumes_camera=True, left_out=(left_out,))


def read_scannet(folder: Path) -> Sequence:
    """The frames ``color/0.jpg``, ``depth/0.png`` and ``pose/0.txt``, with ``intrinsic/intrinsic_depth.txt``. Raises
    OSError, ValueError or RunFolderError if the camera or a pose is damaged, or no depth image can be read.
    """
    matrix = number_rows(folder / "intrinsic" / "intrinsic_depth.txt")
    if matrix.shape not in ((3, 3), (4, 4)):
        raise ValueError(f"intrinsic_depth.txt holds {matrix.shape} numbers, not 4 x 4")
    colours = {path.stem: path for path in files_in_order(folder / "color", "*")}
    depths = files_in_order(folder / "depth", "*.png")
    frames, left_out = _frames(
        folder,
        [(colours.get(path.stem, folder / "color"), path, folder / "pose" / f"{path.stem}.txt") for path in depths],
    )
    width, height = _size(folder, frames)
    camera = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return Sequence(
        folder, from_pixel_centres(width, height, camera), _UNIT_M, frames, resize=True, left_out=(left_out,)
    )


class _Open3dCamera(Struct):
    width: Pixels
    height: Pixels
    intrinsic_matrix: Annotated[list[Number], Meta(min_length=9, max_length=9)]
    """Column by column."""
    depth_scale: Annotated[float, Meta(gt=0.0, le=1e9)] = 1.0 / _UNIT_M
    """Units of depth per metre."""


def read_open3d(folder: Path) -> Sequence:
    """The frames of Open3D's reconstruction system: ``trajectory.log``, ``color/`` or the like, and ``depth/``.

    The camera is that of ``camera_intrinsic.json`` or of another file with ``intrinsic`` in its name. Raises OSError,
    ValueError or RunFolderError if the camera or the poses are damaged, or no frame is whole.
    """
    log = folder / "trajectory.log"
    log = log if log.exists() else folder / "scene" / log.name
    numbers = np.array([float(word) for line in rows(log) for word in line.split()])
    # Each pose stands behind a line of three whole numbers.
    if not len(numbers) or len(numbers) % _LOG_NUMBERS:
        raise ValueError(f"{log.name} holds {len(numbers)} numbers, not {_LOG_NUMBERS} for each pose")
    poses = numbers.reshape(-1, _LOG_NUMBERS)[:, 3:].reshape(-1, 4, 4)
    require_count(len(poses))
    place = next((folder / name for name in ("color", "image", "rgb") if (folder / name).is_dir()), folder / "color")
    colours, depths = (
        [path for path in files_in_order(one, "*") if path.is_file()] for one in (place, folder / "depth")
    )
    count = max(len(colours), len(depths), len(poses))
    frames = tuple(
        Frame(line * FRAME_S, colour, depth, poses[line])
        for line, colour, depth in _paired(colours, depths, len(poses))
        if line < len(poses)
    )
    left_out = LeftOut(
        count - len(frames),
        count,
        f"there are {len(colours)} colour images, {len(depths)} depth images and {len(poses)} poses",
    )
    if not frames:
        raise RunFolderError(f"{folder} holds no frame that has colour, depth and a pose.")
    stated = files_in_order(folder, "*intrinsic*.json")
    if not stated:
        camera = from_pixel_centres(*_size(folder, frames), _PRIMESENSE)
        return Sequence(folder, camera, _UNIT_M, frames, resize=True, assumes_camera=True, left_out=(left_out,))
    said = convert(read_json(stated[0]), _Open3dCamera)
    k = said.intrinsic_matrix
    camera = from_pixel_centres(said.width, said.height, (k[0], k[4], k[6], k[7]))
    return Sequence(folder, camera, 1.0 / said.depth_scale, frames, resize=True, left_out=(left_out,))


def _paired(colours: list[Path], depths: list[Path], poses: int) -> list[tuple[int, Path, Path]]:
    """Which of so many poses, and the images of each frame. Images stand beside each other by the first number in their
    names where an image is missing, else by their rank.
    """
    coloured, measured = _numbered(colours), _numbered(depths)
    is_whole = len(coloured) == len(measured) and not any(map(_has_gap, (coloured, measured)))
    # Times of images tell nothing of their partners.
    if is_whole or 2 * len(coloured.keys() & measured.keys()) <= len(coloured.keys() | measured.keys()):
        return [(rank, *images) for rank, images in enumerate(zip(colours, depths, strict=False))]
    return paired_by_number(coloured, measured, poses)


def _numbered(files: list[Path]) -> dict[int, Path]:
    """Files by the first number in their names; none where it does not tell them apart."""
    numbered = {numbers[0]: path for path in files if (numbers := numbers_in(path))}
    return numbered if len(numbered) == len(files) else {}


def _has_gap(numbers: Collection[int]) -> bool:
    return bool(numbers) and max(numbers) - min(numbers) + 1 > len(numbers)


def _frames(folder: Path, files: list[tuple[Path, ...]]) -> tuple[tuple[Frame, ...], LeftOut]:
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
    """Width and height of the first depth image that can be read [px]."""
    height, width = first_shape(folder, (frame.depth for frame in frames))
    return width, height
