"""How well the map tells what a camera would see from places where it never was.

Colour is compared by PSNR and SSIM, depth by the mean absolute error (L1). What the map does not know it renders as
black and without depth; PSNR and SSIM over whole pictures count that as wrong, so the share that is known, and PSNR
over that alone, stand beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from scipy.spatial import KDTree
from skimage.metrics import structural_similarity

from anm_mj.evaluation.depth import MAX_DEPTH_M
from anm_mj.types import Pose2

MAX_PSNR_DB = 100.0
"""PSNR given to pictures without any difference."""


@dataclass(frozen=True)
class ViewQuality:
    """How one rendered view compares with the true one."""

    psnr_db: float
    """Peak signal-to-noise ratio of colour over the whole picture [dB]."""
    psnr_known_db: float
    """The same over pixels that the map has a surface at [dB]; NaN where there is none."""
    ssim: float
    """Structural similarity of colour over the whole picture (Wang et al., 2004), at most 1."""
    depth_l1_cm: float
    """Mean absolute error of planar depth where both have one within 10 m [cm]; NaN where there is none."""
    known_percent: float
    """Share of the pixels with a true depth within 10 m at which the map has a surface [%]."""


@dataclass(frozen=True)
class HeldOut:
    """How well the map renders views that were held out."""

    num_views: int
    """Views taken; fewer than asked for where there are not as many."""
    mean: ViewQuality | None
    """The means over them; None where there was none."""


def far_places(
    places_m: Float[np.ndarray, "n 2"], trajectory_m: Float[np.ndarray, "k 2"], distance_m: float
) -> Float[np.ndarray, "m 2"]:
    """Those of the places that are farther than a distance from wherever the robot stood [m]."""
    return places_m[KDTree(trajectory_m).query(places_m)[0] > distance_m]


def candidate_poses(places_m: Float[np.ndarray, "n 2"], seed: int) -> list[Pose2]:
    """A pose at each place [m], in random order and looking in random directions; the same for the same seed."""
    rng = np.random.default_rng(seed)
    yaw_rad = rng.uniform(-np.pi, np.pi, len(places_m))
    return [
        Pose2(float(places_m[i, 0]), float(places_m[i, 1]), float(yaw_rad[i])) for i in rng.permutation(len(places_m))
    ]


def compare_view(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float32[np.ndarray, "h w"],
    true_rgb: UInt8[np.ndarray, "h w 3"],
    true_depth_m: Float32[np.ndarray, "h w"],
) -> ViewQuality:
    """Compare a rendered view with the true one.

    Args:
        rgb: What the map renders.
        depth_m: Planar depth that the map renders; NaN where it knows no surface.
        true_rgb: What a camera sees there.
        true_depth_m: Planar depth of what a camera sees there; NaN where there is nothing.
    """
    known = np.isfinite(depth_m)
    in_range = true_depth_m <= MAX_DEPTH_M
    both = known & in_range
    # It returns a tuple when asked for more, hence the array.
    ssim = np.asarray(structural_similarity(rgb, true_rgb, channel_axis=2, data_range=255))
    return ViewQuality(
        psnr_db=psnr_db(rgb, true_rgb, np.ones(known.shape, bool)),
        psnr_known_db=psnr_db(rgb, true_rgb, known),
        ssim=ssim.item(),
        depth_l1_cm=100.0 * float(np.abs(depth_m[both] - true_depth_m[both]).mean()) if both.any() else float("nan"),
        known_percent=100.0 * float(both.sum() / in_range.sum()) if in_range.any() else float("nan"),
    )


def psnr_db(
    rgb: UInt8[np.ndarray, "h w 3"], true_rgb: UInt8[np.ndarray, "h w 3"], where: Bool[np.ndarray, "h w"]
) -> float:
    """Peak signal-to-noise ratio of 8-bit colours [dB], at most ``MAX_PSNR_DB``; NaN over no pixels."""
    if not where.any():
        return float("nan")
    mean_square = float(np.mean((rgb[where].astype(float) - true_rgb[where]) ** 2))
    return min(10.0 * np.log10(255.0**2 / mean_square), MAX_PSNR_DB) if mean_square > 0.0 else MAX_PSNR_DB


def mean_quality(views: Sequence[ViewQuality]) -> ViewQuality:
    """The mean of each number over all views that have it; NaN where none has."""
    values = np.array([list(vars(view).values()) for view in views], float).reshape(len(views), -1)
    has = np.isfinite(values)
    count = has.sum(axis=0)
    total = np.where(has, values, 0.0).sum(axis=0)
    means = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return ViewQuality(*means.tolist())
