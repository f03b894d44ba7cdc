"""The Triton engine's kernels: sampling, encoding, decoders with rendering, losses and gradients, scatter, Adam.

They compute what :mod:`anm_mj.mapping.sampling`, ``encoding``, ``field``, ``rendering`` and ``losses`` say, in float32.
Arrays of points are stored by component ("3 points") and features by feature, first those of index 0 of all levels and
then those of index 1, so that neighbouring lanes read neighbouring words. Names in capitals are compile-time constants;
``..._PAD`` is a size rounded up to a power of two, and what lies beyond the size is zero.

Kernels bear ``no_type_check`` because a run-time type checker's wrapper would hide their source from Triton, and this
file does without postponed annotations because Triton reads ``tl.constexpr`` from them.
"""

from typing import no_type_check

import triton
import triton.language as tl
from triton.runtime import JITFunction

from anm_mj.mapping.rendering import BELL_WIDTH

_BELL_WIDTH = tl.constexpr(BELL_WIDTH)
# Three products on tensor cores that make one of float32: plain TF32 keeps 10 bits, too few for s near a surface, and
# products outside of tensor cores need ten times the registers.
_PRECISION = tl.constexpr("tf32x3")


@triton.jit
@no_type_check
def _mix(x):
    """The 32-bit mixer of :func:`anm_mj.mapping.sampling.counter_uniform`."""
    x = (x ^ (x >> 16)) * tl.full((), 0x7FEB352D, tl.uint32)
    x = (x ^ (x >> 15)) * tl.full((), 0x846CA68B, tl.uint32)
    return x ^ (x >> 16)


@triton.jit
@no_type_check
def _guided(k, depth, hit, jitter, TRUNCATION: tl.constexpr, FREE: tl.constexpr, NEAR: tl.constexpr, NONE_STEP):
    start = tl.maximum(depth - TRUNCATION, 0.0)
    width = depth + TRUNCATION - start
    free = (k.to(tl.float32) + jitter) * tl.div_rn(start, tl.full((), FREE, tl.float32))
    near = start + ((k - FREE).to(tl.float32) + jitter) * tl.div_rn(width, tl.full((), NEAR, tl.float32))
    none = (k.to(tl.float32) + jitter) * NONE_STEP
    return tl.where(hit, tl.where(k < FREE, free, near), none)


@triton.jit
@no_type_check
def _uniform(k, depth, hit, jitter, spaced, FREE: tl.constexpr, NEAR: tl.constexpr):
    count: tl.constexpr = FREE + NEAR
    is_near = (k >= FREE) & (k < count)
    # The first FREE values, then offsets in the band, then what replaces them on rays without depth.
    even = tl.load(spaced + k, mask=k < FREE, other=0.0)
    band = tl.load(spaced + k, mask=is_near, other=0.0)
    spare = tl.load(spaced + k + NEAR, mask=is_near, other=0.0)
    z = tl.where(is_near, tl.maximum(tl.where(hit, depth + band, spare), 0.0), even)
    z = tl.where(k < count, z, float("inf"))
    # Sorting by counting what comes before: rays are short.
    mine, other = z[:, :, None], z[:, None, :]
    earlier = (other < mine) | ((other == mine) & (k[:, None, :] < k[:, :, None]))
    rank = tl.sum(earlier.to(tl.int32), axis=2)[:, :, None]
    place = k[:, None, :]
    here = tl.sum(tl.where(rank == place, mine, 0.0), axis=1)
    before = tl.sum(tl.where(rank == place - 1, mine, 0.0), axis=1)
    after = tl.sum(tl.where(rank == place + 1, mine, 0.0), axis=1)
    lower = tl.where(k == 0, here, 0.5 * (here + before))
    upper = tl.where(k == count - 1, here, 0.5 * (after + here))
    moved = lower + (tl.where(k < count, upper, 0.0) - tl.where(k < count, lower, 0.0)) * jitter
    return tl.where(k < count, moved, 0.0)


