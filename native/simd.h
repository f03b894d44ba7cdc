// Vectors of floats in the width of the instruction set that this unit is compiled for, from the compiler's own vector
// extension: no intrinsics but for the square root and the floor, which the extension lacks.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace {

#if defined(__AVX512F__)
constexpr int kLanes = 16;
#elif defined(__AVX2__)
constexpr int kLanes = 8;
#else
constexpr int kLanes = 4;
#endif

#define ANM_INLINE inline __attribute__((always_inline))

typedef float F __attribute__((vector_size(4 * kLanes)));
typedef std::int32_t I __attribute__((vector_size(4 * kLanes)));
typedef std::uint32_t U __attribute__((vector_size(4 * kLanes)));
typedef float FUnaligned __attribute__((vector_size(4 * kLanes), aligned(4), may_alias));
typedef float F2 __attribute__((vector_size(8)));
typedef float F2Unaligned __attribute__((vector_size(8), aligned(4), may_alias));
typedef float F4 __attribute__((vector_size(16), may_alias));

ANM_INLINE F load(const float* p) { return *reinterpret_cast<const FUnaligned*>(p); }
ANM_INLINE void store(float* p, F v) { *reinterpret_cast<FUnaligned*>(p) = v; }
ANM_INLINE F2 load2(const float* p) { return *reinterpret_cast<const F2Unaligned*>(p); }
ANM_INLINE void store2(float* p, F2 v) { *reinterpret_cast<F2Unaligned*>(p) = v; }

// Two pairs of floats in one vector.
ANM_INLINE F4 load_pairs(const float* low, const float* high) {
#if defined(__x86_64__)
    const __m128 first = _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(low)));
    return _mm_loadh_pi(first, reinterpret_cast<const __m64*>(high));
#else
    return F4{low[0], low[1], high[0], high[1]};
#endif
}

ANM_INLINE void store_pairs(float* low, float* high, F4 v) {
#if defined(__x86_64__)
    _mm_storel_pi(reinterpret_cast<__m64*>(low), v);
    _mm_storeh_pi(reinterpret_cast<__m64*>(high), v);
#else
    low[0] = v[0];
    low[1] = v[1];
    high[0] = v[2];
    high[1] = v[3];
#endif
}

ANM_INLINE F4 load4(const float* p) { return *reinterpret_cast<const F4*>(p); }
ANM_INLINE void store4(float* p, F4 v) { *reinterpret_cast<F4*>(p) = v; }

// Quads are a pair each for the two corners of an edge, of as many samples as fill a vector; kPart says which samples of
// the kLanes that a vector of single values, or of the kLanes / 2 that a vector of pairs holds.

// Per sample a, a, b, b.
template <int kPart>
ANM_INLINE F quads(F a, F b) {
    constexpr int s = kPart * (kLanes / 4), t = s + kLanes;
#if defined(__AVX512F__)
    return __builtin_shufflevector(a, b, s, s, t, t, s + 1, s + 1, t + 1, t + 1, s + 2, s + 2, t + 2, t + 2, s + 3,
                                   s + 3, t + 3, t + 3);
#elif defined(__AVX2__)
    return __builtin_shufflevector(a, b, s, s, t, t, s + 1, s + 1, t + 1, t + 1);
#else
    return __builtin_shufflevector(a, b, s, s, t, t);
#endif
}

// Every pair twice.
template <int kPart>
ANM_INLINE F twice(F pairs) {
    constexpr int s = kPart * (kLanes / 2);
#if defined(__AVX512F__)
    return __builtin_shufflevector(pairs, pairs, s, s + 1, s, s + 1, s + 2, s + 3, s + 2, s + 3, s + 4, s + 5, s + 4,
                                   s + 5, s + 6, s + 7, s + 6, s + 7);
#elif defined(__AVX2__)
    return __builtin_shufflevector(pairs, pairs, s, s + 1, s, s + 1, s + 2, s + 3, s + 2, s + 3);
#else
    return __builtin_shufflevector(pairs, pairs, s, s + 1, s, s + 1);
#endif
}

