"""Recorded sequences: posed RGB-D images on disk, from a simulator or a real camera (docs/robot.md).

    camera.json          {"width", "height", "fx", "fy", "cx", "cy": pixels, "depth_unit_m": metres per unit of a PNG}
    poses.tum            one line per frame: time [s], x y z [m], qx qy qz qw of the camera in the world
    depth/000000.png     16 bit, planar z in units of depth_unit_m, 0 without a hit; or 000000.npy, float32 in metres
    rgb/000000.png       8 bit, of the size of the depth

Camera axes are x right, y down, z forward; the world has z up and the floor at z = 0. Frame numbers start at 0, in the
order of the lines. The robot's base is assumed below the camera, with the heading of the camera.
"""

from __future__ import annotations

import logging
import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt8
from msgspec.structs import asdict as asdict_of
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from anm_mj.errors import RunFolderError
from anm_mj.frames import pixel_directions, rigid_transform
from anm_mj.geometry.lens_distortion import LensDistortion, undistortion
from anm_mj.io.camera_checks import FARTHEST_M
from anm_mj.io.image import read_image
from anm_mj.io.run_folder import empty_folder
from anm_mj.io.run_shapes import IntrinsicsShape
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import Intrinsics, Observation, Pose2
from anm_mj.utils.file_limits import limit
from anm_mj.utils.read_file import convert, is_below, read_json, read_npy, read_table

_logger = logging.getLogger(__name__)

MATCH_S = 0.02
"""Images and poses with times of their own belong together up to this difference [s]."""
FRAME_S = 1.0 / 30.0
"""From one frame to the next, where a layout states no times [s]."""
_DEPTH_UNIT_M = 0.001
"""Depth unit of the PNGs of :class:`SequenceWriter` [m]."""
_MAX_FRAMES = limit("ANM_MJ_MAX_FRAMES", 200_000)
_MOST_RANGES = 20
"""So many ranges of frames are named in one message."""
_MOST_STRETCHED = 0.03
"""Largest logarithm of the ratio between the aspects of an image and of the camera."""


class _CameraShape(IntrinsicsShape):
    """``camera.json``."""

    depth_unit_m: float = _DEPTH_UNIT_M