@triton.jit
@no_type_check
def sample(
    header,
    rays,
    capacity,
    spaced,
    z_out,
    points_out,
    counts,
    none_step,
    max_depth,
    GUIDED: tl.constexpr,
    FREE: tl.constexpr,
    NEAR: tl.constexpr,
    SAMPLES_PAD: tl.constexpr,
    TRUNCATION: tl.constexpr,
    NO_DEPTH_IS_FREE: tl.constexpr,
    RAYS: tl.constexpr,
):
    """Depths and world points of all samples, and how many are free, in the band, and how many rays have depth.

    ``header`` holds the number of rays and the seed; ``rays`` has rows of ``capacity``: origin, direction, colour,
    depth. To be launched without fused multiply-adds, so that points are those of the other engines bit for bit.
    """
    samples: tl.constexpr = FREE + NEAR
    num_rays = tl.load(header)
    seed = tl.load(header + 1).to(tl.uint32, bitcast=True)
    ray = tl.program_id(0) * RAYS + tl.arange(0, RAYS)[:, None]
    k = tl.zeros((RAYS, 1), tl.int32) + tl.arange(0, SAMPLES_PAD)[None, :]
    inside = ray < num_rays
    depth = tl.load(rays + 9 * capacity + ray, mask=inside, other=0.0)
    hit = (depth > 0.0) & (depth <= max_depth)
    depth = tl.where(hit, depth, 0.0)
    bits = _mix(_mix((ray * samples + k).to(tl.uint32)) ^ _mix(seed))
    jitter = (bits >> 8).to(tl.float32) * 5.9604644775390625e-08
    if GUIDED:
        z = _guided(k, depth, hit, jitter, TRUNCATION, FREE, NEAR, none_step)
    else:
        z = _uniform(k, depth, hit, jitter, spaced, FREE, NEAR)
    used = inside & (k < samples)
    in_front = z < depth - TRUNCATION
    in_band = used & hit & (in_front == 0) & (z <= depth + TRUNCATION)
    free = used & (in_front | (hit == 0)) if NO_DEPTH_IS_FREE else used & in_front & hit
    tl.atomic_add(counts, tl.sum(tl.sum(free.to(tl.int32), axis=1), axis=0))
    tl.atomic_add(counts + 1, tl.sum(tl.sum(in_band.to(tl.int32), axis=1), axis=0))
    tl.atomic_add(counts + 2, tl.sum(tl.sum((hit & inside).to(tl.int32), axis=1), axis=0))
    slot = ray * samples + k
    tl.store(z_out + slot, z, mask=used)
    for axis in tl.static_range(3):
        origin = tl.load(rays + axis * capacity + ray, mask=inside, other=0.0)
        direction = tl.load(rays + (3 + axis) * capacity + ray, mask=inside, other=0.0)
        tl.store(points_out + axis * capacity * samples + slot, origin + direction * z, mask=used)


@triton.jit
@no_type_check
def _corner_axis(coordinate, cells_per_m, factor, key_mask):
    """Index keys of the lower and the upper corner along one axis, and the upper one's weight."""
    scaled = coordinate * cells_per_m
    cell = tl.floor(scaled)
    low = cell.to(tl.int32) * factor
    return low & key_mask, (low + factor) & key_mask, scaled - cell


@triton.jit
@no_type_check
def _cell(points, stride, point, inside, grid_floats, grid_ints, level, LEVELS: tl.constexpr):
    """Keys and weights of a level's cell about each point, x, y, z in turn."""
    cells_per_m = tl.load(grid_floats + level)
    x = tl.load(points + point, mask=inside, other=0.0)
    y = tl.load(points + stride + point, mask=inside, other=0.0)
    z = tl.load(points + 2 * stride + point, mask=inside, other=0.0)
    ints = grid_ints + level
    x_keys = _corner_axis(x, cells_per_m, tl.load(ints), tl.load(ints + 3 * LEVELS))
    y_keys = _corner_axis(y, cells_per_m, tl.load(ints + LEVELS), tl.load(ints + 4 * LEVELS))
    z_keys = _corner_axis(z, cells_per_m, tl.load(ints + 2 * LEVELS), tl.load(ints + 5 * LEVELS))
    return x_keys, y_keys, z_keys


