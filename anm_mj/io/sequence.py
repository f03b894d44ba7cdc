"""Recorded sequences: posed RGB-D images on disk, from a simulator or a real camera (docs/robot.md).

Camera axes are x right, y down, z forward; the world has z up and the floor at z = 0. The robot's base is assumed below
the camera, with the heading of the camera.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, UInt8

from anm_mj.errors import RunFolderError
from anm_mj.frames import pixel_directions
from anm_mj.geometry.lens_distortion import LensDistortion, undistortion
from anm_mj.io.bag_poses import GAP_S
from anm_mj.io.camera_checks import FARTHEST_M, check_camera
from anm_mj.io.image import is_sentinel, read_image, read_pixels
from anm_mj.io.sequence_poses import MATCH_S, base_pose
from anm_mj.types import Intrinsics, Observation
from anm_mj.utils.file_limits import limit

_logger = logging.getLogger(__name__)

FRAME_S = 1.0 / 30.0
"""From one frame to the next, where a layout states no times [s]."""
MAX_BAD = 0.2
"""Default of :attr:`Sequence.max_bad`."""
_MAX_FRAMES = limit("ANM_MJ_MAX_FRAMES", 200_000)
_MOST_RANGES = 20
"""So many ranges of frames are named in one message."""
_MOST_STRETCHED = 0.03
"""Largest logarithm of the ratio between the aspects of an image and of the camera."""
_SAME_PX = 0.25
"""Cameras that image every direction within this distance count as one [px]."""


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
    confidence: Path | None = None
    """8-bit image of the depth's aspect: where it is 0, nothing was measured."""
    camera: Intrinsics | None = None
    """Of this frame, where it is another one than the sequence's."""


