// SDF, colours and their derivatives by position: the decoders forwards on a value and its three tangents. A point's
// table entries are read once for all four.
#pragma once

#include "query.h"

namespace {

constexpr int kParts = 4;  // the value, then the derivatives by world x, y and z

// Features of a group and their derivatives, [part] apart by `part_stride`.
ANM_INLINE void interpolate_tangents(const Corners& corners, float cells_per_m, const float* table, float* features,
                                     std::ptrdiff_t part_stride) {
    constexpr int kVectorSlots = kLanes / 2;  // pairs in a vector
    for (int lane = 0; lane < kGroup; lane += kLanes) {
        F edge[4];
        for (int e = 0; e < 4; ++e) edge[e] = load(corners.edge[e] + lane);
        // Weights along y and along z alone; the two along an axis add up to one.
        const F along_y[2] = {edge[0] + edge[2], edge[1] + edge[3]}, along_z[2] = {edge[0] + edge[1], edge[2] + edge[3]};
        const F high = load(corners.high + lane), low = 1.0F - high;
        F total[3][4] = {};
        for (int e = 0; e < 4; ++e) {
            const std::uint32_t* first = corners.index[2 * e] + lane;
            const std::uint32_t* second = corners.index[2 * e + 1] + lane;
            constexpr int kPart = kLanes / 4;
            const F quad[4] = {load_quads(table, first, second), load_quads(table, first + kPart, second + kPart),
                               load_quads(table, first + 2 * kPart, second + 2 * kPart),
                               load_quads(table, first + 3 * kPart, second + 3 * kPart)};
            const F by_y = (e & 1) != 0 ? along_z[e >> 1] : -along_z[e >> 1];
            const F by_z = (e >> 1) != 0 ? along_y[e & 1] : -along_y[e & 1];
            const F weight[3] = {edge[e], by_y, by_z};
            for (int k = 0; k < 3; ++k) {
                total[k][0] += quad[0] * quads<0>(weight[k], weight[k]);
                total[k][1] += quad[1] * quads<1>(weight[k], weight[k]);
                total[k][2] += quad[2] * quads<2>(weight[k], weight[k]);
                total[k][3] += quad[3] * quads<3>(weight[k], weight[k]);
            }
        }
        const auto put = [&](int part, const F (&sum)[4], F below, F above, float scale) {
            float* out = features + part * part_stride + 2 * lane;
            const F near = add_pairs(sum[0] * quads<0>(below, above), sum[1] * quads<1>(below, above));
            const F far = add_pairs(sum[2] * quads<2>(below, above), sum[3] * quads<3>(below, above));
            store(out, near * scale);
            store(out + 2 * kVectorSlots, far * scale);
        };
        const F one = F{} + 1.0F;
        put(0, total[0], low, high, 1.0F);
        put(1, total[0], -one, one, cells_per_m);
        put(2, total[1], low, high, cells_per_m);
        put(3, total[2], low, high, cells_per_m);
    }
}

// Derivative of quartic_tail().
ANM_INLINE F quartic_slope(F distance) {
    const F square = distance * distance;
    return -0.9375F * (1.0F + square * (-2.0F + square));
}

// Points of a block, their features with derivatives, and what the decoders make of them. Rows of activations are those
// of the value, then of the three tangents, `kBlock` each.
template <int kBlock>
struct TangentScratch {
    static constexpr int kRows = kParts * kBlock;
    Positions at;
    std::ptrdiff_t level_stride;
    float* features;
    Activations activations;
    float* blob_slope;

    static std::ptrdiff_t stride() { return feature_stride(kRows); }

    static std::size_t size(const Settings& c) {
        return 3 * kBlock + static_cast<std::size_t>(c.levels * stride()) + Activations::size(c, kRows) + 9 * kBlock;
    }

    TangentScratch(const Settings& c, float* base)
        : level_stride(stride()),
          features(base + 3 * kBlock),
          activations(c, kRows, features + c.levels * level_stride),
          blob_slope(features + c.levels * level_stride + Activations::size(c, kRows)) {
        for (int axis = 0; axis < 3; ++axis) at.axis[axis] = base + axis * kBlock;
    }

