// Hash grid and one-blob code of world points: the formulas of anm_mj/mapping/encoding.py, rounding included.
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
ANM_INLINE void split(const Corners& corners, const float* d_features, Quads& edges) {
    for (int lane = 0; lane < kGroup; lane += kLanes) {
        float* out = edges.data + 4 * lane;
        const F high = load(corners.high + lane), low = 1.0F - high;
        const F first = load(d_features + 2 * lane), second = load(d_features + 2 * lane + kLanes);
        store(out, twice<0>(first) * quads<0>(low, high));
        store(out + kLanes, twice<1>(first) * quads<1>(low, high));
        store(out + 2 * kLanes, twice<0>(second) * quads<2>(low, high));
        store(out + 3 * kLanes, twice<1>(second) * quads<3>(low, high));
    }
}

ANM_INLINE void add_quad(const Corners& corners, const Quads& edges, int s, float* d_table) {
    const F4 d = load4(edges.data + 4 * s);
    for (int edge = 0; edge < 4; ++edge) {
        // Neighbours along x never share an entry.
        float* low = entry(d_table, corners.index[2 * edge][s]);
        float* high = entry(d_table, corners.index[2 * edge + 1][s]);
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
ANM_INLINE void scatter(const Level& level, const Positions& at, std::ptrdiff_t end, const float* d_features,
                        float* d_table) {
    Corners corners[2];
    Quads edges[2];
    const std::ptrdiff_t half = (end / kGroup + 1) / 2 * kGroup;
    for (std::ptrdiff_t slot = 0; slot < half; slot += kGroup) {
        const bool two = half + slot < end;
        const float* in[2] = {d_features + 2 * slot, d_features + 2 * (half + slot)};
        for (int k = 0; k < 1 + two; ++k) {
            find_corners(level, at, slot + k * half, corners[k]);
            split(corners[k], in[k], edges[k]);
        }
        for (int s = 0; s < kGroup; ++s) {
            // Samples behind a surface have none at all, and they stand in a row.
            if (!is_zero(in[0] + 2 * s)) add_quad(corners[0], edges[0], s, d_table);
            if (two && !is_zero(in[1] + 2 * s)) add_quad(corners[1], edges[1], s, d_table);
        }
    }
}

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

// Sum of squared differences of neighbouring features over the lattice; adds `scale` times its gradient to d_table.
// features: room for points^3 pairs. axes: room for 12 * points values.
ANM_INLINE double smoothness(const Level& level, const float* table, const float* corner_m, float spacing, int points,
                             float scale, float* features, float* axes, float* d_table) {
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
            float* entry = d_table + 2 * (key_xy[c & 3] ^ lattice[2].key[c >> 2][k]);
            store2(entry, load2(entry) + d * (weight_xy[c & 3] * lattice[2].weight[c >> 2][k]));
        }
    });
    return total;
}

// One-blob codes of slots: per axis the bin that a slot lies in, and the mass in the bins below, at and above it.
struct Blobs {
    std::int32_t* bin[3];
    float* mass[3][3];
};

ANM_INLINE F quartic_tail(F distance) {
    const F square = distance * distance;
    return 0.5F - 0.9375F * distance * (1.0F + square * (-2.0F / 3.0F + square * 0.2F));
}

ANM_INLINE void one_blob(const Settings& settings, const Positions& at, std::ptrdiff_t first, int slots,
                         const Blobs& out) {
    const float bins = static_cast<float>(settings.bins);
    for (int axis = 0; axis < 3; ++axis) {
        for (int s = 0; s < slots; s += kLanes) {
            const F position = rounded(load(at.axis[axis] + first + s) * settings.bins_per_m[axis]);
            const F centre = floor(position);
            const F right = position - centre;
            const F below = quartic_tail(right);
            const F above = quartic_tail(1.0F - right);
            const F turns = floor((centre + 0.5F) / bins);
            const I bin = to_int(centre - turns * bins);
            std::memcpy(out.bin[axis] + s, &bin, sizeof bin);
            store(out.mass[axis][0] + s, below);
            store(out.mass[axis][1] + s, 1.0F - below - above);
            store(out.mass[axis][2] + s, above);
        }
    }
}

ANM_INLINE void neighbours(int bin, int bins, int (&row)[3]) {
    row[0] = bin == 0 ? bins - 1 : bin - 1;
    row[1] = bin;
    row[2] = bin == bins - 1 ? 0 : bin + 1;
}

// out[s] = sum over the nine bins of mass * w[bin]; w has 3 * bins rows of `width` floats.
ANM_INLINE void blob_rows(const Blobs& blobs, int bins, int samples, const float* w, int width, float* out) {
    for (int s = 0; s < samples; ++s) {
        const float* source[9];
        float mass[9];
        for (int axis = 0; axis < 3; ++axis) {
            int row[3];
            neighbours(blobs.bin[axis][s], bins, row);
            for (int j = 0; j < 3; ++j) {
                source[3 * axis + j] = w + (axis * bins + row[j]) * width;
                mass[3 * axis + j] = blobs.mass[axis][j][s];
            }
        }
        for (int n = 0; n < width; n += kLanes) {
            F total = load(source[0] + n) * mass[0];
            for (int j = 1; j < 9; ++j) total += load(source[j] + n) * mass[j];
            store(out + static_cast<std::ptrdiff_t>(s) * width + n, total);
        }
    }
}

// g[bin] += mass * d[s]. Neighbouring samples mostly share their bins, so sums are kept in registers until they change.
ANM_INLINE void blob_gradient(const Blobs& blobs, int bins, int samples, const float* d, int width, float* g) {
    for (int axis = 0; axis < 3; ++axis) {
        for (int n = 0; n < width; n += kLanes) {
            F acc[3] = {};
            int current = blobs.bin[axis][0];
            const auto flush = [&] {
                int row[3];
                neighbours(current, bins, row);
                for (int j = 0; j < 3; ++j) {
                    float* target = g + (axis * bins + row[j]) * width + n;
                    store(target, load(target) + acc[j]);
                    acc[j] = F{};
                }
            };
            for (int s = 0; s < samples; ++s) {
                if (blobs.bin[axis][s] != current) {
                    flush();
                    current = blobs.bin[axis][s];
                }
                const F value = load(d + static_cast<std::ptrdiff_t>(s) * width + n);
                for (int j = 0; j < 3; ++j) acc[j] += value * blobs.mass[axis][j][s];
            }
            flush();
        }
    }
}

}  // namespace