@dataclass(frozen=True)
class LeftOut:
    """Frames that are not read: ``frames`` out of ``of``, because ``why``; ``bad`` of them are a fault, None = all."""

    frames: int
    of: int
    why: str
    bad: int | None = None


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
    colour_offset_s: float = 0.0
    """Added to the times of colour images to find their depth [s]."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the origin of the frames' world lies in that of the files, turned so that z points up [m]."""
    left_out: tuple[LeftOut, ...] = ()
    """What the files hold beside the frames."""
    max_bad: float = MAX_BAD
    """Largest share of frames whose images may be such that they cannot be used."""
    reads_metres: bool = False
    """Whether functions that read depth read floating point, to which ``depth_unit_m`` does not apply."""

    def __len__(self) -> int:
        return len(self.frames)

    def observations(self, *, says_bad: bool = True, start: int = 0) -> Iterator[Observation]:
        """The frames in order; the frame number is the step of the observation.

        A frame whose images are missing or damaged, or of another size than the camera's, is left out; at the end a
        warning counts and names them. ``start`` is the first frame; ``says_bad`` False = without the warning. Raises
        RunFolderError if more than ``max_bad`` of the frames are bad.
        """
        bad: list[int] = []
        first = ""
        for step, frame in enumerate(self.frames[start:], start):
            try:
                observation = self._observation(step, frame)
            except RunFolderError as err:
                first = first or str(err)
                bad.append(step)
                if len(bad) > self.max_bad * len(self.frames):
                    raise RunFolderError(
                        f"{first} With it {len(bad)} of {len(self.frames)} frames of {self.path} cannot be used "
                        f"({ranges_text(bad)}), more than {100.0 * self.max_bad:g} % (--max-bad)."
                    ) from err
                continue
            yield observation
        if bad and says_bad:
            _logger.warning(
                "%s: %d of %d frames are left out, because their images cannot be used: %s. The first: %s",
                self.path,
                len(bad),
                len(self.frames),
                ranges_text(bad),
                first,
            )

    def _observation(self, step: int, frame: Frame) -> Observation:
        """One frame; raises RunFolderError."""
        rgb = read_image(frame.colour, "RGB") if isinstance(frame.colour, Path) else frame.colour()
        depth_m = self._depth_m(frame.depth)
        if frame.confidence is not None:
            trust = self._picked(read_image(frame.confidence, "L"), *depth_m.shape)
            depth_m = np.where(trust > 0, depth_m, np.float32(np.nan))
        camera, own = self.intrinsics, frame.camera
        if self.resize:
            if isinstance(frame.colour, Path) and self._is_stretched(*rgb.shape[:2]):
                rgb = read_image(frame.colour, "RGB", turned=True)
            self._check_shape(step, rgb.shape[:2], depth_m.shape)
            at_corner = self.keeps_corner_pixels
            # Depth whose rows and columns were reduced separately cannot be resized again: colour takes its size.
            rows, cols = depth_m.shape if at_corner else np.minimum(rgb.shape[:2], depth_m.shape).tolist()
            rgb, depth_m = self._picked(rgb, rows, cols), self._picked(depth_m, rows, cols)
            camera = camera.scaled(cols, rows, first_of_block=at_corner)
            own = None if own is None else own.scaled(cols, rows, first_of_block=at_corner)
        expected = (camera.height, camera.width)
        if depth_m.shape != expected or rgb.shape[:2] != expected:
            raise RunFolderError(
                f"Frame {step} of {self.path} has depth of {depth_m.shape} and colour of {rgb.shape[:2]} rows and "
                f"columns; the camera has {expected}."
            )
        if self.distortion is not None or own is not None:
            straight = undistortion(camera, self.distortion, own)
            rgb, depth_m = straight.colour(rgb), straight.depth(depth_m)
        if self.mirrored:
            rgb, depth_m = np.ascontiguousarray(rgb[:, ::-1]), np.ascontiguousarray(depth_m[:, ::-1])
        if self.ray_depth:
            depth_m = depth_m / np.linalg.norm(pixel_directions(camera), axis=-1).astype(np.float32)
        if self.depth_scale != 1.0:
            depth_m = depth_m * np.float32(self.depth_scale)
        pose = base_pose(frame.T_world_camera)
        return Observation(step, frame.time_s, rgb, depth_m, camera, frame.T_world_camera, pose)

    @property
    def states_metres(self) -> bool:
        """Whether its files hold depth in floating point, to which ``depth_unit_m`` does not apply; False where none
        can be read.
        """
        for frame in self.frames:
            if not isinstance(frame.depth, Path):
                return self.reads_metres
            with suppress(RunFolderError):
                return read_pixels(frame.depth).dtype.kind not in "iu"
        return False

    @property
    def stated_unit_m(self) -> float:
        """Metres per unit of the depth in its files, be it of whole numbers or not."""
        return self.depth_scale if self.states_metres else self.depth_unit_m

    def moved(self, T_new_world: Float[np.ndarray, "4 4"]) -> Sequence:
        """The same frames in another world."""
        frames = (replace(frame, T_world_camera=T_new_world @ frame.T_world_camera) for frame in self.frames)
        return replace(self, frames=tuple(frames))

    def first(self) -> Sequence:
        """The first frame that can be used, alone. Raises RunFolderError as :meth:`observations`."""
        seen = next(self.observations(says_bad=False), None)
        step = 0 if seen is None else seen.step
        return replace(self, frames=self.frames[step : step + 1], left_out=(), max_bad=0.0)

    def observation(self, step: int) -> Observation:
        """A frame by its number; raises RunFolderError if its images cannot be used."""
        return self._observation(step, self.frames[step])

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
            if self._is_stretched(rows, cols):
                raise RunFolderError(
                    f"Frame {step} of {self.path} has an image of {cols} x {rows} pixels, which is none of a camera of "
                    f"{camera.width} x {camera.height}; give the true camera, or cut the images alike."
                )

    def _is_stretched(self, rows: int, cols: int) -> bool:
        """Whether an image has another aspect than the camera's."""
        aspect = self.intrinsics.width / self.intrinsics.height
        return not (rows and cols) or abs(math.log(cols / (rows * aspect))) > _MOST_STRETCHED

    def _picked(self, image: np.ndarray, rows: int, cols: int) -> np.ndarray:
        if image.shape[:2] == (rows, cols):
            return image
        middle = 0.0 if self.keeps_corner_pixels else 0.5
        row, col = (
            np.floor((np.arange(count) + middle) * size / count).astype(np.int64)
            for count, size in zip((rows, cols), image.shape[:2], strict=True)
        )
        return np.ascontiguousarray(image[np.ix_(row, col)])

    def _metres(self, stated: np.ndarray) -> Float32[np.ndarray, "..."]:
        """Depth as a file states it, in metres; NaN where a whole number is that of "nothing measured"."""
        # Floating point is in metres.
        if stated.dtype.kind not in "iu":
            return stated.astype(np.float32)
        depth_m = stated.astype(np.float32) * np.float32(self.depth_unit_m)
        return np.where(is_sentinel(stated), np.float32(np.nan), depth_m)

    def _depth_m(self, path: Path | Callable[[], Float32[np.ndarray, "h w"]]) -> Float32[np.ndarray, "h w"]:
        depth_m = self._metres(read_pixels(path)) if isinstance(path, Path) else path()
        if depth_m.ndim != 2:
            raise RunFolderError(f"{path} is no depth image: it has {depth_m.ndim} axes, such as colours, not 2.")
        # Damaged floats are next to 0, too; the inverse of those is none.
        return np.where((depth_m > 1e-6) & (depth_m <= FARTHEST_M), depth_m, np.float32(np.nan))


