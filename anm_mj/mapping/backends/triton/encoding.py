"""The hash grid (:class:`anm_mj.mapping.encoding.HashGrid`): reading features, and adding to the table's gradient.

To be launched with ``EXACT``, so that cells are those of the other engines bit for bit.
"""

from typing import no_type_check

import triton
import triton.language as tl


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
def encode_kernel(
    points, stride, table, entries, features, grid_floats, grid_ints, LEVELS: tl.constexpr, POINTS: tl.constexpr
):
    """Interpolated grid features of points; one program per level and block of points.

    ``points`` is "3 stride" [m], ``table`` "LEVELS*entries 2", ``features`` "2*LEVELS stride"; ``grid_floats`` holds
    cells per metre ("LEVELS"), ``grid_ints`` the factors, then the masks of the index formula ("3 LEVELS" each).
    """
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
def scatter_kernel(
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
    """Adds the gradients by features of the first ``count`` (a word in device memory) points to the table's.

    ``feature_gradient`` is "2*LEVELS stride", ``table_gradient`` "LEVELS*entries 2", the rest as for the encoding. Sums
    are made by atomics, in no fixed order.
    """
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