    // Features of the points.
    void encode(const Model& model) const {
        const Settings& c = model.settings;
        for (int level = 0; level < c.levels; ++level) {
            float* out = features + level * level_stride;
            const float* table = model.table + 2 * static_cast<std::ptrdiff_t>(level) * c.entries();
            Corners corners[kBlock / kGroup];
            for (int g = 0; g < kBlock / kGroup; ++g) {
                find_corners(model.level[level], at, g * kGroup, corners[g]);
                prefetch(corners[g], table);
            }
            for (int g = 0; g < kBlock / kGroup; ++g) {
                interpolate_tangents(corners[g], model.level[level].cells_per_m, table, out + 2 * g * kGroup, 2 * kBlock);
            }
        }
        one_blob(c, at, 0, kBlock, activations.blobs);
        for (int axis = 0; axis < 3; ++axis) {
            for (int s = 0; s < kBlock; s += kLanes) {
                const F position = rounded(load(at.axis[axis] + s) * c.bins_per_m[axis]);
                const F right = position - floor(position);
                const F below = quartic_slope(right) * c.bins_per_m[axis];
                const F above = -quartic_slope(1.0F - right) * c.bins_per_m[axis];
                store(blob_slope + (3 * axis + 0) * kBlock + s, below);
                store(blob_slope + (3 * axis + 1) * kBlock + s, -below - above);
                store(blob_slope + (3 * axis + 2) * kBlock + s, above);
            }
        }
    }

    // Products of the one-blob code, and of its derivatives, with weights.
    ANM_INLINE void blob_products(const Settings& c, const float* w, int width, float* out) const {
        const Blobs& blobs = activations.blobs;
        blob_rows(blobs, c.bins, kBlock, w, width, out);
        for (int axis = 0; axis < 3; ++axis) {
            float* rows_out = out + static_cast<std::ptrdiff_t>((1 + axis) * kBlock) * width;
            for (int s = 0; s < kBlock; ++s) {
                const float* rows = w + blob_row(axis, blobs.bin[axis][s], c.bins) * width;
                for (int n = 0; n < width; n += kLanes) {
                    F total{};
                    for (int j = 0; j < 3; ++j) total += load(rows + j * width + n) * blob_slope[(3 * axis + j) * kBlock + s];
                    store(rows_out + s * width + n, total);
                }
            }
        }
    }

    // The rectifier on the values, and its derivative on the tangents.
    ANM_INLINE static void rectify(float* rows, int width) {
        for (int s = 0; s < kBlock; ++s) {
            for (int n = 0; n < width; n += kLanes) {
                float* at_value = rows + s * width + n;
                const F value = load(at_value);
                store(at_value, value > 0.0F ? value : F{});
                for (int part = 1; part < kParts; ++part) {
                    float* at_part = at_value + static_cast<std::ptrdiff_t>(part * kBlock) * width;
                    store(at_part, value > 0.0F ? load(at_part) : F{});
                }
            }
        }
    }

    // s and its derivatives in activations.s, [part][kBlock]; colours and theirs in activations.rgb, [channel][part][kBlock].
    template <class Shape>
    ANM_INLINE void decode(const Settings& c, const Shape& shape, const PackedDecoders& w, bool with_color) const {
        const Activations& a = activations;
        const int h = shape.hidden(), o = shape.outputs();
        const Pairs grid{features, level_stride};
        blob_products(c, w.sdf_blob, h, a.hidden);
        multiply<Start::kAdd, End::kPlain>(grid, kRows, c.features(), w.sdf_grid, h, h, a.hidden, h);
        rectify(a.hidden, h);
        if (!with_color) {
            for (int s = 0; s < kRows; ++s) {
                F total{};
                for (int n = 0; n < h; n += kLanes) total += load(a.hidden + s * h + n) * load(w.sdf_out + n);
                a.s[s] = sum(total);
            }
            return;
        }
        multiply<Start::kZero, End::kPlain>(Rows{a.hidden, h}, kRows, h, w.sdf_out_t, o, o, a.outputs, o);
        blob_products(c, w.color_blob, h, a.color_hidden);
        multiply<Start::kAdd, End::kPlain>(Rows{a.outputs, o}, kRows, o, w.color_geo, h, h, a.color_hidden, h);
        rectify(a.color_hidden, h);
        constexpr int kOut = kLanes < kWidthAlign ? kLanes : kWidthAlign;
        multiply<Start::kZero, End::kPlain>(Rows{a.color_hidden, h}, kRows, h, w.color_out_t, kWidthAlign, kOut, a.row,
                                            kWidthAlign);
        for (int s = 0; s < kRows; ++s) {
            a.s[s] = a.outputs[s * o];
            for (int channel = 0; channel < 3; ++channel) a.rgb[channel * kRows + s] = a.row[s * kWidthAlign + channel];
        }
        for (int channel = 0; channel < 3; ++channel) {
            float* value = a.rgb + channel * kRows;
            for (int s = 0; s < kBlock; s += kLanes) {
                const F color = sigmoid(load(value + s));
                store(value + s, color);
                for (int part = 1; part < kParts; ++part) {
                    float* slope = value + part * kBlock + s;
                    store(slope, load(slope) * color * (1.0F - color));
                }
            }
        }
    }
};

}  // namespace
