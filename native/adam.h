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

// One level. Clears the gradient. Lines that never had a gradient have zero moments and would not move: they are passed
// over, which on coarse levels is most of the table.
ANM_INLINE void adam_level(const AdamScale& scale, int entries, float* p, float* m, float* v, std::uint8_t* touched,
                           float* g) {
    constexpr int kLine = 16;
    constexpr int kAhead = 1024;  // a page, where the processor's own foresight ends
    for (int i = 0; i < 2 * entries; i += kLine) {
        __builtin_prefetch(p + i + kAhead, 1);
        __builtin_prefetch(m + i + kAhead, 1);
        __builtin_prefetch(v + i + kAhead, 1);
        if (!touched[i / kLine]) {
            I any{};
            for (int lane = 0; lane < kLine; lane += kLanes) any |= load(g + i + lane) != 0.0F;
            bool moved = false;
            for (int lane = 0; lane < kLanes; ++lane) moved |= any[lane] != 0;
            if (!moved) continue;
            touched[i / kLine] = 1;
        }
        for (int lane = i; lane < i + kLine; lane += kLanes) {
            scale.update(p + lane, m + lane, v + lane, load(g + lane));
            store(g + lane, F{});
        }
    }
}

}  // namespace