@dataclass(frozen=True)
class Frame:
    """The images of one posed RGB-D frame."""

    time_s: float
    colour: Path | Callable[[], UInt8[np.ndarray, "h w 3"]]
    """The file, or what reads it out of a recording."""
    depth: Path | Callable[[], Float32[np.ndarray, "h w"]]
    """16-bit PNG in units of ``depth_unit_m``, or ``.npy``, float32 in metres; 0 or NaN where nothing. A function gives
    metres."""
    T_world_camera: Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Sequence:
    """Posed RGB-D frames on disk; iteration reads them one by one."""

    path: Path
    intrinsics: Intrinsics
    depth_unit_m: float
    frames: tuple[Frame, ...]
    resize: bool = False
    """Whether colour and depth may differ in size; the smaller one counts then, and ``intrinsics`` are scaled to it."""
    keeps_corner_pixels: bool = False
    """Whether a smaller image holds the first pixel of each block of a larger one, as in a run folder, instead of the
    middle of the block."""
    distortion: LensDistortion | None = None
    """Of colour and depth alike; it is taken out of the observations."""
    has_poses: bool = True
    """Whether the poses of frames mean something; else all are the same."""
    interpolated: tuple[int, ...] = ()
    """Frames whose pose no file states."""
    assumes_camera: bool = False
    """Whether no file states the camera: it is the one that the layout's data set has."""
    depth_scale: float = 1.0
    """True depth per depth that the files state."""
    ray_depth: bool = False
    """Whether the files state distances along the rays instead of planar depth."""
    mirrored: bool = False
    """Whether the images are mirrored left to right."""

    def __len__(self) -> int:
        return len(self.frames)

    def observations(self) -> Iterator[Observation]:
        """The frames in order; the frame number is the step of the observation.

        Raises:
            RunFolderError: an image is missing or damaged, or its size is another than the camera's.
        """
        for step, frame in enumerate(self.frames):
            rgb = read_image(frame.colour, "RGB") if isinstance(frame.colour, Path) else frame.colour()
            depth_m = self._depth_m(frame.depth)
            camera = self.intrinsics
            if self.resize:
                self._check_shape(step, rgb.shape[:2], depth_m.shape)
                rows, cols = np.minimum(rgb.shape[:2], depth_m.shape).tolist()
                rgb, depth_m = self._picked(rgb, rows, cols), self._picked(depth_m, rows, cols)
                camera = self._scaled(cols, rows)
            expected = (camera.height, camera.width)
            if depth_m.shape != expected or rgb.shape[:2] != expected:
                raise RunFolderError(
                    f"Frame {step} of {self.path} has depth of {depth_m.shape} and colour of {rgb.shape[:2]} rows and "
                    f"columns; the camera has {expected}."
                )
            if self.distortion is not None:
                straight = undistortion(camera, self.distortion)
                rgb, depth_m = straight.colour(rgb), straight.depth(depth_m)
            if self.mirrored:
                rgb, depth_m = np.ascontiguousarray(rgb[:, ::-1]), np.ascontiguousarray(depth_m[:, ::-1])
            if self.ray_depth:
                depth_m = depth_m / np.linalg.norm(pixel_directions(camera), axis=-1).astype(np.float32)
            if self.depth_scale != 1.0:
                depth_m = depth_m * np.float32(self.depth_scale)
            pose = base_pose(frame.T_world_camera)
            yield Observation(step, frame.time_s, rgb, depth_m, camera, frame.T_world_camera, pose)

    def moved(self, T_new_world: Float[np.ndarray, "4 4"]) -> Sequence:
        """The same frames in another world."""
        frames = (replace(frame, T_world_camera=T_new_world @ frame.T_world_camera) for frame in self.frames)
        return replace(self, frames=tuple(frames))

    def first(self) -> Sequence:
        """The first frame alone."""
        return replace(self, frames=self.frames[:1])

    def without_poses(self) -> Sequence:
        """The same frames, all of them at the origin."""
        frames = (replace(frame, T_world_camera=np.eye(4)) for frame in self.frames)
        return replace(self, frames=tuple(frames), has_poses=False, interpolated=())

    def _check_shape(self, step: int, *shapes: tuple[int, ...]) -> None:
        """Raises RunFolderError for images that are not the camera's, be they larger or smaller."""
        camera = self.intrinsics
        # A run folder reduces rows and columns each for itself.
        if self.keeps_corner_pixels:
            return
        for rows, cols in shapes:
            if not (rows and cols) or abs(math.log(cols * camera.height / (rows * camera.width))) > _MOST_STRETCHED:
                raise RunFolderError(
                    f"Frame {step} of {self.path} has an image of {cols} x {rows} pixels, which is none of a camera of "
                    f"{camera.width} x {camera.height}; give the true camera, or cut the images alike."
                )

    def _picked(self, image: np.ndarray, rows: int, cols: int) -> np.ndarray:
        if image.shape[:2] == (rows, cols):
            return image
        middle = 0.0 if self.keeps_corner_pixels else 0.5
        row, col = (
            np.floor((np.arange(count) + middle) * size / count).astype(np.int64)
            for count, size in zip((rows, cols), image.shape[:2], strict=True)
        )
        return np.ascontiguousarray(image[np.ix_(row, col)])

    def _scaled(self, width: int, height: int) -> Intrinsics:
        camera = self.intrinsics
        x, y = width / camera.width, height / camera.height
        # The first pixel of a block has its centre half a pixel of the larger image from the block's corner.
        u, v = (0.5 * (1.0 - x), 0.5 * (1.0 - y)) if self.keeps_corner_pixels else (0.0, 0.0)
        return Intrinsics(width, height, camera.fx * x, camera.fy * y, camera.cx * x + u, camera.cy * y + v)

    def _depth_m(self, path: Path | Callable[[], Float32[np.ndarray, "h w"]]) -> Float32[np.ndarray, "h w"]:
        if not isinstance(path, Path):
            depth_m = path()
        elif path.suffix == ".npy":
            try:
                depth_m = read_npy(path)
                if depth_m.dtype.kind not in "fiu":
                    raise ValueError(f"it holds {depth_m.dtype}, which is no depth")
                unit = self.depth_unit_m if depth_m.dtype.kind in "iu" else 1.0
                depth_m = depth_m.astype(np.float32) * np.float32(unit)
            except (OSError, ValueError) as err:
                raise RunFolderError(f"{path} cannot be read ({err}).") from err
        else:
            stated = read_image(path)
            # Floating point is in metres.
            unit = self.depth_unit_m if stated.dtype.kind in "iu" else 1.0
            depth_m = stated.astype(np.float32) * np.float32(unit)
        if depth_m.ndim != 2:
            raise RunFolderError(f"{path} is no depth image: it has {depth_m.ndim} axes, such as colours, not 2.")
        return np.where((depth_m > 0.0) & (depth_m <= FARTHEST_M), depth_m, np.float32(np.nan))


