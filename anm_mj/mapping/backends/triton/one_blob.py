"""The one-blob code of points (:func:`anm_mj.mapping.encoding.one_blob`) as a tile of the decoders' input."""

from typing import no_type_check

import triton
import triton.language as tl


@triton.jit
@no_type_check
def _quartic_tail(distance):
    """The mass of the quartic kernel, one bin wide to either side, beyond a distance in bins."""
    square = distance * distance
    return 0.5 - 0.9375 * distance * (1.0 + square * (-2.0 / 3.0 + square * 0.2))


@triton.jit
@no_type_check
def _blob_axis(points, point, inside, bins_per_m, BINS: tl.constexpr):
    """The bin of each point along one axis, and the masses in the bins below and above it."""
    position = tl.load(points + point, mask=inside, other=0.0) * bins_per_m
    centre = tl.floor(position)
    right = position - centre
    # The remainder has the sign of what is divided.
    bin_index = (centre.to(tl.int32) % BINS + BINS) % BINS
    return bin_index[:, None], _quartic_tail(right)[:, None], _quartic_tail(1.0 - right)[:, None]


@triton.jit
@no_type_check
def blob_code(points, stride, point, inside, bins_per_m, BINS: tl.constexpr, BLOB_PAD: tl.constexpr):
    """The code of points ("3 stride") as a dense tile "points BLOB_PAD", axis by axis."""
    column = tl.arange(0, BLOB_PAD)[None, :]
    axis, place = column // BINS, column % BINS
    x_bin, x_below, x_above = _blob_axis(points, point, inside, tl.load(bins_per_m), BINS)
    y_bin, y_below, y_above = _blob_axis(points + stride, point, inside, tl.load(bins_per_m + 1), BINS)
    z_bin, z_below, z_above = _blob_axis(points + 2 * stride, point, inside, tl.load(bins_per_m + 2), BINS)
    centre = tl.where(axis == 0, x_bin, tl.where(axis == 1, y_bin, z_bin))
    below = tl.where(axis == 0, x_below, tl.where(axis == 1, y_below, z_below))
    above = tl.where(axis == 0, x_above, tl.where(axis == 1, y_above, z_above))
    # How far the bin is beyond the point's own, around the circle.
    offset = (place - centre + BINS) % BINS
    code = tl.where(offset == 0, 1.0 - below - above, 0.0)
    code = tl.where(offset == 1, above, tl.where(offset == BINS - 1, below, code))
    return tl.where(axis < 3, code, 0.0)
