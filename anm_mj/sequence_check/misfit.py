"""How badly two frames contradict each other under a relative pose: depth first, colour as a second cue.

Points of one frame are carried into the other. There each has a distance from the surface along that surface's normal
(point to plane), in standard deviations of what noise explains, under a kernel that grows with the logarithm: a sound
frame pair costs little, a gross error is told from a smaller one, and no outlier decides. A point that leaves the image
costs half, so that no hypothesis wins by looking elsewhere.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from anm_mj.sequence_check.surfaces import Surfaces
from anm_mj.types import Intrinsics

SLACK = 0.004
"""What no calibration does better than, as a share of the depth."""
MOST_DEVIATIONS = 25.0
"""Distances beyond so many standard deviations cost the same: 1."""
COLOUR_DEVIATION = 0.04
"""Grey values of one place differ by so much where all fits, in [0, 1]."""
MOST_COLOUR_DEVIATIONS = 10.0
COLOUR_WEIGHT = 0.5
"""Of the cost of colour against that of depth."""
RIM_WEIGHT = 0.5
"""Of the cost of steps in depth against that of colours."""
OUTSIDE = 0.5
"""Cost of a point that the other frame says nothing of."""
SEEN = 0.3
"""Colour is judged by the points within the image, as long as they are such a share: else offsets that lead out of it
would seem worse than they are."""
BEHIND = 0.05
"""A point that lies behind the seen surface by a larger share of depth may be hidden."""
FITS = 3.0
"""Points within so many standard deviations fit."""


class Misfit(NamedTuple):
    """Of frame pairs under a hypothesis."""

    cost: Float64[np.ndarray, " d"]
    """Mean cost of the points in [0, 1], by pair; NaN for a pair without points."""
    inside: Float64[np.ndarray, " d"]
    """Share of the points that the other frame tells something of."""
    fits: Float64[np.ndarray, " d"]
    """Share of those, without hidden ones, that lie on its surface; NaN where there are none."""
    residual: Float64[np.ndarray, " d"]
    """Median distance of those from the surface as a share of depth; NaN where there are none."""


class Carried(NamedTuple):
    """Points in the image of another frame."""

    x: Float32[np.ndarray, "d n"]
    """Column [px], measured from the image's edge."""
    y: Float32[np.ndarray, "d n"]
    inside: Bool[np.ndarray, "d n"]


def misfit(shown: Surfaces, pairs: Int64[np.ndarray, "d 2"], T_b_a: Float64[np.ndarray, "d 4 4"]) -> Misfit:
    """Hold the points of the first frame of each pair against the surface of the second. ``T_b_a`` leads from the
    camera of the first to that of the second.
    """
    one, other = pairs[:, 0], pairs[:, 1]
    camera = shown.camera
    points = carry(shown.points_m[one], T_b_a)
    at = project(points, camera)
    col, row = _pixel(at.x, camera.width), _pixel(at.y, camera.height)
    frame = np.broadcast_to(other[:, None], col.shape)
    surface_z, normal, cosine, deviation = shown.planes(frame, row, col)
    inside = at.inside & np.isfinite(surface_z)
    with np.errstate(invalid="ignore"):
        across = normal[..., 0] * points[..., 0] + normal[..., 1] * points[..., 1] + normal[..., 2] * points[..., 2]
        distance = np.abs(across - cosine * surface_z)
        noise = deviation * cosine
        slack = np.float32(SLACK) * surface_z
        deviations = distance / np.sqrt(2.0 * noise * noise + slack * slack)
        behind = points[..., 2] - surface_z > BEHIND * surface_z
        cost = _kernel(deviations, MOST_DEVIATIONS)
        hidden = behind & (cost > OUTSIDE)
        cost[hidden] = OUTSIDE
    told = inside & ~hidden
    between = sampled_grey(shown.images.grey, frame, at.x, at.y)
    difference = np.abs(between - shown.grey[one]) / np.float32(COLOUR_DEVIATION)
    colour = np.where(told, _kernel(difference, MOST_COLOUR_DEVIATIONS), np.float32(OUTSIDE))
    cost = np.where(inside, cost, np.float32(OUTSIDE))
    total = (cost + COLOUR_WEIGHT * colour) / (1.0 + COLOUR_WEIGHT)
    known = np.isfinite(shown.points_m[one][..., 0])
    relative = np.where(told, distance / surface_z, np.float32(np.nan))
    with np.errstate(invalid="ignore"):
        count = told.sum(axis=1)
        fitting = (told & (deviations < FITS)).sum(axis=1) / np.where(count, count, np.nan)
        share = inside.sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        return Misfit(_mean_of_seen(total, known, known), share, fitting, medians(relative))