@triton.jit
@no_type_check
def _corner(x_keys, y_keys, z_keys, CORNER: tl.constexpr):
    """Index within the level and trilinear weight of one of the eight corners."""
    x_weight = x_keys[2] if CORNER % 2 else 1.0 - x_keys[2]
    y_weight = y_keys[2] if CORNER // 2 % 2 else 1.0 - y_keys[2]
    z_weight = z_keys[2] if CORNER // 4 else 1.0 - z_keys[2]
    index = x_keys[CORNER % 2] ^ y_keys[CORNER // 2 % 2] ^ z_keys[CORNER // 4]
    return index, x_weight * (y_weight * z_weight)


@triton.jit
@no_type_check
def encode(
    points, stride, table, entries, features, grid_floats, grid_ints, LEVELS: tl.constexpr, POINTS: tl.constexpr
):
    """Interpolated grid features of ``stride`` points; one program per level and block of points."""
    level = tl.program_id(1)
    point = tl.program_id(0) * POINTS + tl.arange(0, POINTS)
    inside = point < stride
    x_keys, y_keys, z_keys = _cell(points, stride, point, inside, grid_floats, grid_ints, level, LEVELS)
    pair = tl.arange(0, 2)[None, :]
    total = tl.zeros((POINTS, 2), tl.float32)
    for corner in tl.static_range(8):
        index, weight = _corner(x_keys, y_keys, z_keys, corner)
        entry = tl.load(table + (level * entries + index)[:, None] * 2 + pair)
        total += weight[:, None] * entry
    row = features + (pair * LEVELS + level) * stride + point[:, None]
    tl.store(row, total, mask=inside[:, None])


@triton.jit
@no_type_check
def scatter(
    points,
    stride,
    count,
    feature_gradient,
    table_gradient,
    entries,
    grid_floats,
    grid_ints,
    LEVELS: tl.constexpr,
    POINTS: tl.constexpr,
):
    """Adds the gradients of the first ``count`` (a word in device memory) points' features to the table's."""
    level = tl.program_id(1)
    point = tl.program_id(0) * POINTS + tl.arange(0, POINTS)
    inside = point < tl.load(count)
    x_keys, y_keys, z_keys = _cell(points, stride, point, inside, grid_floats, grid_ints, level, LEVELS)
    pair = tl.arange(0, 2)[None, :]
    row = feature_gradient + (pair * LEVELS + level) * stride + point[:, None]
    gradient = tl.load(row, mask=inside[:, None], other=0.0)
    for corner in tl.static_range(8):
        index, weight = _corner(x_keys, y_keys, z_keys, corner)
        target = table_gradient + (level * entries + index)[:, None] * 2 + pair
        tl.atomic_add(target, weight[:, None] * gradient, mask=inside[:, None], sem="relaxed")


@triton.jit
@no_type_check
def _tile(pointer, rows, columns, stride, ROWS_PAD: tl.constexpr, COLUMNS_PAD: tl.constexpr):
    """A matrix of ``rows`` x ``columns``, padded with zeros."""
    row = tl.arange(0, ROWS_PAD)[:, None]
    column = tl.arange(0, COLUMNS_PAD)[None, :]
    return tl.load(pointer + row * stride + column, mask=(row < rows) & (column < columns), other=0.0)


@triton.jit
@no_type_check
def _store_tile(pointer, value, rows, columns, stride, ROWS_PAD: tl.constexpr, COLUMNS_PAD: tl.constexpr):
    row = tl.arange(0, ROWS_PAD)[:, None]
    column = tl.arange(0, COLUMNS_PAD)[None, :]
    tl.store(pointer + row * stride + column, value, mask=(row < rows) & (column < columns))


@triton.jit
@no_type_check
def _quartic_tail(distance):
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
def _blob(points, stride, point, inside, bins_per_m, BINS: tl.constexpr, BLOB_PAD: tl.constexpr):
    """The one-blob code as a dense tile, axis by axis."""
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


@triton.jit
@no_type_check
def _load_features(features, stride, point, inside, FEATURES: tl.constexpr, FEATURES_PAD: tl.constexpr):
    row = tl.arange(0, FEATURES_PAD)[None, :]
    return tl.load(features + row * stride + point[:, None], mask=inside[:, None] & (row < FEATURES), other=0.0)


@triton.jit
@no_type_check
def _load_decoders(
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
    sdf_grid = _tile(weights, HIDDEN, FEATURES, sdf_in, HIDDEN_PAD, FEATURES_PAD)
    sdf_blob = _tile(weights + FEATURES, HIDDEN, blob, sdf_in, HIDDEN_PAD, BLOB_PAD)
    sdf_out = _tile(weights + HIDDEN * sdf_in, OUTPUTS, HIDDEN, HIDDEN, OUTPUTS_PAD, HIDDEN_PAD)
    color = weights + HIDDEN * (sdf_in + OUTPUTS)
    color_blob = _tile(color, HIDDEN, blob, color_in, HIDDEN_PAD, BLOB_PAD)
    # Moved by one, so that columns are those of the SDF decoder's outputs, of which s takes no part.
    color_geometry = _tile(color + blob - 1, HIDDEN, OUTPUTS, color_in, HIDDEN_PAD, OUTPUTS_PAD)
    color_geometry = tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, 0.0, color_geometry)
    return sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry


@triton.jit
@no_type_check
def _product(a, b):
    return tl.dot(a, b, input_precision=_PRECISION)


@triton.jit
@no_type_check
def _decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD: tl.constexpr):
    """Hidden layer, all outputs, and s alone."""
    hidden = tl.maximum(_product(grid, tl.trans(sdf_grid)) + _product(blob, tl.trans(sdf_blob)), 0.0)
    outputs = _product(hidden, tl.trans(sdf_out))
    s = tl.sum(tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, outputs, 0.0), axis=1)
    return hidden, outputs, s