def read_sequence(path: Path, *, needs_poses: bool = True) -> Sequence:
    """Open a sequence of this project's own layout.

    Args:
        path: Its folder.
        needs_poses: Whether it is refused without poses.tum.

    Raises:
        RunFolderError: camera.json or poses.tum is missing or invalid.
    """
    try:
        camera = convert(read_json(path / "camera.json"), _CameraShape)
        has_poses = needs_poses or (path / "poses.tum").is_file()
        lines = read_table(path / "poses.tum") if has_poses else _unposed_lines(path)
        if lines.shape[1] != 8 or not np.isfinite(lines).all():
            raise ValueError("poses.tum needs eight numbers in every line")
        require_count(len(lines))
    except (OSError, ValueError, TypeError) as err:
        raise RunFolderError(
            f"{path} is not a recorded sequence ({err}); it needs camera.json, poses.tum, depth/ and rgb/."
        ) from err
    frames = []
    left = sum(1 for _ in (path / "rgb").glob("*.png")) - len(lines)
    if left > 0:
        _logger.warning("%s: %d of its images are left out, because poses.tum has no line for them.", path, left)
    for step, line in enumerate(lines):
        exact = path / "depth" / f"{step:06d}.npy"
        depth = exact if exact.is_file() else exact.with_suffix(".png")
        colour = path / "rgb" / f"{step:06d}.png"
        frames.append(Frame(float(line[0]), colour, depth, tum_matrix(line[1:4], line[4:8])))
    facts = asdict_of(camera)
    unit = facts.pop("depth_unit_m")
    return Sequence(path, Intrinsics(**facts), unit, tuple(frames), has_poses=has_poses)


def _unposed_lines(path: Path) -> np.ndarray:
    """Lines for the colour images of a sequence without poses."""
    lines = np.zeros((sum(1 for _ in (path / "rgb").glob("*.png")), 8))
    lines[:, 0], lines[:, 7] = np.arange(len(lines)) * FRAME_S, 1.0
    return lines


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


def say_left_out(folder: Path, kept: int, listed: int, why: str) -> None:
    """Warn of frames that are not read."""
    if kept < listed:
        _logger.warning("%s: %d of %d frames are left out, because %s.", folder, listed - kept, listed, why)


def require_below(folder: Path, frames: Iterable[Frame]) -> None:
    """Raises RunFolderError where an image lies outside of a sequence's folder."""
    for frame in frames:
        for file in (frame.colour, frame.depth):
            if isinstance(file, Path) and not is_below(file, folder):
                raise RunFolderError(f"{folder} names {file}, which lies outside of it; copy the image there.")


def require_count(frames: int) -> None:
    """Raises ValueError where a sequence has more frames than are read."""
    if frames > _MAX_FRAMES:
        raise ValueError(f"its {frames} frames are more than {_MAX_FRAMES}; set ANM_MJ_MAX_FRAMES if there should be")


