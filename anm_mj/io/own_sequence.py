"""Reads and writes sequences of this project's own layout (docs/robot.md).

    camera.json          {"width", "height", "fx", "fy", "cx", "cy": pixels, "depth_unit_m": metres per unit of a PNG}
    poses.tum            one line per frame: time [s], x y z [m], qx qy qz qw of the camera in the world
    depth/000000.png     16 bit, planar z in units of depth_unit_m, 0 without a hit; or 000000.npy, float32 in metres
    rgb/000000.png       8 bit, of the size of the depth

Frame numbers start at 0, in the order of the lines.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from jaxtyping import Float
from msgspec.structs import asdict as asdict_of
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.run_folder import empty_folder
from anm_mj.io.run_shapes import IntrinsicsShape
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, require_count
from anm_mj.io.sequence_poses import bridged, camera_line, tum_matrix
from anm_mj.io.sequence_text import files_in_order, number_rows
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import Intrinsics, Observation
from anm_mj.utils.read_file import convert, read_json

_DEPTH_UNIT_M = 0.001
"""Depth unit of the PNGs of :class:`SequenceWriter` [m]."""


def read_sequence(path: Path, *, needs_poses: bool = True, ignores_poses: bool = False) -> Sequence:
    """Open a sequence of this project's own layout. Where it ``needs_poses``, it is refused without poses.tum, and
    images without a line are left out; else gaps between poses are interpolated. With ``ignores_poses`` the lines tell
    times alone. Raises RunFolderError if camera.json or poses.tum is missing or invalid.
    """
    images = len(files_in_order(path / "rgb", "*.png")) if (path / "rgb").is_dir() else 0
    try:
        camera = convert(read_json(path / "camera.json"), _CameraShape)
        is_posed = needs_poses or (path / "poses.tum").is_file()
        lines = number_rows(path / "poses.tum") if is_posed else np.zeros((0, 8))
        if lines.shape[1] != 8:
            raise ValueError("poses.tum needs eight numbers in every line")
        if not needs_poses:
            lines = _with_times(lines, images)
        require_count(len(lines))
    except (OSError, ValueError, TypeError) as err:
        raise RunFolderError(
            f"{path} is not a recorded sequence ({err}); it needs camera.json, poses.tum, depth/ and rgb/."
        ) from err
    left_out = LeftOut(max(0, images - len(lines)), images, "poses.tum has no line for them")
    found = [None if ignores_poses else _matrix(line) for line in lines]
    poses, missing = [np.full((4, 4), np.nan) if T is None else T for T in found], ()
    if not needs_poses:
        poses, missing = bridged(lines[:, 0].tolist(), found)
    frames = []
    for step, (line, T) in enumerate(zip(lines, poses, strict=True)):
        exact = path / "depth" / f"{step:06d}.npy"
        depth = exact if exact.is_file() else exact.with_suffix(".png")
        colour = path / "rgb" / f"{step:06d}.png"
        frames.append(Frame(float(line[0]), colour, depth, T))
    facts = asdict_of(camera)
    unit = facts.pop("depth_unit_m")
    return Sequence(
        path,
        Intrinsics(**facts),
        unit,
        tuple(frames),
        has_poses=needs_poses or len(missing) < len(frames),
        interpolated=missing,
        left_out=(left_out,),
    )


def _matrix(line: Float[np.ndarray, "8"]) -> Float[np.ndarray, "4 4"] | None:
    """The pose of a line, None where it is none."""
    good = np.isfinite(line).all() and line[4:].any()
    return tum_matrix(line[1:4], line[4:8]) if good else None


def _with_times(lines: Float[np.ndarray, "n 8"], images: int) -> Float[np.ndarray, "m 8"]:
    """With a line without a pose for every image that has none, and a time in every line: between those that are
    stated, else ``FRAME_S`` apart.
    """
    lines = np.concatenate((lines, np.full((max(0, images - len(lines)), 8), np.nan)))
    stated = np.flatnonzero(np.isfinite(lines[:, 0]))
    number = np.arange(len(lines))
    if not len(stated):
        lines[:, 0] = number * FRAME_S
        return lines
    outside = number - np.clip(number, stated[0], stated[-1])
    lines[:, 0] = np.interp(number, stated, lines[stated, 0]) + outside * FRAME_S
    return lines


class _CameraShape(IntrinsicsShape):
    """``camera.json``."""

    depth_unit_m: float = _DEPTH_UNIT_M


class SequenceWriter:
    """Writes observations as a sequence, frame by frame, without depths beyond 65.5 m."""

    def __init__(self, path: Path):
        """Create the folder. Raises RunFolderError if it is not empty, or cannot be created."""
        self._path = path
        self._frames = 0
        try:
            empty_folder(path)
            (path / "depth").mkdir()
            (path / "rgb").mkdir()
        except OSError as err:
            raise RunFolderError(f"{path} cannot be made ({err.strerror}); choose a folder you may write to.") from err

    def write(self, observation: Observation) -> None:
        """Add a frame. Raises RunFolderError if a file cannot be written."""
        if not self._frames:
            write_json(self._path / "camera.json", {**asdict(observation.intrinsics), "depth_unit_m": _DEPTH_UNIT_M})
        name = f"{self._frames:06d}.png"
        steps = np.nan_to_num(observation.depth_m / _DEPTH_UNIT_M, nan=0.0)
        depth = np.where(steps > np.iinfo(np.uint16).max, 0.0, np.round(steps)).astype(np.uint16)
        with writing(self._path):
            Image.fromarray(depth).save(self._path / "depth" / name, compress_level=1)
            Image.fromarray(observation.rgb).save(self._path / "rgb" / name, compress_level=1)
            with (self._path / "poses.tum").open("a", encoding="utf-8") as file:
                file.write(camera_line(observation.time_s, observation.T_world_camera) + "\n")
        self._frames += 1