// The quads of the entries at these places of a table of pairs.
ANM_INLINE F load_quads(const float* table, const std::uint32_t* low, const std::uint32_t* high) {
    const auto quad = [&](int s) {
        return load_pairs(table + 2 * static_cast<std::size_t>(low[s]), table + 2 * static_cast<std::size_t>(high[s]));
    };
#if defined(__AVX2__)
    const auto two = [&](int s) { return __builtin_shufflevector(quad(s), quad(s + 1), 0, 1, 2, 3, 4, 5, 6, 7); };
#if defined(__AVX512F__)
    return __builtin_shufflevector(two(0), two(2), 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#else
    return two(0);
#endif
#else
    return quad(0);
#endif
}

// Sums of the two pairs of each quad.
ANM_INLINE F add_pairs(F first, F second) {
#if defined(__AVX512F__)
    const F low = __builtin_shufflevector(first, second, 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29);
    const F high = __builtin_shufflevector(first, second, 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31);
#elif defined(__AVX2__)
    const F low = __builtin_shufflevector(first, second, 0, 1, 4, 5, 8, 9, 12, 13);
    const F high = __builtin_shufflevector(first, second, 2, 3, 6, 7, 10, 11, 14, 15);
#else
    const F low = __builtin_shufflevector(first, second, 0, 1, 4, 5);
    const F high = __builtin_shufflevector(first, second, 2, 3, 6, 7);
#endif
    return low + high;
}

ANM_INLINE F to_float(I v) { return __builtin_convertvector(v, F); }
ANM_INLINE I to_int(F v) { return __builtin_convertvector(v, I); }

// A product that must be rounded before it is added to, because the reference does so: positions differ in the last
// bit otherwise, and on the finest level that bit is a thousandth of a cell. Without it the compiler fuses the two.
ANM_INLINE F rounded(F v) {
#if defined(__AVX512F__)
    asm("" : "+v"(v));
#elif defined(__x86_64__)
    asm("" : "+x"(v));
#endif
    return v;
}

ANM_INLINE float rounded(float v) {
#if defined(__x86_64__)
    asm("" : "+x"(v));
#endif
    return v;
}

// Has a value computed that nobody asks for.
ANM_INLINE void keep(F v) {
#if defined(__AVX512F__)
    asm volatile("" : : "v"(v));
#elif defined(__x86_64__)
    asm volatile("" : : "x"(v));
#else
    asm volatile("" : : "w"(v));
#endif
}

ANM_INLINE F floor(F v) {
#if defined(__AVX512F__)
    return _mm512_roundscale_ps(v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
#elif defined(__AVX2__)
    return _mm256_floor_ps(v);
#elif defined(__x86_64__)
    return _mm_floor_ps(v);
#else
    for (int i = 0; i < kLanes; ++i) v[i] = __builtin_floorf(v[i]);
    return v;
#endif
}

ANM_INLINE F square_root(F v) {
#if defined(__AVX512F__)
    return _mm512_sqrt_ps(v);
#elif defined(__AVX2__)
    return _mm256_sqrt_ps(v);
#elif defined(__x86_64__)
    return _mm_sqrt_ps(v);
#else
    for (int i = 0; i < kLanes; ++i) v[i] = __builtin_sqrtf(v[i]);
    return v;
#endif
}

// e^x for x <= 0 to about one unit in the last place; 0 below -87. Cody-Waite reduction and the minimax polynomial of
// the Cephes library.
ANM_INLINE F exp_negative(F x) {
    const F clamped = x < -87.0F ? F{} - 87.0F : x;
    const I k = to_int(clamped * 1.44269504088896341F - 0.5F);
    const F n = to_float(k);
    const F r = (clamped - n * 0.693359375F) + n * 2.12194440e-4F;
    F p = r * 1.9875691500e-4F + 1.3981999507e-3F;
    p = p * r + 8.3334519073e-3F;
    p = p * r + 4.1665795894e-2F;
    p = p * r + 1.6666665459e-1F;
    p = p * r + 5.0000001201e-1F;
    p = p * r * r + r + 1.0F;
    const I power = (k + 127) << 23;
    F scale;
    std::memcpy(&scale, &power, sizeof scale);
    return x < -87.0F ? F{} : p * scale;
}

ANM_INLINE F sigmoid(F x) {
    const F e = exp_negative(x > 0.0F ? -x : x);
    const F small = e / (1.0F + e);
    return x > 0.0F ? 1.0F / (1.0F + e) : small;
}

ANM_INLINE float sum(F v) {
    float lane[kLanes];
    std::memcpy(lane, &v, sizeof v);
    for (int width = kLanes / 2; width > 0; width /= 2) {
        for (int i = 0; i < width; ++i) lane[i] += lane[i + width];
    }
    return lane[0];
}

}  // namespace