def base_pose(T_world_camera: Float[np.ndarray, "4 4"]) -> Pose2:
    """Pose of a base below a camera: heading of the camera's axis, or of its upper edge if it looks straight down."""
    ahead = T_world_camera[:3, 2] if abs(T_world_camera[2, 2]) < 0.99 else -T_world_camera[:3, 1]
    x, y = T_world_camera[:2, 3].tolist()
    return Pose2(x, y, math.atan2(ahead[1], ahead[0]))


def camera_line(time_s: float, T_world_camera: Float[np.ndarray, "4 4"]) -> str:
    """A camera pose in the TUM format: seconds, position [m], quaternion with the scalar last."""
    values = (*T_world_camera[:3, 3], *Rotation.from_matrix(T_world_camera[:3, :3]).as_quat())
    return " ".join((time_text(time_s), *(f"{value:.9g}" for value in values)))


def time_text(time_s: float) -> str:
    """A time in the TUM format, to the microsecond also where it is counted from 1970."""
    return f"{time_s:.9g}" if abs(time_s) < 1e4 else f"{time_s:.6f}"


def bridged(
    times_s: list[float], poses: list[Float[np.ndarray, "4 4"] | None]
) -> tuple[list[Float[np.ndarray, "4 4"]], tuple[int, ...]]:
    """Poses without gaps, and the frames that had none: in a gap they lie between those before and after it.

    Where no frame has any, all are at the origin.
    """
    known = [k for k, pose in enumerate(poses) if pose is not None]
    missing = [k for k, pose in enumerate(poses) if pose is None]
    if not known:
        return [np.eye(4)] * len(poses), tuple(missing)
    at = np.array([times_s[k] for k in known])
    stated = np.array([poses[k] for k in known])
    at, first = np.unique(at, return_index=True)
    stated = stated[first]
    filled = [np.eye(4) if pose is None else pose for pose in poses]
    if missing:
        wanted = np.clip([times_s[k] for k in missing], at[0], at[-1])
        xyz = np.stack([np.interp(wanted, at, stated[:, axis, 3]) for axis in range(3)], axis=1)
        # One pose alone has no other to turn to.
        turned = Slerp(at, Rotation.from_matrix(stated[:, :3, :3]))(wanted).as_matrix() if len(at) > 1 else None
        for place, k in enumerate(missing):
            rotation = stated[0, :3, :3] if turned is None else turned[place]
            filled[k] = rigid_transform(rotation.ravel(), xyz[place])
    return filled, tuple(missing)


def ranges_text(numbers: list[int]) -> str:
    """Ascending whole numbers in words: ``3-7, 9``, the first ranges of many."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    words = [str(low) if low == high else f"{low}-{high}" for low, high in ranges[:_MOST_RANGES]]
    return ", ".join(words) + (f" and {len(ranges) - _MOST_RANGES} more" if len(ranges) > _MOST_RANGES else "")


def tum_matrix(xyz_m: Float[np.ndarray, "3"], quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 4"]:
    """A pose from a position [m] and a quaternion with the scalar last; raises ValueError if it is zero."""
    return rigid_transform(Rotation.from_quat(quaternion).as_matrix().ravel(), xyz_m)


def nearest_index(times_s: list[float], time_s: float) -> int | None:
    """Index of the nearest of times in ascending order; None if it is more than ``MATCH_S`` away."""
    after = bisect_left(times_s, time_s)
    near = range(max(0, after - 1), min(after + 1, len(times_s)))
    nearest = min(near, key=lambda index: abs(times_s[index] - time_s), default=None)
    return None if nearest is None or not abs(times_s[nearest] - time_s) <= MATCH_S else nearest


def from_pixel_centres(width: int, height: int, camera: tuple[float, ...]) -> Intrinsics:
    """A camera of fx, fy, cx, cy [px] whose principal point was measured from the centre of the first pixel."""
    fx, fy, cx, cy = camera
    return Intrinsics(int(width), int(height), fx, fy, cx + 0.5, cy + 0.5)
