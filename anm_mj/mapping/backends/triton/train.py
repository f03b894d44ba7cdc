"""The heart of a training step: decoders, rendering, losses and all their gradients, in one kernel."""

from typing import no_type_check

import triton
import triton.language as tl

from anm_mj.mapping.backends.triton.decoders import (
    channel_value,
    decode_color_hidden,
    decode_sdf,
    load_channel,
    load_decoders,
    load_features,
)
from anm_mj.mapping.backends.triton.matrix import product, store_tile
from anm_mj.mapping.backends.triton.one_blob import blob_code
from anm_mj.mapping.backends.triton.rendering import loss_gradients


@triton.jit
@no_type_check
def train_kernel(
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

    ``header``, ``rays``, ``z_in``, ``points`` and ``counts`` are those of the sampling, ``features`` is "FEATURES
    capacity*SAMPLES", ``weights`` "num_weights", ``partial`` "programs num_weights+4".

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
        sdf_grid, sdf_blob, sdf_out, color_blob, color_geometry = load_decoders(
            weights, FEATURES, BINS, HIDDEN, OUTPUTS, FEATURES_PAD, BLOB_PAD, HIDDEN_PAD, OUTPUTS_PAD
        )
        last = weights + num_weights - 3 * HIDDEN
        red_out = load_channel(last, 0, HIDDEN, HIDDEN_PAD)
        green_out = load_channel(last, 1, HIDDEN, HIDDEN_PAD)
        blue_out = load_channel(last, 2, HIDDEN, HIDDEN_PAD)
        flat = tl.arange(0, RAYS * SAMPLES_PAD)
        flat_ray = tile * RAYS + flat // SAMPLES_PAD
        flat_k = flat % SAMPLES_PAD
        inside = (flat_ray < num_rays) & (flat_k < SAMPLES)
        point = flat_ray * SAMPLES + flat_k
        grid = load_features(features, stride, point, inside, FEATURES, FEATURES_PAD)
        blob = blob_code(points, stride, point, inside, bins_per_m, BINS, BLOB_PAD)
        sdf_hidden, outputs, flat_s = decode_sdf(grid, blob, sdf_grid, sdf_blob, sdf_out, OUTPUTS_PAD)
        color_hidden = decode_color_hidden(blob, outputs, color_blob, color_geometry)

        # By ray and sample, then flat again.
        s = tl.reshape(flat_s, (RAYS, SAMPLES_PAD))
        red = tl.reshape(channel_value(color_hidden, red_out), (RAYS, SAMPLES_PAD))
        green = tl.reshape(channel_value(color_hidden, green_out), (RAYS, SAMPLES_PAD))
        blue = tl.reshape(channel_value(color_hidden, blue_out), (RAYS, SAMPLES_PAD))
        ray = tile * RAYS + tl.arange(0, RAYS)
        ray_inside = ray < num_rays
        k = tl.zeros((RAYS, 1), tl.int32) + tl.arange(0, SAMPLES_PAD)[None, :]
        z = tl.load(z_in + ray[:, None] * SAMPLES + k, mask=ray_inside[:, None] & (k < SAMPLES), other=0.0)
        rgb_square, depth_square, sdf_square, free_square, by_s, d_red, d_green, d_blue = loss_gradients(
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
            SAMPLES,
            SAMPLES_PAD,
            TRUNCATION,
            NO_DEPTH_IS_FREE,
        )
        rgb_loss += rgb_square
        depth_loss += depth_square
        sdf_loss += sdf_square
        free_loss += free_square
        by_s = tl.reshape(by_s, (RAYS * SAMPLES_PAD,))[:, None]
        d_red = tl.reshape(d_red, (RAYS * SAMPLES_PAD,))[:, None]
        d_green = tl.reshape(d_green, (RAYS * SAMPLES_PAD,))[:, None]
        d_blue = tl.reshape(d_blue, (RAYS * SAMPLES_PAD,))[:, None]

        red_sum += tl.sum(d_red * color_hidden, axis=0)
        green_sum += tl.sum(d_green * color_hidden, axis=0)
        blue_sum += tl.sum(d_blue * color_hidden, axis=0)
        d_color = d_red * red_out[None, :] + d_green * green_out[None, :] + d_blue * blue_out[None, :]
        d_color = tl.where(color_hidden > 0.0, d_color, 0.0)
        color_blob_sum += product(tl.trans(d_color), blob)
        color_geometry_sum += product(tl.trans(d_color), outputs)
        d_outputs = product(d_color, color_geometry)
        d_outputs = tl.where(tl.arange(0, OUTPUTS_PAD)[None, :] == 0, by_s, d_outputs)
        sdf_out_sum += product(tl.trans(d_outputs), sdf_hidden)
        d_sdf = tl.where(sdf_hidden > 0.0, product(d_outputs, sdf_out), 0.0)
        sdf_grid_sum += product(tl.trans(d_sdf), grid)
        sdf_blob_sum += product(tl.trans(d_sdf), blob)
        row = tl.arange(0, FEATURES_PAD)[None, :]
        feature_mask = inside[:, None] & (row < FEATURES)
        tl.store(features + row * stride + point[:, None], product(d_sdf, sdf_grid), mask=feature_mask)

    blob_size: tl.constexpr = 3 * BINS
    sdf_in: tl.constexpr = FEATURES + blob_size
    color_in: tl.constexpr = blob_size + OUTPUTS - 1
    out = partial + tl.program_id(0) * (num_weights + 4)
    store_tile(out, sdf_grid_sum, HIDDEN, FEATURES, sdf_in, HIDDEN_PAD, FEATURES_PAD)
    store_tile(out + FEATURES, sdf_blob_sum, HIDDEN, blob_size, sdf_in, HIDDEN_PAD, BLOB_PAD)
    store_tile(out + HIDDEN * sdf_in, sdf_out_sum, OUTPUTS, HIDDEN, HIDDEN, OUTPUTS_PAD, HIDDEN_PAD)
    color = out + HIDDEN * (sdf_in + OUTPUTS)
    store_tile(color, color_blob_sum, HIDDEN, blob_size, color_in, HIDDEN_PAD, BLOB_PAD)
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
