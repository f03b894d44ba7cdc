// Where along a ray the field is asked: the same depths, bit for bit, as anm_mj/mapping/sampling.py.
#pragma once

#include "kernel.h"
#include "simd.h"

namespace {

using anm::kMaxSamples;
using anm::Model;
using anm::Settings;

// The 32-bit mixer "lowbias32" (C. Wellons, 2018).
template <class T>
ANM_INLINE T mix(T x) {
    x = (x ^ (x >> 16)) * 0x7FEB352DU;
    x = (x ^ (x >> 15)) * 0x846CA68BU;
    return x ^ (x >> 16);
}

// jitter: room for `samples` rounded up to kLanes.
ANM_INLINE void draw_jitter(std::uint32_t seed, std::uint32_t first, int samples, float* jitter) {
    const std::uint32_t key = mix(seed);
    U lane;
    for (int i = 0; i < kLanes; ++i) lane[i] = static_cast<std::uint32_t>(i);
    for (int j = 0; j < samples; j += kLanes) {
        const U counter = lane + (first + static_cast<std::uint32_t>(j));
        const U bits = mix(mix(counter) ^ key) >> 8;
        store(jitter + j, to_float(reinterpret_cast<I>(bits)) * 0x1p-24F);
    }
}

ANM_INLINE bool has_surface(const Settings& c, float depth) { return depth > 0.0F && depth <= c.max_depth; }

ANM_INLINE void sample_guided(const Settings& c, float depth, const float* jitter, float* z) {
    if (!has_surface(c, depth)) {
        for (int j = 0; j < c.samples(); ++j) z[j] = (static_cast<float>(j) + jitter[j]) * c.none_step;
        return;
    }
    const float band_start = depth - c.truncation > 0.0F ? depth - c.truncation : 0.0F;
    const float free_step = band_start / static_cast<float>(c.free_samples);
    const float near_step = (depth + c.truncation - band_start) / static_cast<float>(c.near_samples);
    for (int j = 0; j < c.free_samples; ++j) z[j] = (static_cast<float>(j) + jitter[j]) * free_step;
    for (int j = 0; j < c.near_samples; ++j) {
        const int k = c.free_samples + j;
        z[k] = band_start + rounded((static_cast<float>(j) + jitter[k]) * near_step);
    }
}

ANM_INLINE void sample_uniform(const Model& model, float depth, const float* jitter, float* z) {
    const Settings& c = model.settings;
    const bool hit = has_surface(c, depth);
    float sorted[kMaxSamples];
    // Both lists ascend, so merging sorts them.
    int even = 0, near = 0;
    const auto near_depth = [&](int j) {
        const float value = hit ? depth + model.linspace_band[j] : model.linspace_spare[j];
        return value > 0.0F ? value : 0.0F;
    };
    for (int k = 0; k < c.samples(); ++k) {
        const bool take_even =
            near >= c.near_samples || (even < c.free_samples && model.linspace_free[even] <= near_depth(near));
        sorted[k] = take_even ? model.linspace_free[even++] : near_depth(near++);
    }
    const int last = c.samples() - 1;
    float lower = sorted[0];
    for (int k = 0; k <= last; ++k) {
        const float upper = k < last ? 0.5F * (sorted[k + 1] + sorted[k]) : sorted[last];
        z[k] = lower + rounded((upper - lower) * jitter[k]);
        lower = upper;
    }
}

// Ascending planar depths of the samples along one ray.
ANM_INLINE void sample_ray(const Model& model, float depth, std::uint32_t seed, std::uint32_t ray, float* z) {
    const Settings& c = model.settings;
    alignas(64) float jitter[kMaxSamples + kLanes];
    draw_jitter(seed, ray * static_cast<std::uint32_t>(c.samples()), c.samples(), jitter);
    if (c.guided) {
        sample_guided(c, depth, jitter, z);
    } else {
        sample_uniform(model, depth, jitter, z);
    }
}

}  // namespace
