"""Reads rendered sequences of Replica, as NICE-SLAM published them: ``traj.txt`` and ``results/``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number
from anm_mj.io.sequence import FRAME_S, Frame, Sequence, from_pixel_centres, say_left_out
from anm_mj.utils.read_file import convert, read_table


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
    """The images in ``results/``, or in the folder itself, with the poses of ``traj.txt``.

    Raises:
        OSError, ValueError, RunFolderError: The camera or the poses are missing or damaged, or an image has no partner.
    """
    poses = read_table(folder / "traj.txt").reshape(-1, 4, 4)
    images = folder / "results" if (folder / "results").is_dir() else folder
    colour = sorted(images.glob("frame*.jpg")) or sorted(images.glob("frame*.png"))
    depth = sorted(images.glob("depth*"))
    beside = [place / "cam_params.json" for place in (folder, folder.parent)]
    stated = next((read_json(path) for path in beside if path.is_file()), None)
    if stated is None:
        raise RunFolderError(f"{folder} has no cam_params.json, neither in it nor beside it.")
    facts = convert(stated, _ReplicaParameters).camera
    camera = from_pixel_centres(facts.w, facts.h, (facts.fx, facts.fy, facts.cx, facts.cy))
    coloured, measured = ({path.stem.lstrip("framedpth") for path in images} for images in (colour, depth))
    alone = sorted(coloured ^ measured)
    if alone:
        raise RunFolderError(
            f"{images} has a colour or a depth image without its partner (number {alone[0]}, {len(alone)} in all): "
            "copy it again, or remove the other one."
        )
    say_left_out(folder, min(len(poses), len(colour)), len(colour), "traj.txt has no pose for them")
    frames = (
        Frame(index * FRAME_S, colour[index], depth[index], pose) for index, pose in enumerate(poses[: len(colour)])
    )
    return Sequence(folder, camera, 1.0 / facts.scale, tuple(frames), resize=True)
