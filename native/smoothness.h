// The smoothness term: squared differences of neighbouring features on a lattice, level by level.
#pragma once

#include "encoding.h"

namespace {

// The lattice of the smoothness term on one level: keys and weights per axis and lattice index.
struct LatticeAxis {
    std::uint32_t* key[2];
    float* weight[2];
};

ANM_INLINE void lattice_axis(const Level& level, int axis, float corner, float spacing, int points, LatticeAxis& out) {
    for (int i = 0; i < points; ++i) {
        const float position = corner + rounded(static_cast<float>(i) * spacing);
        const float scaled = rounded(position * level.cells_per_m);
        const float cell = __builtin_floorf(scaled);
        const std::uint32_t low = static_cast<std::uint32_t>(static_cast<std::int32_t>(cell)) * level.factor[axis];
        out.key[0][i] = low & level.mask[axis];
        out.key[1][i] = (low + level.factor[axis]) & level.mask[axis];
        out.weight[0][i] = 1.0F - (scaled - cell);
        out.weight[1][i] = scaled - cell;
    }
}

// Sum of squared differences of neighbouring features over the lattice; adds `scale` times its gradient to grad_table.
// features: room for points^3 pairs. axes: room for 12 * points values.
ANM_INLINE double smoothness(const Level& level, const float* table, const float* corner_m, float spacing, int points,
                             float scale, float* features, float* axes, float* grad_table) {
    LatticeAxis lattice[3];
    for (int axis = 0; axis < 3; ++axis) {
        for (int side = 0; side < 2; ++side) {
            lattice[axis].key[side] = reinterpret_cast<std::uint32_t*>(axes) + (4 * axis + side) * points;
            lattice[axis].weight[side] = axes + (4 * axis + 2 + side) * points;
        }
        lattice_axis(level, axis, corner_m[axis], spacing, points, lattice[axis]);
    }
    const auto visit = [&](auto&& at_point) {
        for (int i = 0; i < points; ++i) {
            for (int j = 0; j < points; ++j) {
                std::uint32_t key_xy[4];
                float weight_xy[4];
                for (int c = 0; c < 4; ++c) {
                    key_xy[c] = lattice[0].key[c & 1][i] ^ lattice[1].key[c >> 1][j];
                    weight_xy[c] = lattice[0].weight[c & 1][i] * lattice[1].weight[c >> 1][j];
                }
                for (int k = 0; k < points; ++k) at_point(i, j, k, key_xy, weight_xy);
            }
        }
    };
    const int step[3] = {points * points, points, 1};
    visit([&](int i, int j, int k, const std::uint32_t* key_xy, const float* weight_xy) {
        F2 value{};
        for (int c = 0; c < 8; ++c) {
            const std::uint32_t index = key_xy[c & 3] ^ lattice[2].key[c >> 2][k];
            value += load2(table + 2 * index) * (weight_xy[c & 3] * lattice[2].weight[c >> 2][k]);
        }
        store2(features + 2 * (i * step[0] + j * step[1] + k), value);
    });
    double total = 0.0;
    visit([&](int i, int j, int k, const std::uint32_t* key_xy, const float* weight_xy) {
        const int place[3] = {i, j, k};
        const float* centre = features + 2 * (i * step[0] + j * step[1] + k);
        const F2 value = load2(centre);
        F2 d{};
        for (int axis = 0; axis < 3; ++axis) {
            if (place[axis] > 0) d += value - load2(centre - 2 * step[axis]);
            if (place[axis] < points - 1) {
                const F2 forward = load2(centre + 2 * step[axis]) - value;
                d -= forward;
                total += static_cast<double>(forward[0] * forward[0] + forward[1] * forward[1]);
            }
        }
        d *= 2.0F * scale;
        for (int c = 0; c < 8; ++c) {
            float* entry = grad_table + 2 * (key_xy[c & 3] ^ lattice[2].key[c >> 2][k]);
            store2(entry, load2(entry) + d * (weight_xy[c & 3] * lattice[2].weight[c >> 2][k]));
        }
    });
    return total;
}

}  // namespace
