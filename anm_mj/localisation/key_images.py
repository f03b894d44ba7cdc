"""Earlier frames that new ones are registered to, beside the field.

Where two frames overlap, their depth and grey values tell the motion between them more sharply than a field that has
just begun to learn what they show; the field keeps them all from drifting apart.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float16, Float32, Float64, UInt8
from scipy import ndimage

from anm_mj import _native
from anm_mj.localisation.localisation_config import KeyImageConfig
from anm_mj.localisation.se3 import carried
from anm_mj.mapping.alignment import FramePoints
from anm_mj.mapping.occupancy_kernels import DepthFrame
from anm_mj.sensing.pixel_state import is_measured
from anm_mj.types import Intrinsics, Observation

_MOST_TRIED, _LATEST_TRIED = 12, 3
"""Images that are looked at for the oldest that shows enough, and for the latest that shows most."""
_LITTLE_NOISE_PER_M = 2e-4
"""Sensors with less depth noise give normals from pixel to pixel [1/m]."""
_RADIUS_PX = 2
"""Depth of others is averaged over squares that reach so far."""
_PLANE_SPREAD = 0.05
"""Inverse depth that spreads by a larger share of itself over such a square is an edge."""
COARSE = 4
"""Side of the squares whose grey values are averaged [px]."""
_OVERLAP_STEP = 8
"""Of so many points one is looked for in other images, to say how much they show of them."""
_NEARNESS = 0.05
"""Depths that differ by a smaller share of themselves may be of the same surface."""
_MOST_SCALE = 2.0
"""What is seen from more than so many times the distance looks otherwise."""
_GRAY = np.array([0.299, 0.587, 0.114], np.float32)


class Sums(NamedTuple):
    """Normal equations of a frame's points, and what they come from."""

    hessian: Float64[np.ndarray, "6 6"]
    gradient: Float64[np.ndarray, "6"]
    cost: float
    """Robust cost, in squared standard deviations."""
    num_points: float
    """Points that took part; the others cost as much as the worst of outliers."""
    mean_gray_cost: float
    """Of a point's grey value, in squared standard deviations."""

    def fit(self, kernel: float) -> float:
        """How well the points fit, in [0, 1]: the mean of their robust weights, with a kernel of this width."""
        # Geman and McClure's cost saturates: what it lacks of the worst is how well the points fit.
        return 1.0 - self.cost / (self.num_points * kernel**2) if self.num_points else 0.0


