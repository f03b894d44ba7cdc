// Both decoders on a block of samples, forwards and backwards; weights are repacked once per call for straight reading.
#pragma once

#include "matrix.h"
#include "one_blob.h"

namespace {

using anm::kWidthAlign;
using anm::round_up;

// Views into one buffer of Settings::packed_size() floats. Rows are padded with zeros; H = hidden_pad, O = outputs_pad.
// The first six double as the layout of the gradients (Settings::gradient_size() floats).
struct PackedDecoders {
    float* sdf_blob;     // [3][bins + 2][H], see one_blob.h
    float* sdf_grid;     // [features][H], by level, then feature
    float* sdf_out;      // [O][H]
    float* color_blob;   // [3][bins + 2][H]
    float* color_geo;    // [O][H]; row 0, where s stands, is zero
    float* color_out;    // [4][H]
    float* sdf_grid_t;   // [H][features_pad]
    float* sdf_out_t;    // [H][O]
    float* color_geo_t;  // [H][O]
    float* color_out_t;  // [H][kWidthAlign]

    PackedDecoders(const Settings& s, float* base) {
        const int h = s.hidden_pad(), o = s.outputs_pad();
        sdf_blob = base;
        sdf_grid = sdf_blob + s.blob_rows() * h;
        sdf_out = sdf_grid + s.features() * h;
        color_blob = sdf_out + o * h;
        color_geo = color_blob + s.blob_rows() * h;
        color_out = color_geo + o * h;
        sdf_grid_t = color_out + 4 * h;
        sdf_out_t = sdf_grid_t + h * s.features_pad();
        color_geo_t = sdf_out_t + h * o;
        color_out_t = color_geo_t + h * o;
    }
};

// Calls fn(index in checkpoint order, packed element, transposed element or null) for every decoder weight.
template <class Fn>
inline void for_each_weight(const Settings& s, const PackedDecoders& p, Fn&& fn) {
    const int h = s.hidden_pad(), o = s.outputs_pad();
    const auto blob_row = [&](int b) { return ::blob_row(b / s.bins, b % s.bins + 1, s.bins); };
    int index = 0;
    for (int j = 0; j < s.hidden; ++j) {
        // The checkpoint has the first feature of all levels, then the second; here they stand in pairs.
        for (int i = 0; i < s.features(); ++i) {
            const int pair = i % s.levels * 2 + i / s.levels;
            fn(index++, p.sdf_grid + pair * h + j, p.sdf_grid_t + j * s.features_pad() + pair);
        }
        for (int b = 0; b < s.blob(); ++b) fn(index++, p.sdf_blob + blob_row(b) * h + j, nullptr);
    }
    for (int i = 0; i < s.outputs(); ++i) {
        for (int j = 0; j < s.hidden; ++j) fn(index++, p.sdf_out + i * h + j, p.sdf_out_t + j * o + i);
    }
    for (int j = 0; j < s.hidden; ++j) {
        for (int b = 0; b < s.blob(); ++b) fn(index++, p.color_blob + blob_row(b) * h + j, nullptr);
        for (int g = 1; g <= s.geometry; ++g) fn(index++, p.color_geo + g * h + j, p.color_geo_t + j * o + g);
    }
    for (int c = 0; c < 3; ++c) {
        for (int j = 0; j < s.hidden; ++j) fn(index++, p.color_out + c * h + j, p.color_out_t + j * kWidthAlign + c);
    }
}

inline void pack(const Settings& s, const float* weights, float* base) {
    std::memset(base, 0, sizeof(float) * static_cast<std::size_t>(s.packed_size()));
    const PackedDecoders p(s, base);
    for_each_weight(s, p, [&](int index, float* packed, float* transposed) {
        *packed = weights[index];
        if (transposed != nullptr) *transposed = weights[index];
    });
    copy_ends(p.sdf_blob, s.bins, s.hidden_pad());
    copy_ends(p.color_blob, s.bins, s.hidden_pad());
}

// Activations of one block, row-major; room for `capacity` slots, a multiple of kGroup.
struct Activations {
    int capacity;
    float* hidden;        // [slots][H]
    float* outputs;       // [slots][O]
    float* color_hidden;  // [slots][H]
    float* rgb;           // [3][capacity]
    float* s;             // [slots]
    Blobs blobs;
    float* grad_rgb;  // [slots][4], by the colour before the sigmoid
    float* grad_sdf;    // [slots]
    float* row;    // [slots][max(kWidthAlign, features_pad)], scratch

    static std::size_t size(const Settings& c, int capacity) {
        const int row = c.features_pad() > kWidthAlign ? c.features_pad() : kWidthAlign;
        const std::size_t wide = 2 * c.hidden_pad() + c.outputs_pad() + row;
        return (wide + 3 + 1 + 12 + 4 + 1) * static_cast<std::size_t>(capacity);
    }

