"""Both decoders (:mod:`anm_mj.mapping.field`) on a tile of points, for queries and for training."""

from typing import no_type_check

import triton
import triton.language as tl

from anm_mj.mapping.backends.triton.matrix import product, tile
from anm_mj.mapping.backends.triton.one_blob import blob_code


@triton.jit
@no_type_check
def load_features(features, stride, point, inside, FEATURES: tl.constexpr, FEATURES_PAD: tl.constexpr):
    """Grid features of points, "points FEATURES_PAD"."""
    row = tl.arange(0, FEATURES_PAD)[None, :]
    return tl.load(features + row * stride + point[:, None], mask=inside[:, None] & (row < FEATURES), other=0.0)


@triton.jit
@no_type_check
def load_decoders(
    weights,
    FEATURES: tl.constexpr,
    BINS: tl.constexpr,
    HIDDEN: tl.constexpr,
    OUTPUTS: tl.constexpr,
    FEATURES_PAD: tl.constexpr,
    BLOB_PAD: tl.constexpr,
    HIDDEN_PAD: tl.constexpr,
    OUTPUTS_PAD: tl.constexpr,
):
    """Both decoders' matrices but the last: SDF by features, by blob, to outputs; colour by blob, by outputs."""
    blob: tl.constexpr = 3 * BINS
    sdf_in: tl.constexpr = FEATURES + blob
    color_in: tl.constexpr = blob + OUTPUTS - 1
    sdf_grid = tile(weights, HIDDEN, FEATURES, sdf_in, HIDDEN_PAD, FEATURES_PAD)
    sdf_blob = tile(weights + FEATURES, HIDDEN, blob, sdf_in, HIDDEN_PAD, BLOB_PAD)
    sdf_out = tile(weights + HIDDEN * sdf_in, OUTPUTS, HIDDEN, HIDDEN, OUTPUTS_PAD, HIDDEN_PAD)
    color = weights + HIDDEN * (sdf_in + OUTPUTS)
    color_blob = tile(color, HIDDEN, blob, color_in, HIDDEN_PAD, BLOB_PAD)
    # Moved by one, so that columns are those of the SDF decoder's outputs, of which s takes no part.
    color_geometry = tile(color + blob - 1, HIDDEN, OUTPUTS, color_in, HIDDEN_PAD, OUTPUTS_PAD)
    color_geometry = tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, 0.0, color_geometry)
    return sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry


@triton.jit
@no_type_check
def decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD: tl.constexpr):
    """Hidden layer ("points HIDDEN_PAD"), all outputs ("points OUTPUTS_PAD"), and s alone ("points")."""
    hidden = tl.maximum(product(grid, tl.trans(sdf_grid)) + product(blob, tl.trans(sdf_blob)), 0.0)
    outputs = product(hidden, tl.trans(sdf_out))
    s = tl.sum(tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, outputs, 0.0), axis=1)
    return hidden, outputs, s


@triton.jit
@no_type_check
def decode_color_hidden(blob, outputs, color_blob, color_geometry):
    """The colour decoder's hidden layer, "points HIDDEN_PAD"."""
    return tl.maximum(product(blob, tl.trans(color_blob)) + product(outputs, tl.trans(color_geometry)), 0.0)


@triton.jit
@no_type_check
def _sigmoid(x):
    # By the exponential of what is negative, which cannot overflow.
    e = tl.exp(-tl.abs(x))
    return tl.where(x >= 0.0, 1.0, e) / (1.0 + e)


@triton.jit
@no_type_check
def channel_value(hidden, weight):
    """One colour channel in [0, 1] of the colour decoder's hidden layer, "points"."""
    return _sigmoid(tl.sum(hidden * weight[None, :], axis=1))


@triton.jit
@no_type_check
def load_channel(weights, channel, HIDDEN: tl.constexpr, HIDDEN_PAD: tl.constexpr):
    """A channel's row of the last matrix, which starts at ``weights``, "HIDDEN_PAD"."""
    column = tl.arange(0, HIDDEN_PAD)
    return tl.load(weights + channel * HIDDEN + column, mask=column < HIDDEN, other=0.0)


@triton.jit
@no_type_check
def decode_kernel(
    points,
    features,
    stride,
    bins_per_m,
    weights,
    num_weights,
    s_out,
    rgb_out,
    COLOR: tl.constexpr,
    FEATURES: tl.constexpr,
    BINS: tl.constexpr,
    HIDDEN: tl.constexpr,
    OUTPUTS: tl.constexpr,
    FEATURES_PAD: tl.constexpr,
    BLOB_PAD: tl.constexpr,
    HIDDEN_PAD: tl.constexpr,
    OUTPUTS_PAD: tl.constexpr,
    POINTS: tl.constexpr,
):
    """The SDF s and, if COLOR, colours in [0, 1] of points under each set of decoder weights.

    ``points`` is "3 stride" [m], ``features`` "FEATURES stride", ``weights`` "sets num_weights", ``s_out`` "sets
    stride", ``rgb_out`` "sets 3 stride".
    """
    which = tl.program_id(1)
    weights += which * num_weights
    point = tl.program_id(0) * POINTS + tl.arange(0, POINTS)
    inside = point < stride
    sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry = load_decoders(
        weights, FEATURES, BINS, HIDDEN, OUTPUTS, FEATURES_PAD, BLOB_PAD, HIDDEN_PAD, OUTPUTS_PAD
    )
    grid = load_features(features, stride, point, inside, FEATURES, FEATURES_PAD)
    blob = blob_code(points, stride, point, inside, bins_per_m, BINS, BLOB_PAD)
    _, outputs, s = decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD)
    # Sets times points may pass 2^31.
    row = which.to(tl.int64) * stride
    tl.store(s_out + row + point, s, mask=inside)
    if COLOR:
        hidden = decode_color_hidden(blob, outputs, color_blob, color_geometry)
        last = weights + num_weights - 3 * HIDDEN
        for channel in tl.static_range(3):
            value = channel_value(hidden, load_channel(last, channel, HIDDEN, HIDDEN_PAD))
            tl.store(rgb_out + (3 * row + channel * stride) + point, value, mask=inside)