@dataclass
class KeyImage:
    """A posed frame at reduced size; numbers of few bits, as there are many."""

    depth_m: Float16[np.ndarray, "h w"]
    """Planar depth [m]; negative where it lies on no plane, 0 or not finite where nothing was measured."""
    gray: UInt8[np.ndarray, "h w"]
    coarse: UInt8[np.ndarray, "h4 w4"]
    """Means of grey values over squares of four by four pixels: what is not yet near finds its way by them."""
    camera: Float64[np.ndarray, "4"]
    """fx, fy, cx, cy [px]."""
    T_world_camera: Float[np.ndarray, "4 4"]
    step: int
    covariance: Float[np.ndarray, "6 6"] = field(default_factory=lambda: np.zeros((6, 6)))
    """Of its pose in the world, as of :class:`~.localiser.PoseEstimate`."""
    radius_px: int = 0
    """Depth is the mean of a square about each pixel that reaches so far."""
    node: int = -1
    """Number of its keyframe; -1 before it has one."""
    moved: Bool[np.ndarray, "h w"] | None = None
    """Pixels that show what moved; None = none does."""
    range_m: float = math.inf
    """As of :attr:`~anm_mj.types.Observation.known_range_m` [m]."""

    def arrays(self, coarse: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
        """Depth, grey values, camera, pose, and from how far normals are taken [px], for native code."""
        gray = self.coarse if coarse else self.gray
        return self.depth_m.view(np.uint16), gray, self.camera, self.T_world_camera, self.radius_px + 1

    @property
    def frame(self) -> DepthFrame:
        """What the occupancy grid takes."""
        height, width = self.depth_m.shape
        fx, fy, cx, cy = self.camera.tolist()
        depth = np.where(self.depth_m > 0.0, self.depth_m, np.nan).astype(np.float32)
        moved_m = None
        if self.moved is not None:
            moved_m = np.where(self.moved, depth, np.float32(np.nan))
            depth[self.moved] = np.nan
        return DepthFrame(depth, Intrinsics(width, height, fx, fy, cx, cy), self.T_world_camera, self.range_m, moved_m)


def gray_values(rgb: Float32[np.ndarray, "... 3"]) -> Float32[np.ndarray, "..."]:
    """Luma of colours, in their range."""
    return rgb @ _GRAY


def key_image(observation: Observation, longest_px: int, noise_per_m: float = 0.0) -> KeyImage:
    """A frame, reduced by a whole factor to at most so many pixels along its longer side.

    Grey values are averaged, depth is picked, so that no pixel lies between two surfaces. Normals of noisy depth would
    mean nothing: then inverse depth, which is linear over a plane, is averaged about each pixel away from edges.
    """
    k = observation.intrinsics
    factor, picked = _picked(k, longest_px)
    gray = gray_values(observation.rgb.astype(np.float32))
    if factor > 1:
        # About the picked pixel: the mean of an even block would stand half a pixel beside its ray.
        gray = ndimage.uniform_filter(gray, factor | 1, mode="nearest")[picked]
    # The picked pixel's centre is the reduced pixel's; of an even factor it lies half a pixel behind the middle.
    shift = 0.5 - (factor // 2 + 0.5) / factor
    camera = np.array([k.fx / factor, k.fy / factor, k.cx / factor + shift, k.cy / factor + shift])
    radius = 0
    depth = np.ascontiguousarray(observation.depth_m[picked], np.float32)
    if math.isfinite(noise_per_m) and noise_per_m > _LITTLE_NOISE_PER_M:
        radius = _RADIUS_PX
        depth = smoothed_depth(depth, radius, noise_per_m)
    with np.errstate(over="ignore"):
        half = depth.astype(np.float16)
    fine, T_world_camera = np.rint(gray).astype(np.uint8), observation.T_world_camera
    range_m = observation.known_range_m
    return KeyImage(
        half, fine, coarse_gray(gray), camera, T_world_camera, observation.step, radius_px=radius, range_m=range_m
    )


def _picked(k: Intrinsics, longest_px: int) -> tuple[int, tuple[slice, slice]]:
    """By how much a frame is reduced, and the rows and columns that are left."""
    factor = max(1, math.ceil(max(k.width, k.height) / longest_px))
    rows, cols = k.height // factor, k.width // factor
    return factor, (slice(factor // 2, rows * factor, factor), slice(factor // 2, cols * factor, factor))


def coarse_gray(gray: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h4 w4"]:
    """Means over squares; what is left over at the right and below is left out."""
    rows, cols = gray.shape[0] // COARSE, gray.shape[1] // COARSE
    squares = gray[: rows * COARSE, : cols * COARSE].reshape(rows, COARSE, cols, COARSE)
    return np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)


def smoothed_depth(
    depth_m: Float32[np.ndarray, "h w"], radius_px: int, noise_per_m: float
) -> Float32[np.ndarray, "h w"]:
    """The mean of inverse depth over squares, as depth [m]; at edges what was measured, negative; else 0."""
    depth = np.where(is_measured(depth_m), depth_m, np.float32(0.0))
    return _native.smoothed_depth(depth, radius_px, noise_per_m, _PLANE_SPREAD)


class KeyImages:
    """Keeps key images, and chooses those that a frame is registered to."""

    def __init__(self, config: KeyImageConfig) -> None:
        """Without any image."""
        self.config = config
        self.images: list[KeyImage] = []
        self._last: KeyImage | None = None
        """Of the last frame whose pose is known."""
        self._reference: tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"]] | None = None
        """Pose of an earlier frame that shows the same part of the map as the present one, and its covariance."""

    def see(self, image: KeyImage | None) -> None:
        """Take a frame whose pose is known as the last one, until the next; None = that does not follow a known one."""
        self._last = image

    def add(
        self, observation: Observation, noise_per_m: float, covariance: Float[np.ndarray, "6 6"] | None = None
    ) -> None:
        """Keep a frame whose pose is known, with its covariance in the world, None = it is exact. The sensor's depth
        deviates by ``noise_per_m`` times its square.
        """
        image = self._last
        if image is None or image.T_world_camera is not observation.T_world_camera:
            image = key_image(observation, self.config.longest_px, noise_per_m)
            image = image if covariance is None else replace(image, covariance=covariance)
        if observation.moved_m is not None:
            # Frames are compared with all of it, but no map is made of what moved.
            image.moved = np.isfinite(observation.moved_m[_picked(observation.intrinsics, self.config.longest_px)[1]])
        self.images.append(image)
        if len(self.images) > self.config.most_images:
            poses = np.stack([image.T_world_camera for image in self.images])
            apart = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
            turned = np.linalg.norm(np.diff(poses[:, :3, 2], axis=0), axis=1)
            # The later one of the two, as the earlier has drifted less; never the last, which the next frame resembles.
            del self.images[1 + int(np.argmin((apart + turned)[:-1]))]

    def overlapping(
        self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], slack_m: float = 0.0
    ) -> list[KeyImage]:
        """The oldest images that show enough of a frame, as they drifted least, and the latest that shows most.

        ``slack_m`` is by how far the pose may be off [m]: near a wall that is a large share of the depth.
        """
        config = self.config
        near = self._near(T_world_camera)
        late = near[-_LATEST_TRIED:] + ([] if self._last is None else [self._last])
        early = near[:_MOST_TRIED] if config.num_images > 1 else []
        share = _shares_in([*early, *late], points, T_world_camera, slack_m)
        enough = (k for k in range(len(early)) if share[k] >= config.least_overlap)
        chosen = [early[k] for k in itertools.islice(enough, max(0, config.num_images - 1))]
        if late:
            best = late[int(np.argmax(share[len(early) :]))]
            chosen += [best] if all(best.step != image.step for image in chosen) else []
        return chosen

    def refer_to(self, images: Sequence[KeyImage], T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """The oldest image that shows the same part of the map tells how well its place is known.

        That is the oldest of the images that a frame is compared with, or of those that were taken near its camera. The
        last frame is none: its covariance holds that of the map already, which would be added again with every frame.
        """
        kept = [image for image in images if image is not self._last]
        kept = kept or self._near(T_world_camera)
        if kept:
            self._reference = kept[0].T_world_camera, kept[0].covariance

    def map_covariance(self, T_world_camera: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6 6"]:
        """How uncertain the map stands in the world where a camera sees it.

        A frame is registered to what earlier frames put into the map, with the errors of their poses.
        """
        return np.zeros((6, 6)) if self._reference is None else carried(*self._reference, T_world_camera)

    def shares(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> list[tuple[float, KeyImage]]:
        """Which share of a frame's points each image shows, of those that were taken near enough."""
        near = self._near(T_world_camera)
        return list(zip(_shares_in(near, points, T_world_camera), near, strict=True))

    def _near(self, T_world_camera: Float[np.ndarray, "4 4"]) -> list[KeyImage]:
        """Images that were taken near a camera, in a like direction, the oldest first."""
        if not self.images:
            return []
        poses = np.stack([image.T_world_camera for image in self.images])
        apart = np.linalg.norm(poses[:, :3, 3] - T_world_camera[:3, 3], axis=1)
        alike = poses[:, :3, 2] @ T_world_camera[:3, 2] >= self.config.least_cosine
        return [self.images[k] for k in np.flatnonzero((apart <= self.config.most_apart_m) & alike).tolist()]

    def equations(
        self,
        images: Sequence[KeyImage],
        points: FramePoints,
        T_world_camera: Float[np.ndarray, "4 4"],
        noise_per_m: float,
        kernel: float,
        gray: Float32[np.ndarray, " n"],
        *,
        coarse: bool = False,
        depth_share: float = 1.0,
    ) -> Sums:
        """Sums over a frame's points against images, by displacement and rotation in the world.

        Costs and counts are means over the images, as a point that one of them does not show is no outlier of the
        others. ``gray`` are the points' grey values in [0, 1]; with ``coarse`` those as of :attr:`KeyImage.coarse`, to
        be compared with these. ``depth_share`` is what their depth counts beside grey values.
        """
        config, scale = self.config, 1.0 / COARSE if coarse else 1.0
        noise = noise_per_m if math.isfinite(noise_per_m) else 0.0
        distances = config.deviation_m, kernel, config.reach_m, config.edge_share
        settings = np.array([*distances, config.gray_deviation, config.gray_kernel, scale, noise])
        seen = points.camera_m, gray, points.variance_m2, points.trust
        arrays = [image.arrays(coarse) for image in images]
        hessian, gradient, facts = _native.frame_to_frames(*seen, arrays, T_world_camera, depth_share, settings)
        cost, num_points, gray_cost = (facts / len(images)).tolist()
        return Sums(hessian, gradient, cost, num_points, gray_cost)


def _shares_in(
    images: Sequence[KeyImage], points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], slack_m: float = 0.0
) -> list[float]:
    """Share of a frame's points that each image shows too, not hidden, and at a like scale.

    A pattern that repeats, seen from much farther away, blurs into another one, which draws to a wrong place.
    """
    some = np.ascontiguousarray(points.camera_m[::_OVERLAP_STEP])
    arrays = [image.arrays() for image in images]
    return _native.shares_in(some, arrays, T_world_camera, _NEARNESS, slack_m, _MOST_SCALE)