@triton.jit
@no_type_check
def _sigmoid(x):
    # By the exponential of what is negative, which cannot overflow.
    e = tl.exp(-tl.abs(x))
    return tl.where(x >= 0.0, 1.0, e) / (1.0 + e)


@triton.jit
@no_type_check
def _channel(hidden, weight):
    return _sigmoid(tl.sum(hidden * weight[None, :], axis=1))


@triton.jit
@no_type_check
def _color_out(weights, channel, HIDDEN: tl.constexpr, HIDDEN_PAD: tl.constexpr):
    column = tl.arange(0, HIDDEN_PAD)
    return tl.load(weights + channel * HIDDEN + column, mask=column < HIDDEN, other=0.0)


@triton.jit
@no_type_check
def decode(
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
    """The SDF s ("sets points") and, if COLOR, colours ("sets 3 points") under each set of decoder weights."""
    which = tl.program_id(1)
    weights += which * num_weights
    point = tl.program_id(0) * POINTS + tl.arange(0, POINTS)
    inside = point < stride
    sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry = _load_decoders(
        weights, FEATURES, BINS, HIDDEN, OUTPUTS, FEATURES_PAD, BLOB_PAD, HIDDEN_PAD, OUTPUTS_PAD
    )
    grid = _load_features(features, stride, point, inside, FEATURES, FEATURES_PAD)
    blob = _blob(points, stride, point, inside, bins_per_m, BINS, BLOB_PAD)
    _, outputs, s = _decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD)
    # Sets times points may pass 2^31.
    row = which.to(tl.int64) * stride
    tl.store(s_out + row + point, s, mask=inside)
    if COLOR:
        hidden = _product(blob, tl.trans(color_blob)) + _product(outputs, tl.trans(color_geometry))
        hidden = tl.maximum(hidden, 0.0)
        last = weights + num_weights - 3 * HIDDEN
        for channel in tl.static_range(3):
            value = _channel(hidden, _color_out(last, channel, HIDDEN, HIDDEN_PAD))
            tl.store(rgb_out + (3 * row + channel * stride) + point, value, mask=inside)


