// Registration of a frame to an earlier one: normal equations of point-to-plane distances and grey values, where each
// point falls into the other image. It needs no map: sharp where the two overlap, blind elsewhere.
#pragma once

#include "lane_sums.h"

namespace {

using anm::FrameSums;
using anm::FrameToFrame;
using anm::GrayPoints;
using anm::KeyView;
using anm::kMeasured;

// Numbers of 16 bits (IEEE 754), in the low halves of integers.
ANM_INLINE F from_half(I bits) {
    const I shifted = (bits & 0x7FFF) << 13;
    F size;
    std::memcpy(&size, &shifted, sizeof size);
    size *= 0x1p112F;
    return (bits & 0x8000) != 0 ? -size : size;
}

ANM_INLINE F magnitude(F v) { return v < 0.0F ? -v : v; }

// Depths of a pixel in each lane and of those at `stencil` pixels to its left, right, above and below; where these lie beyond
// the border, of one at it.
ANM_INLINE void depths_about(const KeyView& image, I row, I col, F (&out)[5]) {
    alignas(64) std::int32_t at[kLanes], found[kLanes];
    const I none{}, last_col = none + (image.width - 1), last_row = none + (image.height - 1);
    const I left = col - image.stencil, right = col + image.stencil, up = row - image.stencil, down = row + image.stencil;
    const I rows[5] = {row, row, row, up > 0 ? up : none, down < last_row ? down : last_row};
    const I cols[5] = {col, left > 0 ? left : none, right < last_col ? right : last_col, col, col};
    for (int k = 0; k < 5; ++k) {
        const I index = rows[k] * image.width + cols[k];
        std::memcpy(at, &index, sizeof index);
        for (int lane = 0; lane < kLanes; ++lane) found[lane] = image.depth[at[lane]];
        I bits;
        std::memcpy(&bits, found, sizeof bits);
        out[k] = from_half(bits);
    }
}

// Sums over a frame's points, by this camera's displacement along the earlier camera's axes and its rotation vector
// about them.
void frame_to_frame(const GrayPoints& points, const KeyView& image, const FrameToFrame& at, FrameSums& out) {
    if (image.width < 3 || image.height < 3) return;
    LaneSums distances, grays;
    F cross[6] = {}, gain_square{}, gain_gradient{};
    const F zero{}, one = zero + 1.0F;
    const bool with_gray = at.gray_deviation > 0.0F && image.gray_width > 1 && image.gray_height > 1;
    const float precision = with_gray ? 1.0F / (at.gray_deviation * at.gray_deviation) : 0.0F;
    for (int begin = 0; begin < points.count; begin += kLanes) {
        alignas(64) float camera[3][kLanes], own_gray[kLanes], own_variance[kLanes], own_trust[kLanes];
        for (int lane = 0; lane < kLanes; ++lane) {
            const bool has = begin + lane < points.count;
            const int i = has ? begin + lane : begin;
            for (int axis = 0; axis < 3; ++axis) camera[axis][lane] = points.camera[3 * static_cast<std::ptrdiff_t>(i) + axis];
            own_gray[lane] = points.gray[i];
            own_variance[lane] = points.variance[i];
            own_trust[lane] = has ? points.trust[i] : 0.0F;
        }
        F x[3] = {load(camera[0]), load(camera[1]), load(camera[2])}, arm[3], p[3], length{};
        for (int axis = 0; axis < 3; ++axis) {
            const float* r = image.rotation + 3 * axis;
            arm[axis] = r[0] * x[0] + r[1] * x[1] + r[2] * x[2];
            p[axis] = arm[axis] + image.position[axis];
            length += arm[axis] * arm[axis];
        }
        F trust = load(own_trust);
        const F per_depth = 1.0F / (p[2] > 0.05F ? p[2] : one);
        F u = image.fx * p[0] * per_depth + image.cx, v = image.fy * p[1] * per_depth + image.cy;
        const auto only_where = [&](auto condition) { trust = condition ? trust : zero; };
        only_where(p[2] > 0.05F);
        only_where(u >= 1.0F);
        only_where(v >= 1.0F);
        only_where(u < image.width - 1.0F);
        only_where(v < image.height - 1.0F);
        if (!(sum(trust) > 0.0F)) continue;
        u = trust > 0.0F ? u : one;
        v = trust > 0.0F ? v : one;
        const I col = to_int(u), row = to_int(v);
        F z[5];
        depths_about(image, row, col, z);
        const F own = z[0];
        const auto jacobian = [&](const F (&g)[3], F (&out_row)[6]) {
            for (int axis = 0; axis < 3; ++axis) out_row[axis] = g[axis];
            out_row[3] = arm[1] * g[2] - arm[2] * g[1];
            out_row[4] = arm[2] * g[0] - arm[0] * g[2];
            out_row[5] = arm[0] * g[1] - arm[1] * g[0];
        };
        // The plane about the pixel, unless it is an edge, at the border, or a neighbour was not measured.
        F plane = trust;
        const auto plane_where = [&](auto condition) { plane = condition ? plane : zero; };
        for (const F& depth : z) {
            plane_where(depth > 0.0F);
            plane_where(depth < kMeasured);
        }
        plane_where(col >= image.stencil);
        plane_where(row >= image.stencil);
        plane_where(col < image.width - image.stencil);
        plane_where(row < image.height - image.stencil);
        const F bend = at.edge_share * own;
        plane_where(magnitude(z[1] + z[2] - 2.0F * own) <= bend);
        plane_where(magnitude(z[3] + z[4] - 2.0F * own) <= bend);
        const F x_of = (to_float(col) + (0.5F - image.cx)) * (1.0F / image.fx);
        const F y_of = (to_float(row) + (0.5F - image.cy)) * (1.0F / image.fy);
        const float dx = image.stencil / image.fx, dy = image.stencil / image.fy;
        const F across = z[2] - z[1], down = z[4] - z[3];
        const F a[3] = {x_of * across + dx * (z[2] + z[1]), y_of * across, across};
        const F b[3] = {x_of * down, y_of * down + dy * (z[4] + z[3]), down};
        // Towards the camera.
        F normal[3] = {b[1] * a[2] - b[2] * a[1], b[2] * a[0] - b[0] * a[2], b[0] * a[1] - b[1] * a[0]};
        const F square_length = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        plane_where(square_length > 1e-24F);
        const F scale = 1.0F / square_root(plane > 0.0F ? square_length : one);
        for (F& value : normal) value = plane > 0.0F ? value * scale : zero;
        const F surface[3] = {x_of * own, y_of * own, own};
        F distance{}, incidence{};
        for (int axis = 0; axis < 3; ++axis) {
            distance += normal[axis] * (p[axis] - surface[axis]);
            incidence += normal[axis] * arm[axis];
        }
        incidence *= incidence / (length > 0.0F ? length : one);
        const F noise = image.noise * own * own;
        const float own_deviation = at.deviation * at.deviation;
        // An edge, or noise, gives no plane, but what it looks like, where it is the same surface.
        const F seen = magnitude(own), bent = at.edge_share * seen, apart = p[2] - seen;
        const F variance = load(own_variance);
        const F spread = own_deviation + (plane > 0.0F ? (variance + noise * noise) * incidence : variance + bent * bent);
        const F off = plane > 0.0F ? distance : apart;
        only_where(seen > 0.0F);
        only_where(seen < kMeasured);
        only_where(magnitude(off) <= at.reach);
        F cost, weight;
        robust(off * off / spread, at.kernel, cost, weight);
        weight *= trust;
        const F on_plane = plane > 0.0F ? trust : zero;
        const F counted = on_plane > 0.0F ? one : zero;
        F line[6];
        jacobian(normal, line);
        const F weight_of_plane = on_plane > 0.0F ? weight : zero;
        distances.add(line, distance, weight_of_plane / spread, weight_of_plane, on_plane * cost, counted);
        if (!with_gray) continue;
        F left = u * image.gray_share - 0.5F, top = v * image.gray_share - 0.5F;
        const auto visible_where = [&](auto condition) { weight = condition ? weight : zero; };
        visible_where(left >= 0.0F);
        visible_where(top >= 0.0F);
        visible_where(left < image.gray_width - 1.0F);
        visible_where(top < image.gray_height - 1.0F);
        left = weight > 0.0F ? left : zero;
        top = weight > 0.0F ? top : zero;
        const I first = to_int(left), above = to_int(top);
        const I corner = above * image.gray_width + first;
        alignas(64) std::int32_t corners[kLanes];
        alignas(64) float taps[4][kLanes];
        std::memcpy(corners, &corner, sizeof corner);
        for (int lane = 0; lane < kLanes; ++lane) {
            const std::uint8_t* tap = image.gray + corners[lane];
            taps[0][lane] = tap[0];
            taps[1][lane] = tap[1];
            taps[2][lane] = tap[image.gray_width];
            taps[3][lane] = tap[image.gray_width + 1];
        }
        const F s = left - to_float(first), t = top - to_float(above);
        const F g00 = load(taps[0]), g01 = load(taps[1]), g10 = load(taps[2]), g11 = load(taps[3]);
        const F upper = g00 + s * (g01 - g00), lower = g10 + s * (g11 - g10);
        constexpr float kUnit = 1.0F / 255.0F;
        const F there = (upper + t * (lower - upper)) * kUnit;
        const F difference = there - load(own_gray);
        const F by_v = (lower - upper) * kUnit, by_u = ((g01 - g00) + t * ((g11 - g10) - (g01 - g00))) * kUnit;
        const F gray_per_m = image.gray_share * per_depth;
        const F du = by_u * image.fx * gray_per_m, dv = by_v * image.fy * gray_per_m;
        const F slope[3] = {du, dv, -(du * p[0] + dv * p[1]) * per_depth};
        F gray_cost, gray_weight;
        robust(difference * difference * precision, at.gray_kernel, gray_cost, gray_weight);
        const F believed = weight * gray_weight * precision;
        jacobian(slope, line);
        grays.add(line, difference, believed, weight * gray_weight, weight * gray_cost, weight > 0.0F ? one : zero);
        const F of_gain = believed * there;
        for (int k = 0; k < 6; ++k) cross[k] += line[k] * of_gain;
        gain_square += of_gain * there;
        gain_gradient += of_gain * difference;
    }
    add_to(out.of[0], distances);
    add_to(out.of[1], grays);
    for (int k = 0; k < 6; ++k) out.gain.cross[k] += static_cast<double>(sum(cross[k]));
    out.gain.square += static_cast<double>(sum(gain_square));
    out.gain.gradient += static_cast<double>(sum(gain_gradient));
}

}  // namespace
