"""Recorded sequences: posed RGB-D images on disk, from a simulator or a real camera (docs/robot.md).

    camera.json          {"width", "height", "fx", "fy", "cx", "cy": pixels, "depth_unit_m": metres per unit of a PNG}
    poses.tum            one line per frame: time [s], x y z [m], qx qy qz qw of the camera in the world
    depth/000000.png     16 bit, planar z in units of depth_unit_m, 0 without a hit; or 000000.npy, float32 in metres
    rgb/000000.png       8 bit, of the size of the depth

Camera axes are x right, y down, z forward; the world has z up and the floor at z = 0. Frame numbers start at 0, in the
order of the lines. The robot's base is assumed below the camera, with the heading of the camera.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.io.image import read_image
from anm_mj.io.run_folder import empty_folder
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import Intrinsics, Observation, Pose2

DEPTH_UNIT_M = 0.001
"""Depth unit of the PNGs of :class:`SequenceWriter` [m]."""


@dataclass(frozen=True)
class Sequence:
    """A folder of posed RGB-D frames; iteration reads them one by one."""

    path: Path
    intrinsics: Intrinsics
    depth_unit_m: float
    time_s: tuple[float, ...]
    T_world_camera: Float[np.ndarray, "n 4 4"]

    def __len__(self) -> int:
        return len(self.time_s)

    def observations(self) -> Iterator[Observation]:
        """The frames in order; the frame number is the step of the observation.

        Raises:
            RunFolderError: an image is missing or damaged, or its size differs from camera.json.
        """
        for step, (time_s, T_world_camera) in enumerate(zip(self.time_s, self.T_world_camera, strict=True)):
            rgb = read_image(self.path / "rgb" / f"{step:06d}.png", "RGB")
            depth_m = self._depth_m(step)
            expected = (self.intrinsics.height, self.intrinsics.width)
            if depth_m.shape != expected or rgb.shape[:2] != expected:
                raise RunFolderError(
                    f"Frame {step} of {self.path} has depth of {depth_m.shape} and colour of {rgb.shape[:2]} rows and "
                    f"columns; camera.json says {expected}."
                )
            pose = base_pose(T_world_camera)
            yield Observation(step, time_s, rgb, depth_m, self.intrinsics, T_world_camera, pose)

    def _depth_m(self, step: int) -> Float32[np.ndarray, "h w"]:
        exact = self.path / "depth" / f"{step:06d}.npy"
        if exact.is_file():
            try:
                depth_m = np.load(exact).astype(np.float32)
            except (OSError, ValueError, EOFError) as err:
                raise RunFolderError(f"{exact} cannot be read ({err}).") from err
        else:
            steps = read_image(exact.with_suffix(".png"))
            depth_m = steps.astype(np.float32) * np.float32(self.depth_unit_m)
        return np.where(depth_m > 0.0, depth_m, np.float32(np.nan))


def read_sequence(path: Path) -> Sequence:
    """Open a sequence.

    Raises:
        RunFolderError: camera.json or poses.tum is missing or invalid.
    """
    try:
        camera = json.loads((path / "camera.json").read_text(encoding="utf-8"))
        unit = float(camera.pop("depth_unit_m", DEPTH_UNIT_M))
        intrinsics = Intrinsics(**camera)
        lines = np.loadtxt(path / "poses.tum", ndmin=2)
        if lines.shape[1] != 8 or not np.isfinite(lines).all():
            raise ValueError("poses.tum needs eight numbers in every line")
    except (OSError, ValueError, TypeError) as err:
        raise RunFolderError(
            f"{path} is not a recorded sequence ({err}); it needs camera.json, poses.tum, depth/ and rgb/."
        ) from err
    poses = np.stack([_matrix(line[1:4], line[4:8]) for line in lines])
    return Sequence(path, intrinsics, unit, tuple(lines[:, 0].tolist()), poses)


class SequenceWriter:
    """Writes observations as a sequence, frame by frame, without depths beyond 65.5 m."""

    def __init__(self, path: Path):
        """Create the folder.

        Raises:
            RunFolderError: it is not empty, or cannot be created.
        """
        self._path = path
        self._frames = 0
        try:
            empty_folder(path)
            (path / "depth").mkdir()
            (path / "rgb").mkdir()
        except OSError as err:
            raise RunFolderError(f"{path} cannot be made ({err.strerror}); choose a folder you may write to.") from err

    def write(self, observation: Observation) -> None:
        """Add a frame.

        Raises:
            RunFolderError: a file cannot be written.
        """
        if not self._frames:
            write_json(self._path / "camera.json", {**asdict(observation.intrinsics), "depth_unit_m": DEPTH_UNIT_M})
        name = f"{self._frames:06d}.png"
        steps = np.nan_to_num(observation.depth_m / DEPTH_UNIT_M, nan=0.0)
        depth = np.where(steps > np.iinfo(np.uint16).max, 0.0, np.round(steps)).astype(np.uint16)
        with writing(self._path):
            Image.fromarray(depth).save(self._path / "depth" / name, compress_level=1)
            Image.fromarray(observation.rgb).save(self._path / "rgb" / name, compress_level=1)
            with (self._path / "poses.tum").open("a", encoding="utf-8") as file:
                file.write(_tum_line(observation.time_s, observation.T_world_camera) + "\n")
        self._frames += 1


def base_pose(T_world_camera: Float[np.ndarray, "4 4"]) -> Pose2:
    """Pose of a base below a camera: heading of the camera's axis, or of its upper edge if it looks straight down."""
    ahead = T_world_camera[:3, 2] if abs(T_world_camera[2, 2]) < 0.99 else -T_world_camera[:3, 1]
    x, y = T_world_camera[:2, 3].tolist()
    return Pose2(x, y, math.atan2(ahead[1], ahead[0]))


def _tum_line(time_s: float, T_world_camera: Float[np.ndarray, "4 4"]) -> str:
    values = (time_s, *T_world_camera[:3, 3], *Rotation.from_matrix(T_world_camera[:3, :3]).as_quat())
    return " ".join(f"{value:.9g}" for value in values)


def _matrix(xyz_m: Float[np.ndarray, "3"], quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 4"]:
    """Raises ValueError if the quaternion is zero."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    pose[:3, 3] = xyz_m
    return pose
