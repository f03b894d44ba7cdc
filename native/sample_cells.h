// Which samples of a surface points come close to, as anm_mj/environments/sample_grid.py has it, to the last bit.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace anm {

// Samples in the order of their cells: first axis, second axis, third axis. Cells are no smaller than the distance that
// is asked for, and no sample lies in the outermost ones.
struct SampleCells {
    const double* samples;              // x y z each
    const std::int32_t* level;          // of each sample: its cell along the third axis
    const std::int64_t* column_start;   // of each column of cells, and the end of the last
    std::int64_t size[3];               // in cells
    double low[3];
    double per_metre;                   // cells
};

// Of a cell that holds a sample which is not covered.
constexpr std::uint8_t kOpen = 0x80;

// Marks the samples closer than `within` to one of the points, and says how many it marked. `covered` has a flag per
// sample; `near` says of each cell how many of the 27 about it are open, and holds kOpen where it is itself.
inline std::int64_t cover_samples(const SampleCells& cells, const double* points, std::int64_t count, double within,
                                  std::uint8_t* covered, std::uint8_t* near) {
    const double bound = within * within * (1.0 + 1e-9);  // The comparison below decides.
    const std::int64_t row = cells.size[2], plane = cells.size[1] * cells.size[2];
    std::int64_t marked = 0;
    for (const double* p = points; p != points + 3 * count; p += 3) {
        std::int64_t cell[3];
        bool inside = true;
        for (int axis = 0; axis < 3; ++axis) {
            const double at = (p[axis] - cells.low[axis]) * cells.per_metre;
            inside &= at >= 1.0 && at < static_cast<double>(cells.size[axis] - 1);
            cell[axis] = inside ? static_cast<std::int64_t>(at) : 0;
        }
        if (!inside || near[cell[0] * plane + cell[1] * row + cell[2]] == 0) continue;
        for (std::int64_t dx = -1; dx <= 1; ++dx) {
            for (std::int64_t dy = -1; dy <= 1; ++dy) {
                const std::int64_t column = (cell[0] + dx) * cells.size[1] + cell[1] + dy;
                std::uint8_t* about = near + column * row;
                if (!((about[cell[2] - 1] | about[cell[2]] | about[cell[2] + 1]) & kOpen)) continue;
                const std::int32_t* end = cells.level + cells.column_start[column + 1];
                const auto* from = std::lower_bound(cells.level + cells.column_start[column], end,
                                                    static_cast<std::int32_t>(cell[2] - 1));
                while (from != end && *from <= cell[2] + 1) {
                    // The samples of one cell.
                    const std::int32_t level = *from;
                    bool newly = false, left = false;
                    for (; from != end && *from == level; ++from) {
                        const std::int64_t i = from - cells.level;
                        if (covered[i]) continue;
                        const double* s = cells.samples + 3 * i;
                        const double x = s[0] - p[0], y = s[1] - p[1], z = s[2] - p[2];
                        const double square = x * x + y * y + z * z;
                        if (square < bound && std::sqrt(square) < within) {
                            covered[i] = 1, newly = true, ++marked;
                        } else {
                            left = true;
                        }
                    }
                    if (!newly || left) continue;
                    about[level] &= static_cast<std::uint8_t>(~kOpen);
                    for (std::int64_t i = -1; i <= 1; ++i) {
                        for (std::int64_t j = -1; j <= 1; ++j) {
                            for (std::int64_t k = -1; k <= 1; ++k) --about[i * plane + j * row + level + k];
                        }
                    }
                }
            }
        }
    }
    return marked;
}

}  // namespace anm