@dataclass(frozen=True)
class SequenceOptions:
    """What the files of a sequence do not say, or say wrongly; None = as they say, or as the layout has it."""

    layout: str | None = None
    """A key of :data:`anm_mj.io.layout_table.LAYOUTS`, or ``rosbag``."""
    camera: tuple[float, float, float, float] | None = None
    """fx, fy, cx, cy [px]; the principal point measured from the corner of the image."""
    depth_unit_m: float | None = None
    """Metres per unit of a depth image, also of one in floating point, which is in metres else."""
    up: str | None = None
    """Axis of the sequence's world that points up: ``z``, ``-z``, ``y`` or ``-y``; None = as in the layout. Without
    poses that world is the first camera's: None = -y, a camera that is held level; ``floor`` = as the floor that it
    shows says."""
    floor_m: float | None = None
    """Height of the floor along that axis [m]; None = 0 in layouts of ours, found from the depth in others, without
    poses from that of the first frame."""
    every: int = 1
    """Only every n-th frame is read."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Of a ROS bag, by role; see :mod:`anm_mj.io.rosbag`."""
    needs_poses: bool = True
    """Whether frames without a pose are left out; else they are interpolated, or there are none at all."""
    ignores_poses: bool = False
    """Whether the poses of the files are not used."""
    distortion: LensDistortion | Literal["files"] | None = "files"
    """Of the lens; None = there is none, ``files`` = as they say."""
    match_s: float = MATCH_S
    """Colour and depth with times of their own belong together up to this difference [s]."""
    max_gap_s: float = GAP_S
    """Poses are interpolated between two that lie no farther apart [s]."""
    max_bad: float = MAX_BAD
    """A sequence with a larger share of frames that cannot be used is refused."""
    judge: Callable[[Sequence, str], tuple[Sequence, str]] | None = None
    """Looks at the sequence as its files state it, and at the axis that is taken to point up, before the floor is
    looked for; gives both back, put right."""


def with_cameras(frames: list[Frame], cameras: list[Intrinsics]) -> tuple[Intrinsics, tuple[Frame, ...]]:
    """The median camera, and the frames, each with its own camera where that differs from it. There is one frame at
    least. Raises ValueError if they are of images of different sizes, or one can be that of no camera.
    """
    for camera in cameras:
        check_camera(camera)
    sizes = {(camera.width, camera.height) for camera in cameras}
    if len(sizes) > 1:
        raise ValueError(f"its frames have cameras of different sizes {sorted(sizes)}; map those of each size alone")
    numbers = np.array([astuple(camera) for camera in cameras], np.float64)
    median = np.median(numbers, axis=0)
    width, height, fx, fy = median[:4]
    reach = 0.5 * np.array([width / fx, height / fy])
    off_px = (np.abs(numbers[:, 2:4] - median[2:4]) * reach + np.abs(numbers[:, 4:] - median[4:])).max(axis=1)
    own = off_px > _SAME_PX
    if own.any():
        _logger.info(
            "%d of %d frames have cameras that differ from the median one by up to %.2g px: each is seen by its own.",
            np.count_nonzero(own),
            len(own),
            off_px.max(),
        )
    common = Intrinsics(int(width), int(height), *median[2:].tolist())
    each = zip(frames, cameras, own.tolist(), strict=True)
    return common, tuple(replace(frame, camera=camera) if differs else frame for frame, camera, differs in each)


def require_count(frames: int) -> None:
    """Raises ValueError where a sequence has more frames than are read."""
    if frames > _MAX_FRAMES:
        raise ValueError(f"its {frames} frames are more than {_MAX_FRAMES}; set ANM_MJ_MAX_FRAMES if there should be")


def ranges_text(numbers: list[int]) -> str:
    """Ascending whole numbers, one at least, in words: ``3-7, 9``, the first ranges of many."""
    ranges = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    words = [str(one[0]) if len(one) == 1 else f"{one[0]}-{one[-1]}" for one in ranges[:_MOST_RANGES]]
    return ", ".join(words) + (f" and {len(ranges) - _MOST_RANGES} more" if len(ranges) > _MOST_RANGES else "")


def from_pixel_centres(width: int, height: int, camera: tuple[float, ...]) -> Intrinsics:
    """A camera of fx, fy, cx, cy [px] whose principal point was measured from the centre of the first pixel."""
    fx, fy, cx, cy = camera
    return Intrinsics(int(width), int(height), fx, fy, cx + 0.5, cy + 0.5)
