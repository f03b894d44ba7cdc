// Zero-crossings on the edges of a lattice, as anm_mj/mapping/lattice.py has them. Arrays [x][y][z].
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "field_blocks.h"

namespace anm {

// Which cells of the lattice each voxel of a block touches, axis by axis (x, y, z): from `low` to `high`.
struct TouchedCells {
    const std::int64_t *low, *high;  // [block][axis][voxel]

    std::int64_t first(std::int64_t block, int axis, int voxel) const { return low[(3 * block + axis) * kBlock + voxel]; }
    std::int64_t last(std::int64_t block, int axis, int voxel) const { return high[(3 * block + axis) * kBlock + voxel]; }
};

struct Box3 {
    std::int64_t low[3] = {INT64_MAX, INT64_MAX, INT64_MAX}, high[3] = {INT64_MIN, INT64_MIN, INT64_MIN};

    bool empty() const { return low[0] > high[0]; }
    std::int64_t size(int axis) const { return high[axis] - low[axis] + 1; }
};

// Calls mark(box of cells) for every occupied voxel of the blocks, given by layer, row and column.
template <class Mark>
inline void for_each_touched(const std::int8_t* state, const Extent& size, const std::int64_t* blocks,
                             std::int64_t count, const TouchedCells& touched, const Mark& mark) {
    for (std::int64_t b = 0; b < count; ++b) {
        const std::int64_t layer = blocks[3 * b] * kBlock, row = blocks[3 * b + 1] * kBlock;
        const std::int64_t col = blocks[3 * b + 2] * kBlock;
        for (int l = 0; l < kBlock; ++l) {
            for (int r = 0; r < kBlock; ++r) {
                unsigned bits = line_equals(state + size.at(layer + l, row + r, col), kOccupiedState);
                for (; bits != 0; bits &= bits - 1) {
                    const int voxel[3] = {__builtin_ctz(bits), r, l};
                    Box3 box;
                    for (int axis = 0; axis < 3; ++axis) {
                        box.low[axis] = touched.first(b, axis, voxel[axis]);
                        box.high[axis] = touched.last(b, axis, voxel[axis]);
                    }
                    mark(box);
                }
            }
        }
    }
}

// The box about all cells that occupied voxels touch.
inline Box3 touched_box(const std::int8_t* state, const Extent& size, const std::int64_t* blocks, std::int64_t count,
                        const TouchedCells& touched) {
    Box3 all;
    for_each_touched(state, size, blocks, count, touched, [&](const Box3& box) {
        for (int axis = 0; axis < 3; ++axis) {
            all.low[axis] = std::min(all.low[axis], box.low[axis]);
            all.high[axis] = std::max(all.high[axis], box.high[axis]);
        }
    });
    return all;
}

// Marks these cells in an array of that box.
inline void mark_touched(const std::int8_t* state, const Extent& size, const std::int64_t* blocks, std::int64_t count,
                         const TouchedCells& touched, const Box3& all, std::uint8_t* cells) {
    for_each_touched(state, size, blocks, count, touched, [&](const Box3& box) {
        for (std::int64_t x = box.low[0]; x <= box.high[0]; ++x) {
            for (std::int64_t y = box.low[1]; y <= box.high[1]; ++y) {
                std::uint8_t* line = cells + ((x - all.low[0]) * all.size(1) + y - all.low[1]) * all.size(2);
                for (std::int64_t z = box.low[2]; z <= box.high[2]; ++z) line[z - all.low[2]] = 1;
            }
        }
    });
}

// Which corners the marked cells have, on a grid larger by one along each axis; returns how many.
inline std::int64_t mark_corners(const std::uint8_t* cells, const std::int64_t* size, std::uint8_t* corners) {
    std::int64_t count = 0;
    const std::int64_t line = size[2] + 1, layer = (size[1] + 1) * line;
    for (std::int64_t x = 0; x < size[0]; ++x) {
        for (std::int64_t y = 0; y < size[1]; ++y) {
            const std::uint8_t* from = cells + (x * size[1] + y) * size[2];
            std::uint8_t* to = corners + x * layer + y * line;
            for (std::int64_t z = 0; z < size[2]; ++z) {
                if (from[z] == 0) continue;
                for (const std::int64_t at : {z, z + line, z + layer, z + layer + line}) to[at] = to[at + 1] = 1;
            }
        }
    }
    for (std::int64_t i = 0; i < (size[0] + 1) * layer; ++i) count += corners[i];
    return count;
}

// Calls fn(index, x, y, z) for every marked corner, in order.
template <class Fn>
inline void for_each_corner(const std::uint8_t* corners, const std::int64_t* size, const Fn& fn) {
    std::int64_t i = 0;
    for (std::int64_t x = 0; x < size[0]; ++x) {
        for (std::int64_t y = 0; y < size[1]; ++y) {
            for (std::int64_t z = 0; z < size[2]; ++z, ++i) {
                if (corners[i] != 0) fn(i, x, y, z);
            }
        }
    }
}

// World places of marked corners [m].
inline void corner_places(const std::uint8_t* corners, const std::int64_t* size, const std::int64_t* corner,
                          double spacing, float* out) {
    for_each_corner(corners, size, [&](std::int64_t, std::int64_t x, std::int64_t y, std::int64_t z) {
        *out++ = static_cast<float>(static_cast<double>(x + corner[0]) * spacing);
        *out++ = static_cast<float>(static_cast<double>(y + corner[1]) * spacing);
        *out++ = static_cast<float>(static_cast<double>(z + corner[2]) * spacing);
    });
}

// World places at which values change their sign between marked corners that are neighbours, by linear interpolation:
// along x, then along y, then along z [m]. `values`: of the marked corners, in order.
inline void crossings(const std::uint8_t* corners, const std::int64_t* size, const float* values,
                      const std::int64_t* corner, double spacing, std::vector<double>& out) {
    std::vector<float> value(static_cast<std::size_t>(size[0] * size[1] * size[2]));
    std::int64_t next = 0;
    for_each_corner(corners, size, [&](std::int64_t i, std::int64_t, std::int64_t, std::int64_t) {
        value[static_cast<std::size_t>(i)] = values[next++];
    });
    const std::int64_t stride[3] = {size[1] * size[2], size[2], 1};
    for (int axis = 0; axis < 3; ++axis) {
        for_each_corner(corners, size, [&](std::int64_t i, std::int64_t x, std::int64_t y, std::int64_t z) {
            const std::int64_t at[3] = {x, y, z};
            if (at[axis] + 1 == size[axis] || corners[i + stride[axis]] == 0) return;
            const float low = value[static_cast<std::size_t>(i)];
            const float high = value[static_cast<std::size_t>(i + stride[axis])];
            if ((low > 0.0F) == (high > 0.0F)) return;
            for (int k = 0; k < 3; ++k) {
                double along = static_cast<double>(at[k] + corner[k]);
                if (k == axis) along += static_cast<double>(low / (low - high));
                out.push_back(along * spacing);
            }
        });
    }
}

}  // namespace anm