    Activations(const Settings& c, int capacity_, float* base) : capacity(capacity_) {
        const auto take = [&](std::size_t width) {
            float* part = base;
            base += width * static_cast<std::size_t>(capacity);
            return part;
        };
        hidden = take(c.hidden_pad());
        outputs = take(c.outputs_pad());
        color_hidden = take(c.hidden_pad());
        row = take(c.features_pad() > kWidthAlign ? c.features_pad() : kWidthAlign);
        rgb = take(3);
        s = take(1);
        for (int axis = 0; axis < 3; ++axis) {
            blobs.bin[axis] = reinterpret_cast<std::int32_t*>(take(1));
            for (int j = 0; j < 3; ++j) blobs.mass[axis][j] = take(1);
        }
        grad_rgb = take(4);
        grad_sdf = take(1);
    }
};

// The widths of a decoder; fixed at compile time for the common shape, so that addresses fold into the instructions.
template <int kHidden, int kOutputs>
struct Widths {
    int hidden_, outputs_;
    explicit Widths(const Settings& s) : hidden_(s.hidden_pad()), outputs_(s.outputs_pad()) {}
    static bool fits(const Settings& s) { return s.hidden_pad() == kHidden && s.outputs_pad() == kOutputs; }
    ANM_INLINE int hidden() const { return kHidden ? kHidden : hidden_; }
    ANM_INLINE int outputs() const { return kOutputs ? kOutputs : outputs_; }
};

template <class Shape>
ANM_INLINE void forward_hidden(const Settings& c, const Shape& shape, const PackedDecoders& w, const Pairs& grid,
                               int slots, const Activations& a) {
    const int h = shape.hidden();
    blob_rows(a.blobs, c.bins, slots, w.sdf_blob, h, a.hidden);
    multiply<Start::kAdd, End::kRelu>(grid, slots, c.features(), w.sdf_grid, h, h, a.hidden, h);
}

// s alone.
template <class Shape>
ANM_INLINE void forward_sdf(const Settings& c, const Shape& shape, const PackedDecoders& w, const Pairs& grid,
                            int slots, const Activations& a) {
    const int h = shape.hidden();
    forward_hidden(c, shape, w, grid, slots, a);
    for (int s = 0; s < slots; ++s) {
        F total{};
        for (int n = 0; n < h; n += kLanes) total += load(a.hidden + s * h + n) * load(w.sdf_out + n);
        a.s[s] = sum(total);
    }
}

// s and colours in [0, 1].
template <class Shape>
ANM_INLINE void forward(const Settings& c, const Shape& shape, const PackedDecoders& w, const Pairs& grid, int slots,
                        const Activations& a) {
    const int h = shape.hidden(), o = shape.outputs();
    forward_hidden(c, shape, w, grid, slots, a);
    multiply<Start::kZero, End::kPlain>(Rows{a.hidden, h}, slots, h, w.sdf_out_t, o, o, a.outputs, o);
    blob_rows(a.blobs, c.bins, slots, w.color_blob, h, a.color_hidden);
    multiply<Start::kAdd, End::kRelu>(Rows{a.outputs, o}, slots, o, w.color_geo, h, h, a.color_hidden, h);
    constexpr int kOut = kLanes < kWidthAlign ? kLanes : kWidthAlign;
    multiply<Start::kZero, End::kPlain>(Rows{a.color_hidden, h}, slots, h, w.color_out_t, kWidthAlign, kOut, a.row,
                                        kWidthAlign);
    for (int s = 0; s < slots; ++s) {
        a.s[s] = a.outputs[s * o];
        for (int channel = 0; channel < 3; ++channel)
            a.rgb[channel * a.capacity + s] = a.row[s * kWidthAlign + channel];
    }
    for (int i = 0; i < 3 * a.capacity; i += kLanes) store(a.rgb + i, sigmoid(load(a.rgb + i)));
}

// Gradients by the weights are added to g; those by the grid features take the features' place. Activations are spent.
template <class Shape>
ANM_INLINE void backward(const Settings& c, const Shape& shape, const PackedDecoders& w, const PackedDecoders& g,
                         float* features, std::ptrdiff_t level_stride, int slots, const Activations& a) {
    const int h = shape.hidden(), o = shape.outputs(), f = c.features_pad();
    outer(Rows{a.grad_rgb, 4}, 4, slots, a.color_hidden, h, h, g.color_out, h);
    multiply<Start::kZero, End::kMask>(Rows{a.grad_rgb, 4}, slots, 4, w.color_out, h, h, a.color_hidden, h);
    outer(Rows{a.outputs, o}, o, slots, a.color_hidden, h, h, g.color_geo, h);
    blob_gradient(a.blobs, c.bins, slots, a.color_hidden, h, g.color_blob);
    multiply<Start::kZero, End::kPlain>(Rows{a.color_hidden, h}, slots, h, w.color_geo_t, o, o, a.outputs, o);
    for (int s = 0; s < slots; ++s) a.outputs[s * o] = a.grad_sdf[s];
    outer(Rows{a.outputs, o}, o, slots, a.hidden, h, h, g.sdf_out, h);
    multiply<Start::kZero, End::kMask>(Rows{a.outputs, o}, slots, o, w.sdf_out, h, h, a.hidden, h);
    outer(Pairs{features, level_stride}, c.features(), slots, a.hidden, h, h, g.sdf_grid, h);
    blob_gradient(a.blobs, c.bins, slots, a.hidden, h, g.sdf_blob);
    multiply<Start::kZero, End::kPlain>(Rows{a.hidden, h}, slots, h, w.sdf_grid_t, f, f, a.row, f);
    for (int s = 0; s < slots; ++s) {
        for (int level = 0; level < c.levels; ++level) {
            store2(features + level * level_stride + 2 * s, load2(a.row + s * f + 2 * level));
        }
    }
}

}  // namespace
