// Sample variance over the passes of noisy decoders, as anm_mj/mapping/uncertainty.py has it.
#pragma once

#include <algorithm>
#include <cstdint>

namespace anm {

constexpr std::int64_t kVarianceTile = 256;  // values that are summed side by side

// Variances over passes, with one degree of freedom less, of `count` values in a row; passes lie `stride` apart.
inline void variances(const float* values, std::int64_t passes, std::int64_t stride, std::int64_t count, float* out) {
    float mean[kVarianceTile];
    for (std::int64_t i = 0; i < count; ++i) mean[i] = values[i];
    for (std::int64_t k = 1; k < passes; ++k) {
        for (std::int64_t i = 0; i < count; ++i) mean[i] += values[k * stride + i];
    }
    for (std::int64_t i = 0; i < count; ++i) mean[i] /= static_cast<float>(passes);
    for (std::int64_t i = 0; i < count; ++i) out[i] = 0.0F;
    for (std::int64_t k = 0; k < passes; ++k) {
        for (std::int64_t i = 0; i < count; ++i) {
            const float off = values[k * stride + i] - mean[i];
            out[i] += off * off;
        }
    }
    for (std::int64_t i = 0; i < count; ++i) out[i] /= static_cast<float>(passes - 1);
}

// Variance of s and the weighted mean one of the colours at each point. sdf [passes][points], rgb [passes][points][3].
inline void pass_variance(const float* sdf, const float* rgb, std::int64_t passes, std::int64_t points,
                          float color_weight, float* out) {
    float color[3 * (kVarianceTile / 3)];
    constexpr std::int64_t kPoints = kVarianceTile / 3;
    for (std::int64_t first = 0; first < points; first += kPoints) {
        const std::int64_t count = std::min(kPoints, points - first);
        variances(sdf + first, passes, points, count, out + first);
        variances(rgb + 3 * first, passes, 3 * points, 3 * count, color);
        for (std::int64_t i = 0; i < count; ++i) {
            const float mean = (color[3 * i] + color[3 * i + 1] + color[3 * i + 2]) / 3.0F;
            out[first + i] += color_weight * mean;
        }
    }
}

}  // namespace anm
