// Depth of an earlier frame as registration compares with it: averaged over planes, kept at edges.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "kernel.h"

namespace anm {

// A number of 16 bits (IEEE 754).
inline float from_half(std::uint16_t bits) {
    const std::uint32_t shifted = static_cast<std::uint32_t>(bits & 0x7FFFU) << 13;
    float size;
    std::memcpy(&size, &shifted, sizeof size);
    size *= 0x1p112F;
    return (bits & 0x8000U) != 0U ? -size : size;
}

// The mean of inverse depth over squares that reach `radius` pixels, as depth; at edges, where the squares spread by more
// than a share of themselves and the noise, what was measured, negative; 0 where nothing was measured.
inline void smoothed_depth(const float* depth, int height, int width, int radius, double noise, double spread_share,
                           float* out) {
    constexpr float kNearest = 1e-3F;  // m; the squares of what is nearer would drown the others in the running sums
    struct Sums { double count, total, square; };
    const int size = 2 * radius + 1;
    std::vector<Sums> columns(static_cast<std::size_t>(width), Sums{0.0, 0.0, 0.0});
    const auto inverse_at = [&](int row, int col) {
        const float z = depth[static_cast<std::ptrdiff_t>(row) * width + col];
        return z > kNearest && z < kMeasured ? 1.0 / static_cast<double>(z) : 0.0;
    };
    const auto add_line = [&](int row, double sign) {
        if (row < 0 || row >= height) return;
        for (int col = 0; col < width; ++col) {
            const double inverse = inverse_at(row, col);
            Sums& sums = columns[static_cast<std::size_t>(col)];
            sums.count += inverse > 0.0 ? sign : 0.0;
            sums.total += sign * inverse;
            sums.square += sign * inverse * inverse;
        }
    };
    for (int row = 0; row < radius; ++row) add_line(row, 1.0);
    for (int row = 0; row < height; ++row) {
        add_line(row + radius, 1.0);
        add_line(row - radius - 1, -1.0);
        Sums sums{0.0, 0.0, 0.0};
        const auto add_column = [&](int col, double sign) {
            if (col < 0 || col >= width) return;
            const Sums& other = columns[static_cast<std::size_t>(col)];
            sums.count += sign * other.count;
            sums.total += sign * other.total;
            sums.square += sign * other.square;
        };
        for (int col = 0; col < radius; ++col) add_column(col, 1.0);
        for (int col = 0; col < width; ++col) {
            add_column(col + radius, 1.0);
            add_column(col - radius - 1, -1.0);
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) * width + col;
            const double inverse = inverse_at(row, col);
            if (!(inverse > 0.0)) {
                out[at] = 0.0F;
                continue;
            }
            const double mean = sums.total / sums.count;
            const double variance = sums.square / sums.count - mean * mean;
            // A plane spreads too, but over a few pixels only by a small share.
            const double most = std::max(spread_share * mean, 2.0 * noise);
            const bool smooth = 2.0 * sums.count > size * size && variance < most * most;
            out[at] = smooth ? static_cast<float>(1.0 / mean) : -depth[at];
        }
    }
}

}  // namespace anm
