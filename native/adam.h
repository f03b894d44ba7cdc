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

    // The new moments, and how far the parameter goes down.
    ANM_INLINE F update(F& m, F& v, F g) const {
        m += beta1_rest * (g - m);
        v = beta2 * v + beta2_rest * g * g;
        return step * m / (square_root(v) * inverse_root + epsilon);
    }
};

ANM_INLINE void adam_vector(const AdamScale& scale, float* p, float* m, float* v, F g) {
    F first = load(m), second = load(v);
    store(p, load(p) - scale.update(first, second, g));
    store(m, first);
    store(v, second);
}

// One level. Clears the gradient. Moment is float or, of large tables, which wait for memory here, half the bits. Lines
// that never had a gradient have zero moments and would not move: they are passed over, which on coarse levels is most
// of the table.
template <class Moment>
ANM_INLINE void adam_level(const AdamScale& scale, int entries, float* p, Moment* moments, std::uint8_t* touched,
                           float* g) {
    constexpr int kLine = 16;
    constexpr int kAhead = 1024;  // a page, where the processor's own foresight ends
    for (int i = 0; i < 2 * entries; i += kLine) {
        Moment* m = moments + 2 * i;
        Moment* v = m + kLine;
        __builtin_prefetch(p + i + kAhead, 1);
        __builtin_prefetch(m + 2 * kAhead, 1);
        if (sizeof(Moment) == sizeof(float)) __builtin_prefetch(v + 2 * kAhead, 1);
        if (!touched[i / kLine]) {
            I any{};
            for (int lane = 0; lane < kLine; lane += kLanes) any |= load(g + i + lane) != 0.0F;
            bool moved = false;
            for (int lane = 0; lane < kLanes; ++lane) moved |= any[lane] != 0;
            if (!moved) continue;
            touched[i / kLine] = 1;
        }
        for (int lane = 0; lane < kLine; lane += kLanes) {
            F first = load(m + lane), second = load(v + lane);
            store(p + i + lane, load(p + i + lane) - scale.update(first, second, load(g + i + lane)));
            store(m + lane, first);
            store(v + lane, second);
            store(g + i + lane, F{});
        }
    }
}

}  // namespace
