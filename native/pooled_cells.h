// The occupancy grid as the information gain sees it: cells of 2 x 2 x 2 voxels, as
// anm_mj/planning/policies/gvg/pooling.py has it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "field_blocks.h"

namespace anm {

constexpr std::int8_t kKnownCell = 2;  // not free, and nothing new is looked for there
constexpr int kPool = 2;

// A part of a grid, in cells; it may stick out of the grid, where all is unknown.
struct PoolWindow {
    Extent voxels;        // of the whole grid
    std::int64_t low[3];  // layer, row and column of its first voxel
    Extent cells;         // of the window
};

// State of a line of cells from the sums of their voxels in pairs; see pool_states(). Without branches, so that many
// cells are done at once.
inline void pool_line(const std::uint8_t* __restrict total, std::int64_t count, std::int8_t* __restrict pooled,
                      std::uint8_t* __restrict partly) {
    for (std::int64_t c = 0; c < count; ++c) {
        const auto sum = static_cast<std::uint8_t>(total[kPool * c] + total[kPool * c + 1]);
        const auto unknown = static_cast<std::uint8_t>(sum >> 4), not_free = static_cast<std::uint8_t>(sum & 15);
        const std::uint8_t occupied = not_free > unknown;
        const auto is_unknown = static_cast<std::uint8_t>((unknown >= kPool * kPool) & (occupied ^ 1));
        pooled[c] = static_cast<std::int8_t>(occupied - is_unknown);
        partly[c] = static_cast<std::uint8_t>(is_unknown & (unknown < kPool * kPool * kPool));
    }
}

// State of the window's cells, and which of the unknown ones are not unknown throughout.
inline void pool_states(const std::int8_t* state, const PoolWindow& window, std::int8_t* pooled, std::uint8_t* partly) {
    const Extent &size = window.voxels, &cells = window.cells;
    // Of -1, 0 and 1 this leaves 17, 0 and 1, so that one sum holds the unknown in its upper four bits and all that is
    // not free in its lower four.
    constexpr std::uint8_t kBits = 17, kOutside = kBits * kPool * kPool;
    std::vector<std::uint8_t> total(static_cast<std::size_t>(kPool * cells.cols));
    const std::int64_t first = std::clamp<std::int64_t>(-window.low[2], 0, kPool * cells.cols);
    const std::int64_t last = std::clamp<std::int64_t>(size.cols - window.low[2], first, kPool * cells.cols);
    for (std::int64_t layer = 0; layer < cells.layers; ++layer) {
        for (std::int64_t row = 0; row < cells.rows; ++row) {
            std::fill(total.begin(), total.end(), kOutside);
            std::fill(total.begin() + first, total.begin() + last, std::uint8_t{0});
            for (int line = 0; line < kPool * kPool; ++line) {
                const std::int64_t l = window.low[0] + kPool * layer + line / kPool;
                const std::int64_t r = window.low[1] + kPool * row + line % kPool;
                if (l < 0 || r < 0 || l >= size.layers || r >= size.rows) {
                    for (std::int64_t c = first; c < last; ++c) total[c] = static_cast<std::uint8_t>(total[c] + kBits);
                    continue;
                }
                const std::int8_t* from = state + size.at(l, r, 0) + window.low[2];
                for (std::int64_t c = first; c < last; ++c) {
                    total[c] = static_cast<std::uint8_t>(total[c] + (static_cast<std::uint8_t>(from[c]) & kBits));
                }
            }
            const std::int64_t start = cells.at(layer, row, 0);
            pool_line(total.data(), cells.cols, pooled + start, partly + start);
        }
    }
}

// What is partly unknown beside surface counts as known; so do columns that are seen free in the layer of the floor and
// in the one below.
inline void mark_known(const Extent& cells, const std::uint8_t* partly, std::int64_t floor, std::int8_t* pooled) {
    const std::int64_t count = cells.layers * cells.rows * cells.cols, layer = cells.rows * cells.cols;
    const auto occupied = [&](bool inside, std::int64_t i) { return inside && pooled[i] == kOccupiedState; };
    for (std::int64_t i = 0; i < count; ++i) {
        std::uint64_t eight = 1;
        if (i + 8 <= count) std::memcpy(&eight, partly + i, 8);
        if (eight == 0) i += 7;
        if (eight == 0 || partly[i] == 0) continue;
        const std::int64_t in_layer = i % layer, col = i % cells.cols;
        if (occupied(i >= layer, i - layer) || occupied(i + layer < count, i + layer) ||
            occupied(in_layer >= cells.cols, i - cells.cols) || occupied(in_layer + cells.cols < layer, i + cells.cols) ||
            occupied(col > 0, i - 1) || occupied(col + 1 < cells.cols, i + 1)) {
            pooled[i] = kKnownCell;
        }
    }
    if (floor < 1 || floor >= cells.layers) return;
    for (std::int64_t i = 0; i < layer; ++i) {
        if (pooled[floor * layer + i] != kFreeState || pooled[(floor - 1) * layer + i] != kFreeState) continue;
        for (std::int64_t l = 0; l < cells.layers; ++l) pooled[l * layer + i] = kKnownCell;
    }
}

// Rows and columns from the first to the one behind the last.
struct Changed {
    std::int64_t row_begin = 0, row_end = 0, col_begin = 0, col_end = 0;
};

// Pools a window again into `out`, all but the outermost rows and columns, which begin at layer, row and column `to`;
// keeps up how many cells of each layer are free and how many are surface; says where cells have changed.
inline Changed pool_window(const std::int8_t* state, const PoolWindow& window, std::int64_t floor, std::int8_t* out,
                           const Extent& size, const std::int64_t* to, std::int64_t* num_free,
                           std::int64_t* num_surface) {
    const Extent& cells = window.cells;
    const auto count = static_cast<std::size_t>(cells.layers * cells.rows * cells.cols);
    std::vector<std::int8_t> pooled(count);
    std::vector<std::uint8_t> partly(count);
    pool_states(state, window, pooled.data(), partly.data());
    mark_known(cells, partly.data(), floor, pooled.data());
    Changed changed{size.rows, 0, size.cols, 0};
    for (std::int64_t layer = 0; layer < cells.layers; ++layer) {
        for (std::int64_t row = 1; row + 1 < cells.rows; ++row) {
            const std::int8_t* from = pooled.data() + cells.at(layer, row, 1);
            std::int8_t* target = out + size.at(to[0] + layer, to[1] + row - 1, to[2]);
            const std::int64_t width = cells.cols - 2;
            if (std::memcmp(from, target, static_cast<std::size_t>(width)) == 0) continue;
            for (std::int64_t c = 0; c < width; ++c) {
                if (from[c] == target[c]) continue;
                num_free[to[0] + layer] += (from[c] == kFreeState) - (target[c] == kFreeState);
                num_surface[to[0] + layer] += (from[c] == kOccupiedState) - (target[c] == kOccupiedState);
                target[c] = from[c];
                changed.row_begin = std::min(changed.row_begin, to[1] + row - 1);
                changed.row_end = std::max(changed.row_end, to[1] + row);
                changed.col_begin = std::min(changed.col_begin, to[2] + c);
                changed.col_end = std::max(changed.col_end, to[2] + c + 1);
            }
        }
    }
    return changed;
}

}  // namespace anm
