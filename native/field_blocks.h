// Which voxels of a block the neural field has to be asked for, and what its answers decide, as
// anm_mj/mapping/field_blocks.py has it. A line of a block along x is a number of sixteen bits.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace anm {

constexpr int kBlock = 16;  // voxels along the edge of a block
constexpr std::int8_t kUnknownState = -1, kFreeState = 0, kOccupiedState = 1;

// Arrays [layer][row][col].
struct Extent {
    std::int64_t layers = 0, rows = 0, cols = 0;

    std::int64_t at(std::int64_t layer, std::int64_t row, std::int64_t col) const {
        return (layer * rows + row) * cols + col;
    }
};

// Which of the states of a line have a value.
inline std::uint16_t line_equals(const std::int8_t* line, std::int8_t value) {
#if defined(__SSE2__)
    const __m128i states = _mm_loadu_si128(reinterpret_cast<const __m128i*>(line));
    return static_cast<std::uint16_t>(_mm_movemask_epi8(_mm_cmpeq_epi8(states, _mm_set1_epi8(value))));
#else
    std::uint16_t bits = 0;
    for (int c = 0; c < kBlock; ++c) bits |= static_cast<std::uint16_t>((line[c] == value) << c);
    return bits;
#endif
}

// In which places two lines have the same state.
inline std::uint16_t lines_agree(const std::int8_t* a, const std::int8_t* b) {
#if defined(__SSE2__)
    const __m128i x = _mm_loadu_si128(reinterpret_cast<const __m128i*>(a));
    const __m128i y = _mm_loadu_si128(reinterpret_cast<const __m128i*>(b));
    return static_cast<std::uint16_t>(_mm_movemask_epi8(_mm_cmpeq_epi8(x, y)));
#else
    std::uint16_t bits = 0;
    for (int c = 0; c < kBlock; ++c) bits |= static_cast<std::uint16_t>((a[c] == b[c]) << c);
    return bits;
#endif
}

// Voxels of the blocks that are occupied or beside one that is, and known: as indices into the arrays, block by block.
// Where `agreed` is given, only those whose state differs from it. Returns how many; writes no more than `room`.
inline std::int64_t voxels_to_read(const std::int8_t* state, const std::int8_t* agreed, const Extent& size,
                                   const std::int64_t* blocks, std::int64_t count, std::int64_t* out,
                                   std::int64_t room) {
    std::int64_t found = 0;
    // A layer and a row of nothing on either side.
    std::uint16_t hit[kBlock + 2][kBlock + 2] = {}, asked[kBlock][kBlock];
    for (std::int64_t b = 0; b < count; ++b) {
        const std::int64_t layer = blocks[3 * b] * kBlock, row = blocks[3 * b + 1] * kBlock;
        const std::int64_t col = blocks[3 * b + 2] * kBlock;
        unsigned any_hit = 0, any_asked = 0;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                const std::int64_t start = size.at(layer + l, row + r, col);
                unsigned mask = ~static_cast<unsigned>(line_equals(state + start, kUnknownState)) & 0xFFFFU;
                if (agreed != nullptr) mask &= ~static_cast<unsigned>(lines_agree(state + start, agreed + start));
                asked[l][r] = static_cast<std::uint16_t>(mask);
                any_asked |= mask;
                hit[l + 1][r + 1] = line_equals(state + start, kOccupiedState);
                any_hit |= hit[l + 1][r + 1];
            }
        }
        if (any_hit == 0 || any_asked == 0) continue;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                if (asked[l][r] == 0) continue;
                const unsigned here = hit[l + 1][r + 1];
                const unsigned near = here | here << 1 | here >> 1 | hit[l][r + 1] | hit[l + 2][r + 1] | hit[l + 1][r] |
                                      hit[l + 1][r + 2];
                const std::int64_t start = size.at(layer + l, row + r, col);
                for (unsigned bits = near & asked[l][r]; bits != 0; bits &= bits - 1) {
                    if (found < room) out[found] = start + __builtin_ctz(bits);
                    ++found;
                }
            }
        }
    }
    return found;
}

// Takes over the states of blocks, and those of single voxels instead; says of each block whether any differs from what
// it was.
inline void write_blocks(const std::int8_t* state, const Extent& size, const std::int64_t* blocks, std::int64_t count,
                         const std::int64_t* voxels, const std::int8_t* read, std::int64_t num_voxels, std::int8_t* out,
                         std::uint8_t* moved) {
    std::int64_t next = 0;
    std::int8_t line[kBlock];
    for (std::int64_t b = 0; b < count; ++b) {
        const std::int64_t layer = blocks[3 * b] * kBlock, row = blocks[3 * b + 1] * kBlock;
        const std::int64_t col = blocks[3 * b + 2] * kBlock;
        bool changed = false;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                const std::int64_t start = size.at(layer + l, row + r, col);
                std::memcpy(line, state + start, kBlock);
                // The voxels come in the order in which voxels_to_read() finds them.
                for (; next < num_voxels && voxels[next] >= start && voxels[next] < start + kBlock; ++next) {
                    line[voxels[next] - start] = read[next];
                }
                if (lines_agree(line, out + start) == 0xFFFFU) continue;
                changed = true;
                std::memcpy(out + start, line, kBlock);
            }
        }
        moved[b] = changed ? 1 : 0;
    }
}

// World x, y, z of the centres of voxels, given by their indices into the arrays [m].
inline void voxel_centres(const std::int64_t* voxels, std::int64_t count, const Extent& size,
                          const std::int64_t* corner, double resolution, float* out) {
    std::int64_t start = 0, end = 0;
    float y = 0.0F, z = 0.0F;
    for (std::int64_t i = 0; i < count; ++i) {
        // Voxels of one line mostly follow each other.
        if (voxels[i] < start || voxels[i] >= end) {
            const std::int64_t line = voxels[i] / size.cols, layer = line / size.rows;
            start = line * size.cols;
            end = start + size.cols;
            y = static_cast<float>(static_cast<double>(line - layer * size.rows + corner[1]) * resolution);
            z = static_cast<float>(static_cast<double>(layer + corner[2]) * resolution);
        }
        out[3 * i] = static_cast<float>(static_cast<double>(voxels[i] - start + corner[0]) * resolution);
        out[3 * i + 1] = y;
        out[3 * i + 2] = z;
    }
}

// What decides between depth and field; see DoubtRule in anm_mj/mapping/field_blocks.py.
struct DoubtRule {
    float hit_m, half_m, noise_per_m, passed_m, ray_reach_m;
};

// States of voxels by the signed distance at their centres, in the order of `voxels`.
inline void decide_voxels(const std::int8_t* state, const float* seen_m, const std::int64_t* voxels, std::int64_t count,
                          const float* sdf_m, const DoubtRule& rule, std::int8_t* out) {
    for (std::int64_t i = 0; i < count; ++i) {
        const float distance = sdf_m[i];
        bool solid = false;
        if (state[voxels[i]] == kOccupiedState) {
            const float seen = seen_m[voxels[i]];
            solid = distance <= rule.hit_m || distance - rule.half_m > rule.noise_per_m * (seen * seen);
        } else {
            solid = distance <= 0.0F && rule.passed_m - distance <= rule.ray_reach_m;
        }
        out[i] = solid ? kOccupiedState : kFreeState;
    }
}

}  // namespace anm
