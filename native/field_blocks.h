// Which voxels of a block the neural field has to be asked for, as anm_mj/mapping/field_geometry.py has it.
#pragma once

#include <cstdint>
#include <cstring>

namespace anm {

constexpr int kBlock = 16;  // voxels along the edge of a block
constexpr int kBlockVoxels = kBlock * kBlock * kBlock;
constexpr std::int8_t kUnknownState = -1, kFreeState = 0, kOccupiedState = 1;

// Arrays [layer][row][col].
struct Extent {
    std::int64_t layers = 0, rows = 0, cols = 0;

    std::int64_t at(std::int64_t layer, std::int64_t row, std::int64_t col) const {
        return (layer * rows + row) * cols + col;
    }
};

// What is set, and what has a face neighbour in the block that is.
inline void dilate_block(const std::uint8_t* mask, std::uint8_t* out) {
    std::memcpy(out, mask, kBlockVoxels);
    constexpr int kLayer = kBlock * kBlock;
    for (int i = 0; i + kLayer < kBlockVoxels; ++i) {
        out[i] |= mask[i + kLayer];
        out[i + kLayer] |= mask[i];
    }
    for (int layer = 0; layer < kBlockVoxels; layer += kLayer) {
        for (int i = layer; i + kBlock < layer + kLayer; ++i) {
            out[i] |= mask[i + kBlock];
            out[i + kBlock] |= mask[i];
        }
    }
    for (int line = 0; line < kBlockVoxels; line += kBlock) {
        for (int i = line; i + 1 < line + kBlock; ++i) {
            out[i] |= mask[i + 1];
            out[i + 1] |= mask[i];
        }
    }
}

// Whether two arrays hold the same in a block.
inline bool same_block(const std::int8_t* a, const std::int8_t* b, const Extent& size, std::int64_t layer,
                       std::int64_t row, std::int64_t col) {
    for (int l = 0; l < kBlock; ++l) {
        for (int r = 0; r < kBlock; ++r) {
            const std::int64_t start = size.at(layer + l, row + r, col);
            if (std::memcmp(a + start, b + start, kBlock) != 0) return false;
        }
    }
    return true;
}

// Voxels of the blocks that are occupied or beside one that is, and known: as indices into the arrays, block by block.
// Where `agreed` is given, only those whose state differs from it. Returns how many; writes no more than `room`.
inline std::int64_t voxels_to_read(const std::int8_t* state, const std::int8_t* agreed, const Extent& size,
                                   const std::int64_t* blocks, std::int64_t count, std::int64_t* out,
                                   std::int64_t room) {
    std::int64_t found = 0;
    std::uint8_t hit[kBlockVoxels], near[kBlockVoxels];
    for (std::int64_t b = 0; b < count; ++b) {
        const std::int64_t layer = blocks[3 * b] * kBlock, row = blocks[3 * b + 1] * kBlock;
        const std::int64_t col = blocks[3 * b + 2] * kBlock;
        if (agreed != nullptr && same_block(state, agreed, size, layer, row, col)) continue;
        std::uint8_t any = 0;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                const std::int8_t* line = state + size.at(layer + l, row + r, col);
                std::uint8_t* mask = hit + (l * kBlock + r) * kBlock;
                for (int c = 0; c < kBlock; ++c) any |= mask[c] = line[c] == kOccupiedState;
            }
        }
        if (any == 0) continue;
        dilate_block(hit, near);
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                const std::int64_t start = size.at(layer + l, row + r, col);
                const std::uint8_t* mask = near + (l * kBlock + r) * kBlock;
                for (int c = 0; c < kBlock; ++c) {
                    if (mask[c] == 0 || state[start + c] == kUnknownState) continue;
                    if (agreed != nullptr && agreed[start + c] == state[start + c]) continue;
                    if (found < room) out[found] = start + c;
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
    std::int8_t now[kBlockVoxels];
    for (std::int64_t b = 0; b < count; ++b) {
        const std::int64_t layer = blocks[3 * b] * kBlock, row = blocks[3 * b + 1] * kBlock;
        const std::int64_t col = blocks[3 * b + 2] * kBlock;
        std::uint8_t changed = 0;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                const std::int64_t start = size.at(layer + l, row + r, col);
                std::int8_t* line = now + (l * kBlock + r) * kBlock;
                std::memcpy(line, state + start, kBlock);
                // The voxels come in the order in which voxels_to_read() finds them.
                for (; next < num_voxels && voxels[next] >= start && voxels[next] < start + kBlock; ++next) {
                    line[voxels[next] - start] = read[next];
                }
                changed |= std::memcmp(line, out + start, kBlock) != 0;
                std::memcpy(out + start, line, kBlock);
            }
        }
        moved[b] = changed;
    }
}

}  // namespace anm
