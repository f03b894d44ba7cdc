// Maps and graphs of the plane: distances as anm_mj/planning/distance_transform.py has them, holes as
// anm_mj/planning/enclosed_holes.py has them, components as anm_mj/geometry/connected_components.py has them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace anm {

// Compiled for newer processors as well, where the compiler can choose between the two when the module is loaded.
#if defined(ANM_X86) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__)
#define ANM_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ANM_CLONES
#endif

constexpr int kLargestCap = 181;  // the sum of two squares up to this fits into 16 bits

constexpr std::int64_t kAtOnce = 32;  // cells of a row that are looked at together

// Lowers squares to others plus a number.
inline __attribute__((always_inline)) void lower(const std::uint16_t* line, std::uint16_t square, std::int64_t count, std::uint16_t* nearest) {
    for (std::int64_t c = 0; c < count; ++c) {
        nearest[c] = std::min(nearest[c], static_cast<std::uint16_t>(line[c] + square));
    }
}

inline __attribute__((always_inline)) std::uint16_t largest_of(const std::uint16_t* values, std::int64_t count) {
    std::uint16_t largest = 0;
    for (std::int64_t c = 0; c < count; ++c) largest = std::max(largest, values[c]);
    return largest;
}

// Distance of each cell to the nearest one that is not free, up to the cap; see the reference. [row][col]
ANM_CLONES inline void capped_distances(const std::uint8_t* free, std::int64_t rows, std::int64_t cols, int cap, float* out) {
    const auto width = static_cast<std::size_t>(cols);
    std::vector<std::uint16_t> squared(static_cast<std::size_t>(rows) * width), nearest(width);
    for (std::int64_t r = 0; r < rows; ++r) {
        std::uint16_t* line = squared.data() + r * cols;
        int away = cap;
        for (std::int64_t c = 0; c < cols; ++c) {
            away = free[r * cols + c] ? std::min(away + 1, cap) : 0;
            line[c] = static_cast<std::uint16_t>(away);
        }
        away = cap;
        for (std::int64_t c = cols - 1; c >= 0; --c) {
            away = std::min<int>(line[c], away + 1);
            line[c] = static_cast<std::uint16_t>(away * away);
        }
    }
    for (std::int64_t r = 0; r < rows; ++r) {
        for (std::int64_t begin = 0; begin < cols; begin += kAtOnce) {
            const std::int64_t end = std::min(begin + kAtOnce, cols);
            std::copy(squared.begin() + r * cols + begin, squared.begin() + r * cols + end, nearest.begin() + begin);
            // No row farther away than the largest distance so far brings anything.
            int largest = largest_of(nearest.data() + begin, end - begin);
            for (std::int64_t d = 1; d < cap && d * d < largest; ++d) {
                const auto square = static_cast<std::uint16_t>(d * d);
                for (const std::int64_t other : {r - d, r + d}) {
                    if (other < 0 || other >= rows) continue;
                    lower(squared.data() + other * cols + begin, square, end - begin, nearest.data() + begin);
                }
                if (d % 4 == 0) largest = largest_of(nearest.data() + begin, end - begin);
            }
        }
        for (std::size_t c = 0; c < width; ++c) out[r * cols + c] = std::sqrt(static_cast<float>(nearest[c]));
    }
}

// Marks the components of a mask, by common sides, with no more cells than `most`. [row][col]
inline void small_components(const std::uint8_t* mask, std::int64_t rows, std::int64_t cols, double most,
                             std::uint8_t* out) {
    struct Run {
        std::int64_t row, begin, end;
    };
    std::vector<Run> runs;
    std::vector<std::int64_t> parent, size;
    const auto root = [&](std::int64_t i) {
        while (parent[i] != i) i = parent[i] = parent[parent[i]];
        return i;
    };
    std::size_t above = 0;  // the first run of the row above that may touch the next one
    for (std::int64_t r = 0; r < rows; ++r) {
        const std::uint8_t* line = mask + r * cols;
        for (std::int64_t c = 0; c < cols;) {
            if (line[c] == 0) {
                ++c;
                continue;
            }
            std::int64_t end = c + 1;
            while (end < cols && line[end] != 0) ++end;
            const auto mine = static_cast<std::int64_t>(runs.size());
            runs.push_back({r, c, end});
            parent.push_back(mine);
            size.push_back(end - c);
            while (above < runs.size() && (runs[above].row < r - 1 || (runs[above].row == r - 1 && runs[above].end <= c))) {
                ++above;
            }
            for (std::size_t k = above; k < runs.size() && runs[k].row == r - 1 && runs[k].begin < end; ++k) {
                const std::int64_t a = root(static_cast<std::int64_t>(k)), b = root(mine);
                if (a == b) continue;
                parent[b] = a;
                size[a] += size[b];
            }
            c = end;
        }
    }
    for (std::size_t k = 0; k < runs.size(); ++k) {
        if (static_cast<double>(size[root(static_cast<std::int64_t>(k))]) > most) continue;
        std::fill(out + runs[k].row * cols + runs[k].begin, out + runs[k].row * cols + runs[k].end, std::uint8_t{1});
    }
}

// The component of each node, numbered in the order of their first nodes. Links lie within.
inline void connected_components(const std::int64_t* links, std::int64_t num_links, std::int64_t num,
                                 std::int64_t* component) {
    for (std::int64_t i = 0; i < num; ++i) component[i] = i;
    const auto root = [&](std::int64_t i) {
        while (component[i] != i) i = component[i] = component[component[i]];
        return i;
    };
    for (std::int64_t k = 0; k < num_links; ++k) {
        const std::int64_t a = root(links[2 * k]), b = root(links[2 * k + 1]);
        // The first node of a component is its root.
        component[std::max(a, b)] = std::min(a, b);
    }
    std::int64_t found = 0;
    for (std::int64_t i = 0; i < num; ++i) {
        // A node's parent comes before it and has its number already.
        component[i] = component[i] == i ? found++ : component[component[i]];
    }
}

}  // namespace anm
