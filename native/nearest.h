// Distances of places to the nearest of many points, as anm_mj/ground_truth/nearest.py has it, to the last bit: the same
// products and sums as a search of all points, so compile without fused ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "box_tree.h"

namespace anm {

// Rounding is monotone, so the computed distance to a box never exceeds the computed distance to a point in it, and what
// is left out is no nearer. A tree serves one search.
class PointTree {
public:
    // Of finite points, x y z each.
    PointTree(const double* points, std::int64_t count) : tree_(sorted(points, static_cast<std::size_t>(count))) {}

    // Lowers each distance to that of the nearest point, where that is less. Places in a row should be neighbours.
    void lower(const double* places, double* distance, std::int64_t count) const {
        if (tree_.empty()) return;
        std::size_t last = 0;
        for (std::int64_t i = 0; i < count; ++i) {
            const double* p = places + 3 * i;
            // The distance may have been rounded down: a point at the bound must not be missed.
            const double bound = distance[i] * distance[i] * kSlack;
            if (squared_to_box(tree_.box(), p) > bound) continue;
            // The last place's nearest point is likely to be near to this one.
            double best = std::min(bound, squared(p, last));
            tree_.search(p, best, [&](std::uint32_t begin, std::uint32_t end) {
                for (std::uint32_t k = begin; k < end; ++k) {
                    const double square = squared(p, k);
                    if (square < best) best = square, last = k;
                }
            });
            distance[i] = std::min(distance[i], std::sqrt(best));
        }
    }

private:
    static constexpr std::uint32_t kLeaf = 12;
    static constexpr double kSlack = 1.0 + 1e-9;

    BoxTree sorted(const double* points, std::size_t n) {
        std::vector<std::uint32_t> code(n), order(n);
        morton_order(points, code, order);
        for (int axis = 0; axis < 3; ++axis) {
            axis_[axis].resize(n);
            for (std::size_t i = 0; i < n; ++i) axis_[axis][i] = points[3 * order[i] + static_cast<std::size_t>(axis)];
        }
        return {code, kLeaf, [this](std::uint32_t i) {
                    Box box;
                    for (int axis = 0; axis < 3; ++axis) box.take(axis, axis_[axis][i], axis_[axis][i]);
                    return box;
                }};
    }

    double squared(const double* p, std::size_t i) const {
        const double dx = p[0] - axis_[0][i], dy = p[1] - axis_[1][i], dz = p[2] - axis_[2][i];
        return dx * dx + dy * dy + dz * dz;
    }

    std::vector<double> axis_[3];  // before the tree, which is made from it
    BoxTree tree_;
};

}  // namespace anm
