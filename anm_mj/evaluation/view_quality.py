"""What a map renders in the place of true views, and how good it is: PSNR and SSIM of colour, mean absolute error (L1)
of depth.

The map renders unknown pixels black and without depth. PSNR and SSIM over whole images and the depth error count them
as wrong; the known share, and PSNR and L1 over known pixels alone, complement them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from skimage.metrics import structural_similarity

from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M
from anm_mj.io.to_json import write_json
from anm_mj.types import Observation
from anm_mj.utils.progress import Progress, unheard

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

MAX_PSNR_DB = 100.0
"""PSNR of identical images."""
MAP_DEPTH_M = 12.0
"""Farther surface is not looked for in the map [m]."""
MAX_ERROR_M = 1.0
"""The depth error counts no pixel with more than this, and a pixel without a surface with just this [m]; as
completion."""


@dataclass(frozen=True)
class ViewQuality:
    """Quality of one rendered view against the true one."""

    psnr_db: float
    """Peak signal-to-noise ratio of colour over the whole image [dB]."""
    psnr_known_db: float
    """PSNR over pixels where the map has a surface [dB]; NaN without any."""
    ssim: float
    """Structural similarity of colour over the whole image, at most 1: by a uniform window of 7 x 7 pixels, where Wang
    et al., 2004, take a Gaussian one."""
    depth_l1_cm: float
    """Mean absolute error of planar depth over pixels where both have one within 10 m [cm]; NaN without any."""
    depth_error_cm: float
    """The same over all pixels with a true depth within 10 m, each capped at 1 m; pixels where the map has no surface
    count 1 m [cm]. NaN without any."""
    known_percent: float
    """Share of the pixels with a true depth within 10 m where the map has a surface [%]."""


@dataclass(frozen=True)
class ViewsResult:
    """Quality of a map on several views, novel or fixed ones."""

    num_views: int
    """Views evaluated; fewer than requested if the scene has not as many."""
    mean: ViewQuality | None
    """Means over the views; None without any."""


def compare_view(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth_m: Float32[np.ndarray, "h w"],
    true_rgb: UInt8[np.ndarray, "h w 3"],
    true_depth_m: Float32[np.ndarray, "h w"],
) -> ViewQuality:
    """Compare a rendered view with the true one. Planar depth [m] is NaN without a surface."""
    known = np.isfinite(depth_m)
    in_range = true_depth_m <= MAX_DEPTH_M
    both = known & in_range
    error_m = np.abs(depth_m - true_depth_m)[both]
    # structural_similarity returns a tuple for some options, hence the array.
    ssim = np.asarray(structural_similarity(rgb, true_rgb, channel_axis=2, data_range=255))
    return ViewQuality(
        psnr_db=psnr_db(rgb, true_rgb, np.ones(known.shape, bool)),
        psnr_known_db=psnr_db(rgb, true_rgb, known),
        ssim=ssim.item(),
        depth_l1_cm=100.0 * float(error_m.mean()) if both.any() else float("nan"),
        depth_error_cm=100.0 * _capped_mean_m(error_m, int(in_range.sum())),
        known_percent=100.0 * float(both.sum() / in_range.sum()) if in_range.any() else float("nan"),
    )


def _capped_mean_m(error_m: Float32[np.ndarray, " n"], count: int) -> float:
    """Mean of capped errors of a larger number of pixels, of which the others have no surface [m]; NaN for none."""
    if not count:
        return float("nan")
    return (float(np.minimum(error_m, MAX_ERROR_M).sum(dtype=float)) + (count - len(error_m)) * MAX_ERROR_M) / count


def psnr_db(
    rgb: UInt8[np.ndarray, "h w 3"], true_rgb: UInt8[np.ndarray, "h w 3"], where: Bool[np.ndarray, "h w"]
) -> float:
    """Peak signal-to-noise ratio of 8-bit colours [dB], at most ``MAX_PSNR_DB``; NaN over no pixels."""
    if not where.any():
        return float("nan")
    mean_square = float(np.mean((rgb[where].astype(float) - true_rgb[where]) ** 2))
    return min(10.0 * np.log10(255.0**2 / mean_square), MAX_PSNR_DB) if mean_square > 0.0 else MAX_PSNR_DB


def mean_quality(views: Sequence[ViewQuality]) -> ViewQuality:
    """Mean of each field over the views where it is finite; NaN if there are none."""
    values = np.array([list(vars(view).values()) for view in views], float)
    means = np.ma.masked_invalid(values).mean(axis=0)
    return ViewQuality(*means.filled(np.nan).tolist())


def compare_views(
    neural_map: NeuralMap, views: Iterable[Observation], num_views: int, on_progress: Progress = unheard
) -> Iterator[tuple[Observation, UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], ViewQuality]]:
    """Each true view, colour and planar depth [m] that a map renders in its place, and their quality. ``num_views`` is
    for the progress.
    """
    for done, view in enumerate(views, start=1):
        rgb, depth_m = neural_map.render(view.intrinsics, view.T_world_camera, MAP_DEPTH_M)
        yield view, rgb, depth_m, compare_view(rgb, depth_m, view.rgb, view.depth_m)
        on_progress(done, num_views)


def write_views(path: Path, rows: Sequence[dict[str, Any]], **facts: Any) -> ViewsResult:
    """Write ``novel_views.json`` or ``fixed_views.json``; returns the means. Each row has the ``quality`` of a view;
    ``facts`` are further entries of the file. Raises RunFolderError if the file cannot be written.
    """
    result = ViewsResult(len(rows), mean_quality([row["quality"] for row in rows]) if rows else None)
    write_json(path, {"num_views": result.num_views, **facts, "mean": result.mean, "views": rows})
    return result
