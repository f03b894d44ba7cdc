// One-blob code of world points (formulas of anm_mj/mapping/encoding.py, rounding included), and its products with
// weights, of which only the nine bins that are not zero take part.
#pragma once

#include "encoding.h"

namespace {

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
            // Far from the origin floats are too coarse for the division, and a place that is none has no bin: the row
            // must exist all the same.
            const I wanted = to_int(centre - turns * bins), last = I{} + settings.bins - 1;
            const I wrapped = wanted < 0 ? wanted + settings.bins : wanted;
            const I not_below = wrapped < 0 ? I{} : wrapped;
            const I bin = not_below > last ? last : not_below;
            std::memcpy(out.bin[axis] + s, &bin, sizeof bin);
            store(out.mass[axis][0] + s, below);
            store(out.mass[axis][1] + s, 1.0F - below - above);
            store(out.mass[axis][2] + s, above);
        }
    }
}

// Weights stand in a row of `width` floats per bin. Each axis has a row more at both ends, the copy of the bin at the
// other end, so that the three bins of a slot always lie together: from row `bin` of the axis.
ANM_INLINE int blob_row(int axis, int bin, int bins) { return axis * (bins + 2) + bin; }

inline void copy_ends(float* w, int bins, int width) {
    for (int axis = 0; axis < 3; ++axis) {
        const auto row = [&](int i) { return w + blob_row(axis, i, bins) * width; };
        std::memcpy(row(0), row(bins), sizeof(float) * static_cast<std::size_t>(width));
        std::memcpy(row(bins + 1), row(1), sizeof(float) * static_cast<std::size_t>(width));
    }
}

// What was added to the copies belongs to the bins themselves.
inline void fold_ends(float* g, int bins, int width) {
    for (int axis = 0; axis < 3; ++axis) {
        const auto row = [&](int i) { return g + blob_row(axis, i, bins) * width; };
        for (int n = 0; n < width; ++n) {
            row(bins)[n] += row(0)[n];
            row(1)[n] += row(bins + 1)[n];
        }
    }
}

template <int kVectors>
ANM_INLINE void blob_columns(const Blobs& blobs, int bins, int samples, const float* w, int width, float* out) {
    for (int s = 0; s < samples; ++s) {
        F total[kVectors] = {};
        for (int axis = 0; axis < 3; ++axis) {
            const float* rows = w + blob_row(axis, blobs.bin[axis][s], bins) * width;
            for (int j = 0; j < 3; ++j) {
                const float mass = blobs.mass[axis][j][s];
                for (int v = 0; v < kVectors; ++v) total[v] += load(rows + j * width + v * kLanes) * mass;
            }
        }
        for (int v = 0; v < kVectors; ++v) {
            store(out + static_cast<std::ptrdiff_t>(s) * width + v * kLanes, total[v]);
        }
    }
}

// out[s] = sum over the nine bins of mass * w[bin].
ANM_INLINE void blob_rows(const Blobs& blobs, int bins, int samples, const float* w, int width, float* out) {
    int n = 0;
    for (; n + 2 * kLanes <= width; n += 2 * kLanes) blob_columns<2>(blobs, bins, samples, w + n, width, out + n);
    for (; n < width; n += kLanes) blob_columns<1>(blobs, bins, samples, w + n, width, out + n);
}

// g[bin] += mass * d[s] on some columns of one axis. Neighbouring samples mostly share their bins, so sums are kept in
// registers until they change.
template <int kVectors>
ANM_INLINE void blob_gradient_columns(const std::int32_t* bin, float* const (&mass)[3], int samples, const float* d,
                                      int width, float* g) {
    F acc[3][kVectors] = {};
    int current = bin[0];
    const auto flush = [&] {
        for (int j = 0; j < 3; ++j) {
            for (int v = 0; v < kVectors; ++v) {
                float* target = g + (current + j) * width + v * kLanes;
                store(target, load(target) + acc[j][v]);
                acc[j][v] = F{};
            }
        }
    };
    for (int s = 0; s < samples; ++s) {
        if (bin[s] != current) {
            flush();
            current = bin[s];
        }
        for (int v = 0; v < kVectors; ++v) {
            const F value = load(d + static_cast<std::ptrdiff_t>(s) * width + v * kLanes);
            for (int j = 0; j < 3; ++j) acc[j][v] += value * mass[j][s];
        }
    }
    flush();
}

ANM_INLINE void blob_gradient(const Blobs& blobs, int bins, int samples, const float* d, int width, float* g) {
    for (int axis = 0; axis < 3; ++axis) {
        float* rows = g + blob_row(axis, 0, bins) * width;
        int n = 0;
        for (; n + 2 * kLanes <= width; n += 2 * kLanes) {
            blob_gradient_columns<2>(blobs.bin[axis], blobs.mass[axis], samples, d + n, width, rows + n);
        }
        for (; n < width; n += kLanes) {
            blob_gradient_columns<1>(blobs.bin[axis], blobs.mass[axis], samples, d + n, width, rows + n);
        }
    }
}

}  // namespace