def colour_misfit(
    shown: Surfaces,
    pairs: Int64[np.ndarray, "d 2"],
    T_a_colour: Float64[np.ndarray, "d 4 4"],
    T_b_colour: Float64[np.ndarray, "d 4 4"],
) -> Float64[np.ndarray, " d"]:
    """Mean cost of colour alone, where colour was taken from other places than depth. The points are those of the first
    frame's depth; ``T_a_colour`` and ``T_b_colour`` lead from its depth camera to the cameras of both frames' colours.
    """
    one, other = pairs[:, 0], pairs[:, 1]
    stated = shown.points_m[one]
    values, inside = [], np.isfinite(stated[..., 0])
    for frames, transform in ((one, T_a_colour), (other, T_b_colour)):
        at = project(carry(stated, transform), shown.camera)
        values.append(sampled_grey(shown.images.grey, np.broadcast_to(frames[:, None], at.x.shape), at.x, at.y))
        inside &= at.inside
    difference = np.abs(values[0] - values[1]) / np.float32(COLOUR_DEVIATION)
    return _mean_of_seen(_kernel(difference, MOST_COLOUR_DEVIATIONS), inside, np.isfinite(stated[..., 0]))


def rim_misfit(shown: Surfaces, T_colour: Float64[np.ndarray, "v 4 4"]) -> Float64[np.ndarray, " v"]:
    """Mean cost of steps in depth that are imaged where colour changes little, by view; a half without any step.
    ``T_colour`` leads from the depth camera of each to the camera of its colour.
    """
    at = project(carry(shown.rim_m, T_colour), shown.camera)
    row, col = _pixel(at.y, shown.camera.height), _pixel(at.x, shown.camera.width)
    steep = shown.images.steep
    frame = np.arange(len(steep))[:, None]
    cost = _mean_of_seen(1.0 - steep[frame, row, col], at.inside, np.isfinite(shown.rim_m[..., 0]))
    return np.nan_to_num(cost, nan=OUTSIDE)


def carry(points_m: Float32[np.ndarray, "d n 3"], T_b_a: Float64[np.ndarray, "d 4 4"]) -> Float32[np.ndarray, "d n 3"]:
    """Points in other axes, one transform for each row."""
    T = T_b_a.astype(np.float32)
    return points_m @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]


def project(points_m: Float32[np.ndarray, "d n 3"], camera: Intrinsics) -> Carried:
    """Where points are imaged, and whether within the image."""
    z = points_m[..., 2]
    ahead = z > 1e-6
    with np.errstate(invalid="ignore"):
        scale = np.float32(1.0) / np.where(ahead, z, np.float32(1.0))
        x = points_m[..., 0] * scale * np.float32(camera.fx) + np.float32(camera.cx)
        y = points_m[..., 1] * scale * np.float32(camera.fy) + np.float32(camera.cy)
        inside = ahead & (x >= 0.0) & (x < camera.width) & (y >= 0.0) & (y < camera.height)
    return Carried(np.where(inside, x, np.float32(0.0)), np.where(inside, y, np.float32(0.0)), inside)


def sampled_grey(
    grey: Float32[np.ndarray, "v h w"],
    frame: Int64[np.ndarray, "d n"],
    x: Float32[np.ndarray, "d n"],
    y: Float32[np.ndarray, "d n"],
) -> Float32[np.ndarray, "d n"]:
    """Grey values between pixels, bilinear; x and y [px] are measured from the image's edge."""
    height, width = grey.shape[1:]
    x, y = np.clip(x - 0.5, 0.0, width - 1.001), np.clip(y - 0.5, 0.0, height - 1.001)
    col, row = x.astype(np.int64), y.astype(np.int64)
    right, down = x - col.astype(np.float32), y - row.astype(np.float32)
    flat, at = grey.reshape(-1), (frame * height + row) * width + col
    upper = flat[at] * (1.0 - right) + flat[at + 1] * right
    lower = flat[at + width] * (1.0 - right) + flat[at + width + 1] * right
    return upper * (1.0 - down) + lower * down


def _mean_of_seen(
    cost: np.ndarray, seen: Bool[np.ndarray, "d n"], known: Bool[np.ndarray, "d n"]
) -> Float64[np.ndarray, " d"]:
    """Means of rows over seen entries, filled up with ``OUTSIDE`` to a share of the known ones; NaN without any."""
    count, enough = seen.sum(axis=1), SEEN * known.sum(axis=1)
    total = np.where(seen, cost, 0.0).sum(axis=1, dtype=np.float64) + OUTSIDE * np.maximum(enough - count, 0.0)
    most = np.maximum(count, enough)
    return total / np.where(most > 0.0, most, np.nan)


def medians(values: np.ndarray) -> Float64[np.ndarray, " d"]:
    """Medians of rows without NaN; NaN for a row without any other value."""
    count = np.isfinite(values).sum(axis=1)
    ordered = np.sort(values, axis=1)
    middle = np.take_along_axis(ordered, (np.maximum(count - 1, 0) // 2)[:, None], axis=1)[:, 0]
    return np.where(count, middle, np.nan).astype(np.float64)


def _pixel(place: Float32[np.ndarray, "d n"], size: int) -> Int64[np.ndarray, "d n"]:
    return np.minimum(place.astype(np.int64), size - 1)


def _kernel(deviations: Float32[np.ndarray, "d n"], most: float) -> Float32[np.ndarray, "d n"]:
    """Cost of distances in standard deviations: 0 at none, 1 from ``most`` on."""
    limited = np.minimum(deviations, np.float32(most))
    return np.log1p(limited * limited) / np.float32(math.log1p(most * most))
