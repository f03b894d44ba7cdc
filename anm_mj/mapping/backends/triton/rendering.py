"""Rendering along rays (:mod:`anm_mj.mapping.rendering`), the losses (``losses``), and the gradients of both.

A tile holds ``RAYS`` rays of ``SAMPLES_PAD`` samples; the functions here see it ray by ray.
"""

from typing import no_type_check

import triton
import triton.language as tl

from anm_mj.mapping.backends.triton.sampling import supervision
from anm_mj.mapping.rendering import WEIGHT_SCALE

_WEIGHT_SCALE = tl.constexpr(WEIGHT_SCALE)


@triton.jit
@no_type_check
def sdf_to_weight(s, z, used, k, SAMPLES: tl.constexpr, SAMPLES_PAD: tl.constexpr, TRUNCATION: tl.constexpr):
    """Weights of Eq. 2 that add up to one on each ray, what they were divided by, their slope by s, and where they are.

    All but the second "RAYS SAMPLES_PAD"; the slope is that before division, and stands beyond what is visible too.
    """
    e = tl.exp(-tl.abs(s) / _WEIGHT_SCALE)
    inverse = 1.0 / (1.0 + e)
    bell = e * inverse * inverse
    slope = tl.where(s > 0.0, 1.0, -1.0) * (e - 1.0) * inverse * bell / _WEIGHT_SCALE
    following = tl.gather(s, tl.minimum(k + 1, SAMPLES_PAD - 1), 1)
    crossing = used & (k + 1 < SAMPLES) & (s * following < 0.0)
    limit = tl.min(tl.where(crossing, z, float("inf")), axis=1) + TRUNCATION
    visible = used & (z < limit[:, None])
    bell = tl.where(visible, bell, 0.0)
    scale = 1.0 / (tl.sum(bell, axis=1) + 1e-8)
    return bell * scale[:, None], scale, slope, visible


@triton.jit
@no_type_check
def color_residual(seen, measured, factor, ray_inside):
    """How far one channel of rays is off, "RAYS"."""
    return tl.where(ray_inside, (seen - measured) * factor, 0.0)


@triton.jit
@no_type_check
def loss_gradients(
    rays,
    capacity,
    ray,
    ray_inside,
    s,
    red,
    green,
    blue,
    z,
    k,
    rgb_scale,
    depth_scale,
    sdf_scale,
    free_scale,
    max_depth,
    no_depth_rgb,
    SAMPLES: tl.constexpr,
    SAMPLES_PAD: tl.constexpr,
    TRUNCATION: tl.constexpr,
    NO_DEPTH_IS_FREE: tl.constexpr,
):
    """Sums of squared residuals of each ray, and gradients of the weighted total by each sample's s and colour.

    ``rays`` has rows of ``capacity``: origin, direction, colour, depth; ``ray`` ("RAYS") says which of them the tile
    holds, and ``ray_inside`` whether there are such. Of each sample, "RAYS SAMPLES_PAD", there are s and the colour in
    [0, 1], as decoded, its depth z [m] and its number k on the ray. A ``..._scale`` turns residuals into gradients.
    Surfaces beyond ``max_depth`` [m] are none; colours of rays without one count ``no_depth_rgb``.

    Returns sums for colour, depth, SDF and free space, "RAYS"; then gradients by s and by red, green and blue before
    the sigmoid, "RAYS SAMPLES_PAD".
    """
    used = ray_inside[:, None] & (k < SAMPLES)
    measured = tl.load(rays + 9 * capacity + ray, mask=ray_inside, other=0.0)
    hit = (measured > 0.0) & (measured <= max_depth)
    measured = tl.where(hit, measured, 0.0)
    weight, scale, slope, visible = sdf_to_weight(s, z, used, k, SAMPLES, SAMPLES_PAD, TRUNCATION)
    factor = tl.where(hit, 1.0, no_depth_rgb)
    red_in = tl.load(rays + 6 * capacity + ray, mask=ray_inside, other=0.0)
    green_in = tl.load(rays + 7 * capacity + ray, mask=ray_inside, other=0.0)
    blue_in = tl.load(rays + 8 * capacity + ray, mask=ray_inside, other=0.0)
    red_seen = tl.sum(weight * red, axis=1)
    green_seen = tl.sum(weight * green, axis=1)
    blue_seen = tl.sum(weight * blue, axis=1)
    depth_seen = tl.sum(weight * z, axis=1)
    red_residual = color_residual(red_seen, red_in, factor, ray_inside)
    green_residual = color_residual(green_seen, green_in, factor, ray_inside)
    blue_residual = color_residual(blue_seen, blue_in, factor, ray_inside)
    depth_residual = tl.where(hit, depth_seen - measured, 0.0)
    rgb_square = red_residual * red_residual + green_residual * green_residual + blue_residual * blue_residual
    by_red = rgb_scale * factor * red_residual
    by_green = rgb_scale * factor * green_residual
    by_blue = rgb_scale * factor * blue_residual
    by_depth = depth_scale * depth_residual
    mean = by_red * red_seen + by_green * green_seen + by_blue * blue_seen + by_depth * depth_seen
    by_weight = by_red[:, None] * red + by_green[:, None] * green + by_blue[:, None] * blue
    by_weight += by_depth[:, None] * z - mean[:, None]
    free, in_band = supervision(z, measured[:, None], hit[:, None], used, TRUNCATION, NO_DEPTH_IS_FREE)
    free_residual = tl.where(free, s - 1.0, 0.0)
    sdf_residual = tl.where(in_band, z + s * TRUNCATION - measured[:, None], 0.0)
    free_square = tl.sum(free_residual * free_residual, axis=1)
    sdf_square = tl.sum(sdf_residual * sdf_residual, axis=1)
    by_s = free_scale * free_residual + sdf_scale * sdf_residual
    by_s += tl.where(visible, by_weight * scale[:, None] * slope, 0.0)
    d_red = by_red[:, None] * weight * red * (1.0 - red)
    d_green = by_green[:, None] * weight * green * (1.0 - green)
    d_blue = by_blue[:, None] * weight * blue * (1.0 - blue)
    return rgb_square, depth_residual * depth_residual, sdf_square, free_square, by_s, d_red, d_green, d_blue
