// Sums of normal equations over many points at once.
#pragma once

#include "kernel.h"
#include "simd.h"

namespace {

using anm::NormalEquations;

constexpr int kUpper = 21;  // entries of the upper triangle of a 6 x 6 matrix

// Sums of one kind of residual, lane by lane.
struct LaneSums {
    F hessian[kUpper] = {};
    F gradient[6] = {};
    F cost{}, weight{}, count{};

    ANM_INLINE void add(const F (&jacobian)[6], F residual, F weight_of, F robust, F cost_of, F counted) {
        int k = 0;
        for (int i = 0; i < 6; ++i) {
            const F weighted = jacobian[i] * weight_of;
            gradient[i] += weighted * residual;
            for (int j = i; j < 6; ++j) hessian[k++] += weighted * jacobian[j];
        }
        cost += cost_of;
        weight += robust;
        count += counted;
    }
};

inline void add_to(NormalEquations& out, const LaneSums& sums) {
    for (int k = 0; k < kUpper; ++k) out.hessian[k] += static_cast<double>(sum(sums.hessian[k]));
    for (int k = 0; k < 6; ++k) out.gradient[k] += static_cast<double>(sum(sums.gradient[k]));
    out.cost += static_cast<double>(sum(sums.cost));
    out.weight += static_cast<double>(sum(sums.weight));
    out.count += static_cast<double>(sum(sums.count));
}

// Geman and McClure's kernel on a squared residual in units of its deviation: the cost, and the weight that goes with it.
ANM_INLINE void robust(F square, float width, F& cost, F& weight) {
    const F share = width * width / (width * width + square);
    cost = share * square;
    weight = share * share;
}

}  // namespace
