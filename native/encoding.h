// Hash grid of world points: the formulas of anm_mj/mapping/encoding.py, rounding included.
#pragma once

#include "kernel.h"
#include "simd.h"

namespace {

using anm::kGroup;
using anm::Level;
using anm::Model;
using anm::Settings;

// World positions of slots, one array per axis; readable up to the next multiple of kGroup.
struct Positions {
    float* axis[3];
};

// The eight cell corners about each slot of a group: entries, corner 4 z + 2 y + x; weights of the four edges along x,
// and of the higher of an edge's two corners.
struct Corners {
    alignas(64) std::uint32_t index[8][kGroup];
    alignas(64) float edge[4][kGroup];
    alignas(64) float high[kGroup];
};

ANM_INLINE void find_corners(const Level& level, const Positions& at, std::ptrdiff_t slot, Corners& out) {
    for (int lane = 0; lane < kGroup; lane += kLanes) {
        U key[3][2];
        F weight[3][2];
        for (int axis = 0; axis < 3; ++axis) {
            const F scaled = rounded(load(at.axis[axis] + slot + lane) * level.cells_per_m);
            const F cell = floor(scaled);
            const U low_key = reinterpret_cast<U>(to_int(cell)) * level.factor[axis];
            key[axis][0] = low_key & level.mask[axis];
            key[axis][1] = (low_key + level.factor[axis]) & level.mask[axis];
            weight[axis][1] = scaled - cell;
            weight[axis][0] = 1.0F - weight[axis][1];
        }
        store(out.high + lane, weight[0][1]);
        for (int edge = 0; edge < 4; ++edge) {
            const U key_yz = key[1][edge & 1] ^ key[2][edge >> 1];
            for (int x = 0; x < 2; ++x) {
                const U index = key[0][x] ^ key_yz;
                std::memcpy(out.index[2 * edge + x] + lane, &index, sizeof index);
            }
            store(out.edge[edge] + lane, weight[1][edge & 1] * weight[2][edge >> 1]);
        }
    }
}

// Distance between levels in an array of features of `slots` slots. Away from powers of two, which would make all
// levels of a slot compete for the same few places in the cache.
ANM_INLINE std::ptrdiff_t feature_stride(std::ptrdiff_t slots) {
    constexpr std::ptrdiff_t kPage = 1024, kOffset = 80;
    return (2 * slots + kPage - 1) / kPage * kPage + kOffset;
}

template <class T>
ANM_INLINE T* entry(T* table, std::uint32_t index) {
    return table + 2 * static_cast<std::size_t>(index);
}

// Asks for the table's lines that a group will need. Corners next to each other in x mostly share one.
ANM_INLINE void prefetch(const Corners& corners, const float* table) {
    for (int c = 0; c < 8; c += 2) {
        for (int s = 0; s < kGroup; ++s) __builtin_prefetch(entry(table, corners.index[c][s]));
    }
}

// Features of a group.
ANM_INLINE void interpolate(const Corners& corners, const float* table, float* features) {
    constexpr int kPart = kLanes / 4;
    for (int lane = 0; lane < kGroup; lane += kLanes) {
        F total[4] = {};
        for (int edge = 0; edge < 4; ++edge) {
            const std::uint32_t* low = corners.index[2 * edge] + lane;
            const std::uint32_t* high = corners.index[2 * edge + 1] + lane;
            const F weight = load(corners.edge[edge] + lane);
            total[0] += load_quads(table, low, high) * quads<0>(weight, weight);
            total[1] += load_quads(table, low + kPart, high + kPart) * quads<1>(weight, weight);
            total[2] += load_quads(table, low + 2 * kPart, high + 2 * kPart) * quads<2>(weight, weight);
            total[3] += load_quads(table, low + 3 * kPart, high + 3 * kPart) * quads<3>(weight, weight);
        }
        const F high = load(corners.high + lane), low = 1.0F - high;
        store(features + 2 * lane, add_pairs(total[0] * quads<0>(low, high), total[1] * quads<1>(low, high)));
        store(features + 2 * lane + kLanes, add_pairs(total[2] * quads<2>(low, high), total[3] * quads<3>(low, high)));
    }
}

// Reads a table in order, which brings it into a near cache many times faster than the random reads to come would.
ANM_INLINE void bring_near(const float* table, int entries) {
    F any{};
    for (int i = 0; i < 2 * entries; i += 16) any += load(table + i);
    keep(any);
}

// Features of slots [begin, end), both multiples of kGroup, on one level. Table entries are read by scalar loads:
// gather instructions are slower on processors with the mitigation for their leaks, and no faster on others.
ANM_INLINE void encode(const Level& level, const float* table, int entries, const Positions& at, std::ptrdiff_t begin,
                       std::ptrdiff_t end, float* features) {
    if (16 * (end - begin) >= entries) {
        bring_near(table, entries);
        Corners corners;
        for (std::ptrdiff_t slot = begin; slot < end; slot += kGroup) {
            find_corners(level, at, slot, corners);
            interpolate(corners, table, features + 2 * slot);
        }
        return;
    }
    // Much of the table will not be read. A group's lines are asked for while the group before it is summed.
    Corners corners[2];
    if (begin < end) find_corners(level, at, begin, corners[0]);
    int now = 0;
    for (std::ptrdiff_t slot = begin; slot < end; slot += kGroup, now ^= 1) {
        if (slot + kGroup < end) {
            find_corners(level, at, slot + kGroup, corners[now ^ 1]);
            prefetch(corners[now ^ 1], table);
        }
        interpolate(corners[now], table, features + 2 * slot);
    }
}

// Pairs of both corners of an edge for every slot of a group.
struct Quads {
    alignas(64) float data[4 * kGroup];
};

// What each edge has to take to its corners, by its own weight.
ANM_INLINE void split(const Corners& corners, const float* grad_features, Quads& edges) {
    for (int lane = 0; lane < kGroup; lane += kLanes) {
        float* out = edges.data + 4 * lane;
        const F high = load(corners.high + lane), low = 1.0F - high;
        const F first = load(grad_features + 2 * lane), second = load(grad_features + 2 * lane + kLanes);
        store(out, twice<0>(first) * quads<0>(low, high));
        store(out + kLanes, twice<1>(first) * quads<1>(low, high));
        store(out + 2 * kLanes, twice<0>(second) * quads<2>(low, high));
        store(out + 3 * kLanes, twice<1>(second) * quads<3>(low, high));
    }
}

ANM_INLINE void add_quad(const Corners& corners, const Quads& edges, int s, float* grad_table) {
    const F4 d = load4(edges.data + 4 * s);
    for (int edge = 0; edge < 4; ++edge) {
        // Neighbours along x never share an entry.
        float* low = entry(grad_table, corners.index[2 * edge][s]);
        float* high = entry(grad_table, corners.index[2 * edge + 1][s]);
        store_pairs(low, high, load_pairs(low, high) + d * corners.edge[edge][s]);
    }
}

ANM_INLINE bool is_zero(const float* pair) {
    std::uint64_t bits;
    std::memcpy(&bits, pair, sizeof bits);
    return bits == 0;
}

// Adds the gradient by the table's entries, always in the same order, so that the sum is always the same. Neighbours on
// a ray often add to the same entries, so that one would wait for the other; two groups far from each other take turns.
ANM_INLINE void scatter(const Level& level, const Positions& at, std::ptrdiff_t end, const float* grad_features,
                        float* grad_table) {
    Corners corners[2];
    Quads edges[2];
    const std::ptrdiff_t half = (end / kGroup + 1) / 2 * kGroup;
    for (std::ptrdiff_t slot = 0; slot < half; slot += kGroup) {
        const bool two = half + slot < end;
        const float* in[2] = {grad_features + 2 * slot, grad_features + 2 * (half + slot)};
        for (int k = 0; k < 1 + two; ++k) {
            find_corners(level, at, slot + k * half, corners[k]);
            split(corners[k], in[k], edges[k]);
        }
        for (int s = 0; s < kGroup; ++s) {
            // Samples behind a surface have none at all, and they stand in a row.
            if (!is_zero(in[0] + 2 * s)) add_quad(corners[0], edges[0], s, grad_table);
            if (two && !is_zero(in[1] + 2 * s)) add_quad(corners[1], edges[1], s, grad_table);
        }
    }
}

}  // namespace
