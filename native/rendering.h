// Rendering along rays (paper, Eq. 1 and 2), the losses on them and their gradients by s and colour.
#pragma once

#include "decoder.h"
#include "sampling.h"

namespace {

constexpr float kWeightScale = 0.1F;

// Weights of Eq. 2 before masking and normalising, and their derivative by s.
ANM_INLINE void sdf_to_weight(const float* s, int slots, float* value, float* slope) {
    for (int i = 0; i < slots; i += kLanes) {
        const F x = load(s + i) * (1.0F / kWeightScale);
        const F e = exp_negative(x > 0.0F ? -x : x);
        const F inverse = 1.0F / (1.0F + e);
        const F b = e * inverse * inverse;
        const F sign = x > 0.0F ? F{} + 1.0F : F{} - 1.0F;
        store(value + i, b);
        store(slope + i, sign * (e - 1.0F) * inverse * b * (1.0F / kWeightScale));
    }
}

// Number of samples, from the first, that take part in rendering: those up to a truncation behind the first sign
// change.
ANM_INLINE int visible_samples(const float* s, const float* z, int samples, float truncation) {
    for (int i = 0; i + 1 < samples; ++i) {
        if (s[i + 1] * s[i] < 0.0F) {
            const float limit = z[i] + truncation;
            int end = i + 1;
            while (end < samples && z[end] < limit) ++end;
            return end;
        }
    }
    return samples;
}

struct Rendered {
    float rgb[3], depth;
    float inverse_sum;
    int visible;
};

ANM_INLINE Rendered render_ray(const Activations& a, int first, const float* z, int samples, float truncation,
                               const float* value) {
    Rendered out{};
    out.visible = visible_samples(a.s + first, z, samples, truncation);
    float total = 0.0F;
    for (int i = 0; i < out.visible; ++i) {
        const float weight = value[first + i];
        total += weight;
        for (int c = 0; c < 3; ++c) out.rgb[c] += weight * a.rgb[c * a.capacity + first + i];
        out.depth += weight * z[i];
    }
    out.inverse_sum = 1.0F / (total + 1e-8F);
    for (float& channel : out.rgb) channel *= out.inverse_sum;
    out.depth *= out.inverse_sum;
    return out;
}

// How many samples and rays the terms are taken over; known before the network is asked.
struct Counts {
    std::int64_t free = 0, band = 0, valid = 0;
};

// Factors that turn residuals into gradients of the weighted total.
struct LossScale {
    float rgb, depth, sdf, free;
};

struct LossSums {
    double rgb = 0.0, depth = 0.0, sdf = 0.0, free = 0.0;
};

enum class Place { kNone, kFree, kBand };

ANM_INLINE Place place_of(const Settings& c, bool hit, float depth, float z) {
    if (!hit) return c.no_depth_is_free ? Place::kFree : Place::kNone;
    if (z < depth - c.truncation) return Place::kFree;
    return z <= depth + c.truncation ? Place::kBand : Place::kNone;
}

// Losses of one ray, and their gradients into a.grad_sdf and a.grad_rgb.
ANM_INLINE void ray_loss(const Settings& c, const LossScale& scale, const Activations& a, int first, const float* z,
                         const float* value, const float* slope, float measured_depth, const float* measured_rgb,
                         LossSums& sums) {
    const int samples = c.samples();
    const bool hit = has_surface(c, measured_depth);
    const float depth = hit ? measured_depth : 0.0F;
    const Rendered seen = render_ray(a, first, z, samples, c.truncation, value);
    const float factor = hit ? 1.0F : c.no_depth_rgb;
    float grad_rgb[3], grad_depth = 0.0F;
    float mean = 0.0F;
    for (int k = 0; k < 3; ++k) {
        const float residual = (seen.rgb[k] - measured_rgb[k]) * factor;
        sums.rgb += static_cast<double>(residual * residual);
        grad_rgb[k] = scale.rgb * residual * factor;
        mean += grad_rgb[k] * seen.rgb[k];
    }
    if (hit) {
        const float residual = seen.depth - depth;
        sums.depth += static_cast<double>(residual * residual);
        grad_depth = scale.depth * residual;
        mean += grad_depth * seen.depth;
    }
    for (int i = 0; i < samples; ++i) {
        const int slot = first + i;
        const float s = a.s[slot];
        float grad_sdf = 0.0F;
        const Place place = place_of(c, hit, depth, z[i]);
        if (place == Place::kFree) {
            const float residual = s - 1.0F;
            sums.free += static_cast<double>(residual * residual);
            grad_sdf = scale.free * residual;
        } else if (place == Place::kBand) {
            const float residual = z[i] + s * c.truncation - depth;
            sums.sdf += static_cast<double>(residual * residual);
            grad_sdf = scale.sdf * residual;
        }
        float* grad_color = a.grad_rgb + 4 * slot;
        if (i < seen.visible) {
            const float weight = value[slot] * seen.inverse_sum;
            float by_weight = grad_depth * z[i] - mean;
            for (int k = 0; k < 3; ++k) {
                const float color = a.rgb[k * a.capacity + slot];
                by_weight += grad_rgb[k] * color;
                grad_color[k] = grad_rgb[k] * weight * color * (1.0F - color);
            }
            grad_sdf += by_weight * seen.inverse_sum * slope[slot];
        } else {
            for (int k = 0; k < 3; ++k) grad_color[k] = 0.0F;
        }
        grad_color[3] = 0.0F;
        a.grad_sdf[slot] = grad_sdf;
    }
}

}  // namespace
