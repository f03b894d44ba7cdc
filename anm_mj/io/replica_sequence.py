"""Reads rendered sequences of Replica, as NICE-SLAM published them: ``traj.txt`` and ``results/``."""

from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, from_pixel_centres
from anm_mj.io.sequence_text import files_in_order, number_rows, numbers_in, paired_by_number
from anm_mj.utils.read_file import convert


class _ReplicaCamera(Struct):
    w: int
    h: int
    fx: Number
    fy: Number
    cx: Number
    cy: Number
    scale: Annotated[float, Meta(gt=0.0, le=1e12)] = 6553.5


class _ReplicaParameters(Struct):
    camera: _ReplicaCamera


def read_replica(folder: Path) -> Sequence:
    """The images in ``results/``, in ``rgb/`` and ``depth/``, or in the folder itself, with the poses of ``traj.txt``.
    Raises OSError, ValueError or RunFolderError if the camera or the poses are missing or damaged, or an image has no
    partner.
    """
    poses = _poses(folder / "traj.txt")
    images = folder / "results" if (folder / "results").is_dir() else folder
    colour = files_in_order(images, "frame*.jpg") or files_in_order(images, "frame*.png")
    depth = files_in_order(images, "depth*.*")
    if not colour and (folder / "depth").is_dir() and (folder / "rgb").is_dir():
        colour, depth = (files_in_order(folder / name, "*[0-9].*") for name in ("rgb", "depth"))
    beside = [place / "cam_params.json" for place in (folder, folder.parent)]
    stated = next((read_json(path) for path in beside if path.is_file()), None)
    if stated is None:
        raise RunFolderError(f"{folder} has no cam_params.json, neither in it nor beside it.")
    facts = convert(stated, _ReplicaParameters).camera
    camera = from_pixel_centres(facts.w, facts.h, (facts.fx, facts.fy, facts.cx, facts.cy))
    coloured, measured = ({_number(path): path for path in files} for files in (colour, depth))
    pairs, count = paired_by_number(coloured, measured, len(poses)), len(coloured.keys() | measured.keys())
    frames = tuple(
        Frame(line * FRAME_S, rgb, depth_image, poses[line]) for line, rgb, depth_image in pairs if line < len(poses)
    )
    left_out = (
        LeftOut(count - len(pairs), count, "they have a colour or a depth image without its partner"),
        LeftOut(len(pairs) - len(frames), len(pairs), "traj.txt has no pose for them"),
    )
    return Sequence(folder, camera, 1.0 / facts.scale, frames, resize=True, left_out=left_out)


def _number(path: Path) -> int:
    """The last number in a name; raises ValueError if there is none."""
    found = numbers_in(path)
    if not found:
        raise ValueError(f"{path.name} has no number")
    return found[-1]


def _poses(path: Path) -> Float[np.ndarray, "n 4 4"]:
    """Matrices of 16 numbers, in one line or in four, or of the upper 12 as KITTI writes them."""
    lines = number_rows(path, 16, 12, 4)
    if lines.shape[1] == 12:
        lines = np.hstack([lines, np.tile([0.0, 0.0, 0.0, 1.0], (len(lines), 1))])
    return lines.reshape(-1, 4, 4)
