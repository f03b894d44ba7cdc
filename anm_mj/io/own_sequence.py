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
from anm_mj.io.sequence_poses import camera_line, tum_matrix
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import Intrinsics, Observation
from anm_mj.utils.read_file import convert, read_json, read_table

_DEPTH_UNIT_M = 0.001
"""Depth unit of the PNGs of :class:`SequenceWriter` [m]."""


def read_sequence(path: Path, *, needs_poses: bool = True) -> Sequence:
    """Open a sequence of this project's own layout. It is refused without poses.tum where it ``needs_poses``. Raises
    RunFolderError if camera.json or poses.tum is missing or invalid.
    """
    try:
        camera = convert(read_json(path / "camera.json"), _CameraShape)
        has_poses = needs_poses or (path / "poses.tum").is_file()
        lines = read_table(path / "poses.tum") if has_poses else _unposed_lines(path)
        if lines.shape[1] != 8:
            raise ValueError("poses.tum needs eight numbers in every line")
        require_count(len(lines))
    except (OSError, ValueError, TypeError) as err:
        raise RunFolderError(
            f"{path} is not a recorded sequence ({err}); it needs camera.json, poses.tum, depth/ and rgb/."
        ) from err
    frames = []
    images = sum(1 for _ in (path / "rgb").glob("*.png"))
    left_out = LeftOut(max(0, images - len(lines)), images, "poses.tum has no line for them")
    for step, line in enumerate(lines):
        exact = path / "depth" / f"{step:06d}.npy"
        depth = exact if exact.is_file() else exact.with_suffix(".png")
        colour = path / "rgb" / f"{step:06d}.png"
        frames.append(Frame(float(line[0]), colour, depth, _matrix(line)))
    facts = asdict_of(camera)
    unit = facts.pop("depth_unit_m")
    return Sequence(path, Intrinsics(**facts), unit, tuple(frames), has_poses=has_poses, left_out=(left_out,))


def _matrix(line: Float[np.ndarray, "8"]) -> Float[np.ndarray, "4 4"]:
    """The pose of a line, of NaN where it is none."""
    good = np.isfinite(line).all() and line[4:].any()
    return tum_matrix(line[1:4], line[4:8]) if good else np.full((4, 4), np.nan)


def _unposed_lines(path: Path) -> np.ndarray:
    """Lines for the colour images of a sequence without poses."""
    lines = np.zeros((sum(1 for _ in (path / "rgb").glob("*.png")), 8))
    lines[:, 0], lines[:, 7] = np.arange(len(lines)) * FRAME_S, 1.0
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