@triton.jit
@no_type_check
def train(
    header,
    rays,
    capacity,
    z_in,
    points,
    features,
    counts,
    bins_per_m,
    weights,
    partial,
    num_weights,
    max_depth,
    rgb_weight,
    depth_weight,
    sdf_weight,
    free_weight,
    no_depth_rgb,
    SAMPLES: tl.constexpr,
    SAMPLES_PAD: tl.constexpr,
    TRUNCATION: tl.constexpr,
    NO_DEPTH_IS_FREE: tl.constexpr,
    FEATURES: tl.constexpr,
    BINS: tl.constexpr,
    HIDDEN: tl.constexpr,
    OUTPUTS: tl.constexpr,
    FEATURES_PAD: tl.constexpr,
    BLOB_PAD: tl.constexpr,
    HIDDEN_PAD: tl.constexpr,
    OUTPUTS_PAD: tl.constexpr,
    RAYS: tl.constexpr,
):
    """Decoders, rendering, losses and their gradients for all rays; nothing in between leaves the processor.

    Gradients by the features take the features' place. Those by the decoders' weights are summed over the tiles of a
    program and written to its row of ``partial``, followed by the sums of squares of colour, depth, SDF and free
    space: no atomics, so the sums are the same in every run.
    """
    stride = capacity * SAMPLES
    num_rays = tl.load(header)
    num_free = tl.load(counts).to(tl.float32)
    num_band = tl.load(counts + 1).to(tl.float32)
    num_hit = tl.load(counts + 2).to(tl.float32)
    num_rays_float = num_rays.to(tl.float32)
    supervised = tl.maximum(num_free + num_band, 1.0) * (num_rays_float * SAMPLES)
    # Factors that turn residuals into gradients of the weighted total.
    rgb_scale = 2.0 * rgb_weight / (3.0 * num_rays_float)
    depth_scale = 2.0 * depth_weight / tl.maximum(num_hit, 1.0)
    sdf_scale = 2.0 * sdf_weight * TRUNCATION * num_free / supervised
    free_scale = 2.0 * free_weight * num_band / supervised

    sdf_grid_sum = tl.zeros((HIDDEN_PAD, FEATURES_PAD), tl.float32)
    sdf_blob_sum = tl.zeros((HIDDEN_PAD, BLOB_PAD), tl.float32)
    sdf_out_sum = tl.zeros((OUTPUTS_PAD, HIDDEN_PAD), tl.float32)
    color_blob_sum = tl.zeros((HIDDEN_PAD, BLOB_PAD), tl.float32)
    color_geometry_sum = tl.zeros((HIDDEN_PAD, OUTPUTS_PAD), tl.float32)
    red_sum = tl.zeros((HIDDEN_PAD,), tl.float32)
    green_sum = tl.zeros((HIDDEN_PAD,), tl.float32)
    blue_sum = tl.zeros((HIDDEN_PAD,), tl.float32)
    rgb_loss = tl.zeros((RAYS,), tl.float32)
    depth_loss = tl.zeros((RAYS,), tl.float32)
    sdf_loss = tl.zeros((RAYS,), tl.float32)
    free_loss = tl.zeros((RAYS,), tl.float32)

    for tile in range(tl.program_id(0), tl.cdiv(num_rays, RAYS), tl.num_programs(0)):
        # Read anew for each tile: kept, they would fill the registers.
        sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry = _load_decoders(
            weights, FEATURES, BINS, HIDDEN, OUTPUTS, FEATURES_PAD, BLOB_PAD, HIDDEN_PAD, OUTPUTS_PAD
        )
        last = weights + num_weights - 3 * HIDDEN
        red_out = _color_out(last, 0, HIDDEN, HIDDEN_PAD)
        green_out = _color_out(last, 1, HIDDEN, HIDDEN_PAD)
        blue_out = _color_out(last, 2, HIDDEN, HIDDEN_PAD)
        flat = tl.arange(0, RAYS * SAMPLES_PAD)
        flat_ray = tile * RAYS + flat // SAMPLES_PAD
        flat_k = flat % SAMPLES_PAD
        inside = (flat_ray < num_rays) & (flat_k < SAMPLES)
        point = flat_ray * SAMPLES + flat_k
        grid = _load_features(features, stride, point, inside, FEATURES, FEATURES_PAD)
        blob = _blob(points, stride, point, inside, bins_per_m, BINS, BLOB_PAD)
        sdf_hidden, outputs, flat_s = _decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD)
        color_hidden = _product(blob, tl.trans(color_blob)) + _product(outputs, tl.trans(color_geometry))
        color_hidden = tl.maximum(color_hidden, 0.0)

        # From here to the next blank line by ray and sample.
        s = tl.reshape(flat_s, (RAYS, SAMPLES_PAD))
        red = tl.reshape(_channel(color_hidden, red_out), (RAYS, SAMPLES_PAD))
        green = tl.reshape(_channel(color_hidden, green_out), (RAYS, SAMPLES_PAD))
        blue = tl.reshape(_channel(color_hidden, blue_out), (RAYS, SAMPLES_PAD))
        ray = tile * RAYS + tl.arange(0, RAYS)
        ray_inside = ray < num_rays
        k = tl.zeros((RAYS, 1), tl.int32) + tl.arange(0, SAMPLES_PAD)[None, :]
        used = ray_inside[:, None] & (k < SAMPLES)
        z = tl.load(z_in + ray[:, None] * SAMPLES + k, mask=used, other=0.0)
        measured = tl.load(rays + 9 * capacity + ray, mask=ray_inside, other=0.0)
        hit = (measured > 0.0) & (measured <= max_depth)
        measured = tl.where(hit, measured, 0.0)
        # Weights of eq. 2, see rendering.bell_weights, and their slope by s.
        e = tl.exp(-tl.abs(s) / _BELL_WIDTH)
        inverse = 1.0 / (1.0 + e)
        bell = e * inverse * inverse
        slope = tl.where(s > 0.0, 1.0, -1.0) * (e - 1.0) * inverse * bell / _BELL_WIDTH
        following = tl.gather(s, tl.minimum(k + 1, SAMPLES_PAD - 1), 1)
        crossing = used & (k + 1 < SAMPLES) & (s * following < 0.0)
        limit = tl.min(tl.where(crossing, z, float("inf")), axis=1) + TRUNCATION
        visible = used & (z < limit[:, None])
        bell = tl.where(visible, bell, 0.0)
        scale = 1.0 / (tl.sum(bell, axis=1) + 1e-8)
        weight = bell * scale[:, None]
        factor = tl.where(hit, 1.0, no_depth_rgb)
        red_in = tl.load(rays + 6 * capacity + ray, mask=ray_inside, other=0.0)
        green_in = tl.load(rays + 7 * capacity + ray, mask=ray_inside, other=0.0)
        blue_in = tl.load(rays + 8 * capacity + ray, mask=ray_inside, other=0.0)
        red_seen = tl.sum(weight * red, axis=1)
        green_seen = tl.sum(weight * green, axis=1)
        blue_seen = tl.sum(weight * blue, axis=1)
        depth_seen = tl.sum(weight * z, axis=1)
        red_residual = tl.where(ray_inside, (red_seen - red_in) * factor, 0.0)
        green_residual = tl.where(ray_inside, (green_seen - green_in) * factor, 0.0)
        blue_residual = tl.where(ray_inside, (blue_seen - blue_in) * factor, 0.0)
        depth_residual = tl.where(hit, depth_seen - measured, 0.0)
        rgb_loss += red_residual * red_residual + green_residual * green_residual + blue_residual * blue_residual
        depth_loss += depth_residual * depth_residual
        by_red = rgb_scale * factor * red_residual
        by_green = rgb_scale * factor * green_residual
        by_blue = rgb_scale * factor * blue_residual
        by_depth = depth_scale * depth_residual
        mean = by_red * red_seen + by_green * green_seen + by_blue * blue_seen + by_depth * depth_seen
        by_weight = by_red[:, None] * red + by_green[:, None] * green + by_blue[:, None] * blue
        by_weight += by_depth[:, None] * z - mean[:, None]
        depth_wide, hit_wide = measured[:, None], hit[:, None]
        in_front = z < depth_wide - TRUNCATION
        in_band = used & hit_wide & (in_front == 0) & (z <= depth_wide + TRUNCATION)
        free = used & (in_front | (hit_wide == 0)) if NO_DEPTH_IS_FREE else used & in_front & hit_wide
        free_residual = tl.where(free, s - 1.0, 0.0)
        sdf_residual = tl.where(in_band, z + s * TRUNCATION - depth_wide, 0.0)
        free_loss += tl.sum(free_residual * free_residual, axis=1)
        sdf_loss += tl.sum(sdf_residual * sdf_residual, axis=1)
        by_s = free_scale * free_residual + sdf_scale * sdf_residual
        by_s += tl.where(visible, by_weight * scale[:, None] * slope, 0.0)
        by_s = tl.reshape(by_s, (RAYS * SAMPLES_PAD,))[:, None]
        d_red = tl.reshape(by_red[:, None] * weight * red * (1.0 - red), (RAYS * SAMPLES_PAD,))[:, None]
        d_green = tl.reshape(by_green[:, None] * weight * green * (1.0 - green), (RAYS * SAMPLES_PAD,))[:, None]
        d_blue = tl.reshape(by_blue[:, None] * weight * blue * (1.0 - blue), (RAYS * SAMPLES_PAD,))[:, None]

        red_sum += tl.sum(d_red * color_hidden, axis=0)
        green_sum += tl.sum(d_green * color_hidden, axis=0)
        blue_sum += tl.sum(d_blue * color_hidden, axis=0)
        d_color = d_red * red_out[None, :] + d_green * green_out[None, :] + d_blue * blue_out[None, :]
        d_color = tl.where(color_hidden > 0.0, d_color, 0.0)
        color_blob_sum += _product(tl.trans(d_color), blob)
        color_geometry_sum += _product(tl.trans(d_color), outputs)
        d_outputs = _product(d_color, color_geometry)
        d_outputs = tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, by_s, d_outputs)
        sdf_out_sum += _product(tl.trans(d_outputs), sdf_hidden)
        d_sdf = tl.where(sdf_hidden > 0.0, _product(d_outputs, sdf_out), 0.0)
        sdf_grid_sum += _product(tl.trans(d_sdf), grid)
        sdf_blob_sum += _product(tl.trans(d_sdf), blob)
        row = tl.arange(0, FEATURES_PAD)[None, :]
        feature_mask = inside[:, None] & (row < FEATURES)
        tl.store(features + row * stride + point[:, None], _product(d_sdf, sdf_grid), mask=feature_mask)

    blob_size: tl.constexpr = 3 * BINS
    sdf_in: tl.constexpr = FEATURES + blob_size
    color_in: tl.constexpr = blob_size + OUTPUTS - 1
    out = partial + tl.program_id(0) * (num_weights + 4)
    _store_tile(out, sdf_grid_sum, HIDDEN, FEATURES, sdf_in, HIDDEN_PAD, FEATURES_PAD)
    _store_tile(out + FEATURES, sdf_blob_sum, HIDDEN, blob_size, sdf_in, HIDDEN_PAD, BLOB_PAD)
    _store_tile(out + HIDDEN * sdf_in, sdf_out_sum, OUTPUTS, HIDDEN, HIDDEN, OUTPUTS_PAD, HIDDEN_PAD)
    color = out + HIDDEN * (sdf_in + OUTPUTS)
    _store_tile(color, color_blob_sum, HIDDEN, blob_size, color_in, HIDDEN_PAD, BLOB_PAD)
    unit = tl.arange(0, HIDDEN_PAD)[:, None]
    column = tl.arange(0, OUTPUTS_PAD)[None, :]
    geometry_mask = (unit < HIDDEN) & (column >= 1) & (column < OUTPUTS)
    tl.store(color + blob_size - 1 + unit * color_in + column, color_geometry_sum, mask=geometry_mask)
    color_last = out + num_weights - 3 * HIDDEN + tl.arange(0, HIDDEN_PAD)
    unit_mask = tl.arange(0, HIDDEN_PAD) < HIDDEN
    tl.store(color_last, red_sum, mask=unit_mask)
    tl.store(color_last + HIDDEN, green_sum, mask=unit_mask)
    tl.store(color_last + 2 * HIDDEN, blue_sum, mask=unit_mask)
    tl.store(out + num_weights, tl.sum(rgb_loss, axis=0))
    tl.store(out + num_weights + 1, tl.sum(depth_loss, axis=0))
    tl.store(out + num_weights + 2, tl.sum(sdf_loss, axis=0))
    tl.store(out + num_weights + 3, tl.sum(free_loss, axis=0))


