// Adam (Kingma and Ba, 2015) as torch computes it, on the table level by level and on the decoders.
#pragma once

#include "kernel.h"
#include "simd.h"

namespace {

using anm::Settings;

struct AdamScale {
    float beta1_rest, beta2, beta2_rest, inverse_root, epsilon, step;

    AdamScale(const Settings& c, double rate, std::int64_t iteration)
        : beta1_rest(static_cast<float>(1.0 - c.beta1)),
          beta2(static_cast<float>(c.beta2)),
          beta2_rest(static_cast<float>(1.0 - c.beta2)),
          inverse_root(static_cast<float>(1.0 / __builtin_sqrt(1.0 - power(c.beta2, iteration)))),
          epsilon(static_cast<float>(c.epsilon)),
          step(static_cast<float>(rate / (1.0 - power(c.beta1, iteration)))) {}

    static double power(double base, std::int64_t exponent) {
        double result = 1.0;
        for (; exponent > 0; exponent >>= 1, base *= base) {
            if (exponent & 1) result *= base;
        }
        return result;
    }

    ANM_INLINE void update(float* p, float* m, float* v, F g) const {
        const F first = load(m) + beta1_rest * (g - load(m));
        const F second = beta2 * load(v) + beta2_rest * g * g;
        store(m, first);
        store(v, second);
        store(p, load(p) - step * first / (square_root(second) * inverse_root + epsilon));
    }
};

constexpr int kLine = 16;                  // floats of one cache line: 8 entries
constexpr int kLinesTogether = 8;          // whose marks are looked at in one go
constexpr int kAhead = 1024;               // a page, where the processor's own foresight ends

ANM_INLINE std::uint64_t marks(const std::uint8_t* touched) {
    std::uint64_t all;
    std::memcpy(&all, touched, sizeof all);
    return all;
}

// Whether any of `count` gradients, a multiple of a line, is not zero.
ANM_INLINE bool any_gradient(const float* g, int count) {
    I any{};
    for (int i = 0; i < count; i += kLanes) any |= load(g + i) != 0.0F;
    std::int32_t bits = 0;
    for (int lane = 0; lane < kLanes; ++lane) bits |= any[lane];
    return bits != 0;
}

// One level. Clears the gradient. Lines that never had a gradient have zero moments and would not move: they are passed
// over, which on coarse levels is most of the table, and their moments are not even asked for.
ANM_INLINE void adam_level(const AdamScale& scale, int entries, float* p, float* m, float* v, std::uint8_t* touched,
                           float* g) {
    constexpr int kTogether = kLine * kLinesTogether;
    for (int i = 0; i < 2 * entries; i += kTogether) {
        const int ahead = i + kAhead;
        if (ahead + kTogether <= 2 * entries && marks(touched + ahead / kLine) != 0) {
            for (int line = ahead; line < ahead + kTogether; line += kLine) {
                __builtin_prefetch(p + line, 1);
                __builtin_prefetch(m + line, 1);
                __builtin_prefetch(v + line, 1);
            }
        }
        const bool whole = i + kTogether <= 2 * entries;
        if (whole && marks(touched + i / kLine) == 0 && !any_gradient(g + i, kTogether)) continue;
        const int end = whole ? i + kTogether : 2 * entries;
        for (int line = i; line < end; line += kLine) {
            if (!touched[line / kLine]) {
                if (!any_gradient(g + line, kLine)) continue;
                touched[line / kLine] = 1;
            }
            for (int lane = line; lane < line + kLine; lane += kLanes) {
                scale.update(p + lane, m + lane, v + lane, load(g + lane));
                store(g + lane, F{});
            }
        }
    }
}

}  // namespace
