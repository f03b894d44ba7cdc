// Registration of a frame to the field: normal equations of point-to-surface distances and colours at a pose.
#pragma once

#include "field_gradients.h"
#include "lane_sums.h"

namespace {

using anm::Alignment;
using anm::FramePoints;

constexpr int kAlignBlock = 32;   // points of a task; fixed, so that sums do not depend on the number of threads

template <class Shape>
void align_as(const Shape& shape, const Model& model, const FramePoints& points, const Alignment& at, const float* packed,
              NormalEquations* partial, const Parallel& parallel, const Arena& arena) {
    using Scratch = TangentScratch<kAlignBlock>;
    const Settings& c = model.settings;
    const PackedDecoders w(c, const_cast<float*>(packed));
    const int tasks = (points.count + kAlignBlock - 1) / kAlignBlock;
    const bool with_color = at.color_deviation > 0.0F;
    run_tasks(parallel, tasks, [&](int task, int worker) {
        const Scratch scratch(c, floats(arena, kWorkerScratch, worker, 0));
        const Activations& a = scratch.activations;
        const int first = task * kAlignBlock, size = smaller(kAlignBlock, points.count - first);
        alignas(64) float arm[3][kAlignBlock], ray[3][kAlignBlock], color[3][kAlignBlock];
        alignas(64) float trust[kAlignBlock], variance[kAlignBlock];
        for (int i = 0; i < kAlignBlock; ++i) {
            const bool has = i < size;
            const float* x = points.camera + 3 * (first + (has ? i : 0));
            float length = 0.0F;
            for (int axis = 0; axis < 3; ++axis) length += x[axis] * x[axis];
            const float inverse = length > 0.0F ? 1.0F / __builtin_sqrtf(length) : 0.0F;
            for (int axis = 0; axis < 3; ++axis) {
                const float* r = at.rotation + 3 * axis;
                arm[axis][i] = r[0] * x[0] + r[1] * x[1] + r[2] * x[2];
                scratch.at.axis[axis][i] = arm[axis][i] + at.position[axis];
                ray[axis][i] = arm[axis][i] * inverse;
                color[axis][i] = points.rgb[3 * (first + (has ? i : 0)) + axis];
            }
            trust[i] = has ? points.trust[first + i] : 0.0F;
            variance[i] = has ? points.variance[first + i] : 1.0F;
        }
        scratch.encode(model);
        scratch.decode(c, shape, w, with_color);
        LaneSums geometry, photometry;
        for (int i = 0; i < kAlignBlock; i += kLanes) {
            const F s = load(a.s + i);
            F normal[3], square{};
            for (int axis = 0; axis < 3; ++axis) {
                normal[axis] = load(a.s + (1 + axis) * kAlignBlock + i) * c.truncation;
                square += normal[axis] * normal[axis];
            }
            const F slope = square_root(square);
            // Where the field is flat, steep or saturated, its gradient says nothing about the way to the surface.
            const F size_of_s = s < 0.0F ? -s : s;
            const F one = F{} + 1.0F;
            F valid = load(trust + i);
            valid = size_of_s < at.saturation ? valid : F{};
            valid = slope > at.least_slope ? valid : F{};
            valid = slope < at.most_slope ? valid : F{};
            const F inverse = 1.0F / (slope > 1e-6F ? slope : F{} + 1e-6F);
            F incidence{};
            for (int axis = 0; axis < 3; ++axis) {
                normal[axis] *= inverse;
                incidence += normal[axis] * load(ray[axis] + i);
            }
            const F distance = s * c.truncation * inverse;
            const F spread = load(variance + i) * incidence * incidence + at.field_variance;
            F cost, weight;
            robust(distance * distance / spread, at.kernel, cost, weight);
            const F r[3] = {load(arm[0] + i), load(arm[1] + i), load(arm[2] + i)};
            const auto jacobian = [&](const F (&g)[3], F (&out)[6]) {
                for (int axis = 0; axis < 3; ++axis) out[axis] = g[axis];
                out[3] = r[1] * g[2] - r[2] * g[1];
                out[4] = r[2] * g[0] - r[0] * g[2];
                out[5] = r[0] * g[1] - r[1] * g[0];
            };
            F row[6];
            jacobian(normal, row);
            const F counted = valid > 0.0F ? one : F{};
            geometry.add(row, distance, valid * weight / spread, valid * weight, valid * cost, counted);
            if (!with_color) continue;
            // Colour is known on the surface: what changes along the normal was never observed.
            const float precision = 1.0F / (at.color_deviation * at.color_deviation);
            F difference[3], gradient[3][3], total{};
            for (int channel = 0; channel < 3; ++channel) {
                const float* value = a.rgb + channel * Scratch::kRows;
                difference[channel] = load(value + i) - load(color[channel] + i);
                F along{};
                for (int axis = 0; axis < 3; ++axis) {
                    gradient[channel][axis] = load(value + (1 + axis) * kAlignBlock + i);
                    along += gradient[channel][axis] * normal[axis];
                }
                for (int axis = 0; axis < 3; ++axis) gradient[channel][axis] -= along * normal[axis];
                total += difference[channel] * difference[channel] * precision;
            }
            // A point off its surface sees the colour of another place.
            F color_cost, color_weight;
            robust(total, at.color_kernel, color_cost, color_weight);
            const F both = valid * weight;
            for (int channel = 0; channel < 3; ++channel) {
                jacobian(gradient[channel], row);
                const F share = channel == 0 ? both : F{};
                photometry.add(row, difference[channel], both * color_weight * precision, share * color_weight,
                               share * color_cost, channel == 0 ? counted : F{});
            }
        }
        NormalEquations* sums = partial + 2 * task;
        sums[0] = sums[1] = NormalEquations{};
        add_to(sums[0], geometry);
        add_to(sums[1], photometry);
    });
}

void align(const Model& model, const FramePoints& points, const Alignment& at, NormalEquations* sums,
           const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    for (int worker = 0; worker < parallel.workers; ++worker) {
        floats(arena, kWorkerScratch, worker, TangentScratch<kAlignBlock>::size(c));
    }
    float* packed = floats(arena, kPacked, 0, c.packed_size());
    pack(c, model.decoders, packed);
    const int tasks = (points.count + kAlignBlock - 1) / kAlignBlock;
    auto* partial = reinterpret_cast<NormalEquations*>(
        floats(arena, kPartial, 0, 2 * static_cast<std::size_t>(tasks) * sizeof(NormalEquations) / sizeof(float)));
    if (Widths<32, 16>::fits(c)) {
        align_as(Widths<32, 16>(c), model, points, at, packed, partial, parallel, arena);
    } else {
        align_as(Widths<0, 0>(c), model, points, at, packed, partial, parallel, arena);
    }
    for (int kind = 0; kind < 2; ++kind) {
        NormalEquations& out = sums[kind] = NormalEquations{};
        for (int task = 0; task < tasks; ++task) {
            const NormalEquations& part = partial[2 * task + kind];
            for (int k = 0; k < kUpper; ++k) out.hessian[k] += part.hessian[k];
            for (int k = 0; k < 6; ++k) out.gradient[k] += part.gradient[k];
            out.cost += part.cost;
            out.weight += part.weight;
            out.count += part.count;
        }
    }
}

}  // namespace
