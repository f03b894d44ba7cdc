"""A frame compared with earlier ones: what it adds to the normal equations of its registration."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32
from scipy import ndimage

from anm_mj.localisation.frame_points import draw_points
from anm_mj.localisation.key_images import COARSE, KeyImage, KeyImages, gray_values
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.registration import Sums
from anm_mj.mapping.alignment import FramePoints
from anm_mj.types import Observation


class FrameToImages:
    """Compares points of a frame with some images; implements :class:`~.registration.Extra`."""

    def __init__(
        self,
        kept: KeyImages,
        images: list[KeyImage],
        points: FramePoints,
        coarse_gray: Float32[np.ndarray, " n"],
        noise_per_m: float,
        depth_share: float,
    ) -> None:
        """Of the images that are given.

        Args:
            kept: Compares points with an image.
            images: Those that they are compared with.
            points: Of the frame.
            coarse_gray: Their grey values as of :func:`coarse_gray_at`.
            noise_per_m: Of the depth.
            depth_share: What depth counts beside grey values. Depth errs by what many pixels share (bias, steps of
                disparity), so that more of them tell no more.
        """
        self._kept, self._images, self.points, self._noise_per_m = kept, images, points, noise_per_m
        self._gray, self._coarse_gray, self._depth_share = gray_values(points.rgb), coarse_gray, depth_share

    def __len__(self) -> int:
        return len(self.points)

    @property
    def has_gray(self) -> bool:
        """Whether grey values are compared, too."""
        return self._kept.config.gray_deviation > 0.0

    @property
    def num_images(self) -> int:
        """Images that the points are compared with."""
        return len(self._images)

    def __call__(self, T_world_camera: Float[np.ndarray, "4 4"], kernel: float, coarse: bool) -> Sums:
        """Sums over the points and images at a pose."""
        return self._kept.equations(
            self._images,
            self.points,
            T_world_camera,
            self._noise_per_m,
            kernel,
            self._coarse_gray if coarse else self._gray,
            coarse=coarse,
            depth_share=self._depth_share,
        )

    def against(self, image: KeyImage) -> FrameToImages:
        """The same points, compared with another image alone."""
        return self._some([image], 1)

    def every(self, step: int) -> FrameToImages:
        """The same of each ``step``-th point."""
        return self._some(self._images, step)

    def subsample(self, num_points: int) -> FrameToImages:
        """The same of about so many points, with the last image alone: the latest, or the best of the latest."""
        return self._some(self._images[-1:], max(1, len(self) // num_points))

    def _some(self, images: list[KeyImage], step: int) -> FrameToImages:
        gray = np.ascontiguousarray(self._coarse_gray[::step])
        points = self.points.every(step)
        return FrameToImages(self._kept, images, points, gray, self._noise_per_m, self._depth_share)


def compared_with(
    images: list[KeyImage],
    view: Observation,
    image: KeyImage,
    num_registered: int,
    kept: KeyImages,
    config: LocalisationConfig,
    noise_per_m: float,
    rng: np.random.Generator,
) -> FrameToImages:
    """A frame, to be compared with images.

    Args:
        images: What it is compared with.
        view: The frame.
        image: Made of it.
        num_registered: Points of it that are registered to the field; depth has the weight of as many.
        kept: Compares points with an image.
        config: Settings.
        noise_per_m: Of the depth.
        rng: Draws points.
    """
    points = draw_points(view, config.key_images.num_points, noise_per_m, config.registration.range_m, rng)
    depth_share = min(1.0, num_registered / max(1, len(points)))
    return FrameToImages(kept, images, points, coarse_gray_at(image, points), noise_per_m, depth_share)


def coarse_gray_at(image: KeyImage, points: FramePoints) -> Float32[np.ndarray, " n"]:
    """Coarse grey values of a frame's points in its own image, in [0, 1]."""
    fx, fy, cx, cy = image.camera
    depth = points.camera_m[:, 2]
    if not image.coarse.size:
        return np.zeros(len(points), np.float32)
    # The first pixel's centre is at 0.
    col = (fx * points.camera_m[:, 0] / depth + cx) / COARSE - 0.5
    row = (fy * points.camera_m[:, 1] / depth + cy) / COARSE - 0.5
    values = ndimage.map_coordinates(image.coarse.astype(np.float32), (row, col), order=1, mode="nearest")
    return values / np.float32(255.0)
