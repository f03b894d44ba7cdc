// Two small matrix products, tiled so that their sums stay in registers; everything the decoders do is one of them.
#pragma once

#include "kernel.h"
#include "simd.h"

namespace {

#if defined(__AVX512F__)
constexpr int kTile = 8;  // rows of a tile: times two vectors, what the registers hold beside the operands
#else
constexpr int kTile = 4;
#endif

// Left operands: how sample s, input k is found. Tiles start at a multiple of kTile samples and an even input.
struct Rows {
    const float* data;
    int stride;
    ANM_INLINE float operator()(int s, int k) const { return data[static_cast<std::ptrdiff_t>(s) * stride + k]; }
};

// Grid features: level by level, and in a level a pair for every slot.
struct Pairs {
    const float* data;  // of sample 0
    std::ptrdiff_t level_stride;
    ANM_INLINE float operator()(int s, int k) const { return data[(k >> 1) * level_stride + 2 * s + (k & 1)]; }
};

// A tile's view with the sample's part of the address worked out once.
struct RowsTile {
    const float* data;
    int stride;
    ANM_INLINE float operator()(int r, int k) const { return data[r * stride + k]; }
};
struct PairsTile {
    const float* data;
    std::ptrdiff_t level_stride;
    ANM_INLINE float operator()(int r, int k) const { return data[(k >> 1) * level_stride + 2 * r + (k & 1)]; }
};
ANM_INLINE RowsTile tile_at(const Rows& a, int s) {
    return {a.data + static_cast<std::ptrdiff_t>(s) * a.stride, a.stride};
}
ANM_INLINE PairsTile tile_at(const Pairs& a, int s) { return {a.data + 2 * s, a.level_stride}; }

enum class Start { kZero, kAdd };
enum class End { kPlain, kRelu, kMask };  // kMask: zero where the overwritten value was not positive

template <int kVectors, Start kStart, End kEnd, class Tile>
ANM_INLINE void multiply_tile(const Tile& a, int depth, const float* w, int w_stride, float* out, int out_stride) {
    F acc[kTile][kVectors];
    for (int r = 0; r < kTile; ++r) {
        for (int v = 0; v < kVectors; ++v) {
            acc[r][v] = kStart == Start::kAdd ? load(out + r * out_stride + v * kLanes) : F{};
        }
    }
    for (int k = 0; k < depth; ++k) {
        F row[kVectors];
        for (int v = 0; v < kVectors; ++v) row[v] = load(w + k * w_stride + v * kLanes);
        for (int r = 0; r < kTile; ++r) {
            const float x = a(r, k);
            for (int v = 0; v < kVectors; ++v) acc[r][v] += x * row[v];
        }
    }
    for (int r = 0; r < kTile; ++r) {
        for (int v = 0; v < kVectors; ++v) {
            float* target = out + r * out_stride + v * kLanes;
            F value = acc[r][v];
            if (kEnd == End::kRelu) value = value > 0.0F ? value : F{};
            if (kEnd == End::kMask) value = load(target) > 0.0F ? value : F{};
            store(target, value);
        }
    }
}

// out[s][n] (+)= sum over k of a(s, k) w[k][n]; samples is a multiple of kTile, width one of kLanes.
template <Start kStart, End kEnd, class A>
ANM_INLINE void multiply(const A& a, int samples, int depth, const float* w, int w_stride, int width, float* out,
                         int out_stride) {
    for (int s = 0; s < samples; s += kTile) {
        const auto tile = tile_at(a, s);
        float* row = out + static_cast<std::ptrdiff_t>(s) * out_stride;
        int n = 0;
        for (; n + 2 * kLanes <= width; n += 2 * kLanes) {
            multiply_tile<2, kStart, kEnd>(tile, depth, w + n, w_stride, row + n, out_stride);
        }
        for (; n < width; n += kLanes) {
            multiply_tile<1, kStart, kEnd>(tile, depth, w + n, w_stride, row + n, out_stride);
        }
    }
}

template <int kRows, int kVectors, class A>
ANM_INLINE void outer_tile(const A& a, int k, int samples, const float* d, int d_stride, float* g, int g_stride) {
    F acc[kRows][kVectors];
    for (int r = 0; r < kRows; ++r) {
        for (int v = 0; v < kVectors; ++v) acc[r][v] = load(g + r * g_stride + v * kLanes);
    }
    for (int s = 0; s < samples; ++s) {
        F row[kVectors];
        for (int v = 0; v < kVectors; ++v) row[v] = load(d + static_cast<std::ptrdiff_t>(s) * d_stride + v * kLanes);
        for (int r = 0; r < kRows; ++r) {
            const float x = a(s, k + r);
            for (int v = 0; v < kVectors; ++v) acc[r][v] += x * row[v];
        }
    }
    for (int r = 0; r < kRows; ++r) {
        for (int v = 0; v < kVectors; ++v) store(g + r * g_stride + v * kLanes, acc[r][v]);
    }
}

template <int kVectors, class A>
ANM_INLINE void outer_columns(const A& a, int depth, int samples, const float* d, int d_stride, float* g,
                              int g_stride) {
    int k = 0;
    for (; k + kTile <= depth; k += kTile) {
        outer_tile<kTile, kVectors>(a, k, samples, d, d_stride, g + k * g_stride, g_stride);
    }
    for (; k + 2 <= depth; k += 2) outer_tile<2, kVectors>(a, k, samples, d, d_stride, g + k * g_stride, g_stride);
}

// g[k][n] += sum over s of a(s, k) d[s][n]; depth is even, width a multiple of kLanes.
template <class A>
ANM_INLINE void outer(const A& a, int depth, int samples, const float* d, int d_stride, int width, float* g,
                      int g_stride) {
    int n = 0;
    for (; n + 2 * kLanes <= width; n += 2 * kLanes) {
        outer_columns<2>(a, depth, samples, d + n, d_stride, g + n, g_stride);
    }
    for (; n < width; n += kLanes) outer_columns<1>(a, depth, samples, d + n, d_stride, g + n, g_stride);
}

}  // namespace