@triton.jit
@no_type_check
def _adam(parameter, first, second, gradient, step_size, root_bias, BETA1: tl.constexpr, BETA2: tl.constexpr, EPSILON):
    """The new parameter and moments; ``root_bias`` is the root of the second moment's bias."""
    first += (1.0 - BETA1) * (gradient - first)
    second = BETA2 * second + (1.0 - BETA2) * gradient * gradient
    parameter -= step_size * tl.div_rn(first, tl.div_rn(tl.sqrt_rn(second), root_bias) + EPSILON)
    return parameter, first, second


@triton.jit
@no_type_check
def adam_table(
    rates,
    parameters,
    first,
    second,
    gradient,
    size,
    epsilon,
    BETA1: tl.constexpr,
    BETA2: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """One step of Adam on the table; leaves its gradient zero for the next step."""
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = at < size
    p, m, v = _adam(
        tl.load(parameters + at, mask=inside, other=0.0),
        tl.load(first + at, mask=inside, other=0.0),
        tl.load(second + at, mask=inside, other=0.0),
        tl.load(gradient + at, mask=inside, other=0.0),
        tl.load(rates),
        tl.load(rates + 2),
        BETA1,
        BETA2,
        epsilon,
    )
    tl.store(parameters + at, p, mask=inside)
    tl.store(first + at, m, mask=inside)
    tl.store(second + at, v, mask=inside)
    tl.store(gradient + at, tl.zeros((BLOCK,), tl.float32), mask=inside)


@triton.jit
@no_type_check
def adam_decoders(
    rates,
    parameters,
    first,
    second,
    partial,
    num_partial,
    size,
    decay,
    epsilon,
    BETA1: tl.constexpr,
    BETA2: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """One step of Adam, with weight decay, on the decoders; sums up the rows of ``partial`` on the way."""
    at = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = at < size
    gradient = tl.zeros((BLOCK,), tl.float32)
    for row in range(num_partial):
        gradient += tl.load(partial + row * (size + 4) + at, mask=inside, other=0.0)
    parameter = tl.load(parameters + at, mask=inside, other=0.0)
    p, m, v = _adam(
        parameter,
        tl.load(first + at, mask=inside, other=0.0),
        tl.load(second + at, mask=inside, other=0.0),
        gradient + decay * parameter,
        tl.load(rates + 1),
        tl.load(rates + 2),
        BETA1,
        BETA2,
        epsilon,
    )
    tl.store(parameters + at, p, mask=inside)
    tl.store(first + at, m, mask=inside)
    tl.store(second + at, v, mask=inside)


EXACT = {"enable_fp_fusion": False}
"""Launch option for kernels whose products and sums have to round as the other engines' do."""
FUSED = {"enable_fp_fusion": True}
"""Launch option for all others; said aloud because Triton's default is about to change."""
INTERPRETED = not isinstance(encode, JITFunction)
"""Whether Triton's interpreter runs the kernels, on the host: ``TRITON_INTERPRET=1`` was set at import."""
