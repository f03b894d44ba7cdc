"""A frame compared with earlier ones: what it adds to the normal equations of its registration, and where one of them
alone puts it, which is what a pose graph is made of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy import ndimage

from anm_mj.localisation.frame_points import draw_points
from anm_mj.localisation.key_images import COARSE, KeyImage, KeyImages, Sums, gray_values
from anm_mj.localisation.localisation_config import GraphConfig, LocalisationConfig
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.mapping.alignment import FramePoints
from anm_mj.types import Observation


class FrameToImages:
    """Compares points of a frame with some images."""

    def __init__(
        self,
        kept: KeyImages,
        images: list[KeyImage],
        points: FramePoints,
        coarse_gray: Float32[np.ndarray, " n"],
        noise_per_m: float,
        depth_share: float,
    ) -> None:
        """Of the images that are given, by ``kept``; ``coarse_gray`` as of :func:`coarse_gray_at`.

        ``depth_share`` is what depth counts beside grey values. Depth errs by what many pixels share (bias, steps of
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
        """Sums over the points and images at a pose, with a width of the kernel in standard deviations; ``coarse`` ones
        lead there from farther away.
        """
        gray, share = self._coarse_gray if coarse else self._gray, self._depth_share
        return self._kept.equations(
            self._images, self.points, T_world_camera, self._noise_per_m, kernel, gray, coarse=coarse, depth_share=share
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
    """The frame ``view``, of which ``image`` was made, to be compared with images.

    Of its points ``num_registered`` are registered to the field; depth has the weight of as many.
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


@dataclass(frozen=True)
class Measured:
    """Result of :func:`measured`."""

    T_world_camera: Float64[np.ndarray, "4 4"]
    """Where the image puts the camera of the points."""
    information: Float64[np.ndarray, "6 6"]
    """Of the displacement and the rotation vector, in the world."""
    overlap: float
    """Share of the points that the image shows, in [0, 1]."""
    fit: float
    """How well these fit, in [0, 1]: the mean of their robust weights."""


def measured(
    compared: FrameToImages,
    T_start: Float[np.ndarray, "4 4"],
    covariance: Float64[np.ndarray, "k k"],
    basis: Float64[np.ndarray, "6 k"],
    config: GraphConfig,
) -> Measured:
    """Register a frame's points to one image, from a start that is believed as little as its covariance says, by the
    directions of ``basis`` as of :class:`~.registration.Prior`.
    """
    prior = np.linalg.inv(covariance)
    T = np.asarray(T_start, np.float64)
    for iteration in range(config.iterations):
        share = min(1.0, iteration / max(1, config.iterations - 2))
        kernel = config.first_kernel * (config.kernel / config.first_kernel) ** share
        sums = compared(T, kernel, share < 1.0)
        offset = basis.T @ camera_motion(T_start, T)
        hessian = config.information * (basis.T @ sums.hessian @ basis) + prior
        slope = config.information * (basis.T @ sums.gradient) + prior @ offset
        T = moved_camera(T, basis @ np.linalg.solve(hessian, -slope))
    sums = compared(T, config.kernel, False)
    overlap, fit = sums.num_points / max(1, len(compared)), sums.fit(config.kernel)
    return Measured(T, config.information * sums.hessian, overlap, fit)
