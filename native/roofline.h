// What this processor can do at most at the three things a training step consists of; for the benchmark.
#pragma once

#include <ctime>

#include "kernel.h"
#include "simd.h"

namespace {

inline double cpu_seconds() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Multiply-adds on registers alone [GFLOP/s].
inline double measure_fma() {
    constexpr int kChains = 12, kRounds = 400000;
    F acc[kChains];
    // Chains that start alike stay alike, and the compiler would keep one of them.
    for (int k = 0; k < kChains; ++k) acc[k] = F{} + static_cast<float>(k);
    F factor = F{} + 0.999F, addend = F{} + 0.001F;
#if defined(__AVX512F__)
    asm volatile("" : "+v"(factor), "+v"(addend));
#elif defined(__x86_64__)
    asm volatile("" : "+x"(factor), "+x"(addend));
#endif
    const double start = cpu_seconds();
    for (int i = 0; i < kRounds; ++i) {
        for (int k = 0; k < kChains; ++k) acc[k] = acc[k] * factor + addend;
    }
    const double elapsed = cpu_seconds() - start;
    F total{};
    for (const F& chain : acc) total += chain;
    volatile float sink = sum(total);
    (void)sink;
    return 2.0 * kLanes * kChains * kRounds / elapsed * 1e-9;
}

// Time per pair of floats at random places of a table: read and accumulate, or read, add and write [ns].
inline double measure_table(float* table, const std::uint32_t* index, int count, bool update) {
    const double start = cpu_seconds();
    F2 acc[8] = {};
    const F2 weight = {0.5F, 0.25F};
    if (update) {
        for (int i = 0; i < count; ++i) store2(table + 2 * index[i], load2(table + 2 * index[i]) + weight);
    } else {
        for (int i = 0; i < count; i += 8) {
            for (int k = 0; k < 8; ++k) acc[k] += load2(table + 2 * index[i + k]) * weight;
        }
    }
    const double elapsed = cpu_seconds() - start;
    F2 total{};
    for (const F2& part : acc) total += part;
    volatile float sink = total[0] + total[1];
    (void)sink;
    return elapsed / count * 1e9;
}

// Reading and writing memory in order [GB/s, both directions counted].
inline double measure_stream(float* memory, std::size_t floats_count) {
    const double start = cpu_seconds();
    for (std::size_t i = 0; i < floats_count; i += kLanes) store(memory + i, load(memory + i) * 0.5F);
    return 2.0 * sizeof(float) * static_cast<double>(floats_count) / (cpu_seconds() - start) * 1e-9;
}

void measure_roofline(std::size_t table_bytes, anm::Roofline& best) {
    constexpr int kCount = 1 << 17;
    constexpr std::size_t kStream = std::size_t{28} << 20;  // table, gradient and moments of the common shape
    static_assert(kStream % 64 == 0, "whole lines");
    float* memory = static_cast<float*>(__builtin_malloc(kStream + 64));
    auto* index = static_cast<std::uint32_t*>(__builtin_malloc(kCount * sizeof(std::uint32_t)));
    std::memset(memory, 0, kStream);
    std::uint32_t state = 1;
    for (int i = 0; i < kCount; ++i) {
        state = state * 1664525U + 1013904223U;
        index[i] = static_cast<std::uint32_t>((static_cast<std::uint64_t>(state) * (table_bytes / 8)) >> 32);
    }
    best = {0.0, 1e9, 1e9, 0.0};
    for (int repeat = 0; repeat < 12; ++repeat) {
        const double fma = measure_fma();
        best.fma_gflops = fma > best.fma_gflops ? fma : best.fma_gflops;
        measure_table(memory, index, kCount, false);  // warm
        const double load_ns = measure_table(memory, index, kCount, false);
        best.load_ns = load_ns < best.load_ns ? load_ns : best.load_ns;
        const double update_ns = measure_table(memory, index, kCount, true);
        best.update_ns = update_ns < best.update_ns ? update_ns : best.update_ns;
        const double stream = measure_stream(memory, kStream / sizeof(float));
        best.stream_gb_per_s = stream > best.stream_gb_per_s ? stream : best.stream_gb_per_s;
    }
    __builtin_free(index);
    __builtin_free(memory);
}

}  // namespace
