// Distances of places to the nearest of many points, as anm_mj/evaluation/nearest.py has it, to the last bit: the same
// products and sums as a search of all points, so compile without fused ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace anm {

// A k-d tree of tight boxes, whose splits are read off the points' Morton codes: sorting those is quicker than parting
// the points again and again, and a tree serves one search. Rounding is monotone, so the computed distance to a box
// never exceeds the computed distance to a point in it, and what is left out is no nearer.
class PointTree {
public:
    // Of finite points, x y z each.
    PointTree(const double* points, std::int64_t count) {
        const auto n = static_cast<std::size_t>(count);
        std::vector<std::uint32_t> code(n), order(n);
        morton_order(points, code, order);
        for (int axis = 0; axis < 3; ++axis) {
            axis_[axis].resize(n);
            for (std::size_t i = 0; i < n; ++i) axis_[axis][i] = points[3 * order[i] + static_cast<std::size_t>(axis)];
        }
        nodes_.reserve(n / 2 + 1);
        if (n > 0) build(code.data(), 0, static_cast<std::uint32_t>(n));
    }

    // Lowers each distance to that of the nearest point, where that is less. Places in a row should be neighbours.
    void lower(const double* places, double* distance, std::int64_t count) const {
        if (axis_[0].empty()) return;
        std::size_t last = 0;
        for (std::int64_t i = 0; i < count; ++i) {
            const double* p = places + 3 * i;
            // The distance may have been rounded down: a point at the bound must not be missed.
            const double bound = distance[i] * distance[i] * kSlack;
            if (to_box(nodes_.front().box, p) > bound) continue;
            // The last place's nearest point is likely to be near to this one.
            double best = std::min(bound, squared(p, last));
            last = search(p, best, last);
            distance[i] = std::min(distance[i], std::sqrt(best));
        }
    }

private:
    static constexpr std::uint32_t kLeaf = 12;
    static constexpr int kMaxDepth = 64;  // 30 bits of a code, and what halves the points of one code
    static constexpr double kSlack = 1.0 + 1e-9;
    static constexpr int kBits = 10;  // of each axis in a Morton code

    struct Box {
        double low[3] = {kInfinity, kInfinity, kInfinity}, high[3] = {-kInfinity, -kInfinity, -kInfinity};

        void take(int axis, double from, double to) {
            low[axis] = std::min(low[axis], from);
            high[axis] = std::max(high[axis], to);
        }
        static constexpr double kInfinity = std::numeric_limits<double>::infinity();
    };
    struct Node {
        Box box;
        std::uint32_t begin, end;  // its points
        std::uint32_t right = 0;   // the left child follows its parent; 0: a leaf
    };
    struct Waiting {
        std::uint32_t node;
        double square;
    };

    static void morton_order(const double* points, std::vector<std::uint32_t>& code, std::vector<std::uint32_t>& order) {
        const std::size_t n = code.size();
        Box all;
        for (std::size_t i = 0; i < n; ++i) {
            for (int axis = 0; axis < 3; ++axis) all.take(axis, points[3 * i + axis], points[3 * i + axis]);
        }
        double edge = 0.0;
        for (int axis = 0; axis < 3 && n > 0; ++axis) edge = std::max(edge, all.high[axis] - all.low[axis]);
        const double cells = edge > 0.0 ? (1 << kBits) / edge : 0.0;
        for (std::size_t i = 0; i < n; ++i) {
            code[i] = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const double place = (points[3 * i + axis] - all.low[axis]) * cells;
                const double most = (1 << kBits) - 1;
                code[i] |= spread(static_cast<std::uint32_t>(std::min(std::max(0.0, place), most))) << axis;
            }
            order[i] = static_cast<std::uint32_t>(i);
        }
        std::vector<std::uint32_t> to_code(n), to_order(n);
        for (int shift = 0; shift < 3 * kBits; shift += kBits) {
            std::vector<std::uint32_t> next((1 << kBits) + 1);
            const auto digit = [=](std::uint32_t value) { return value >> shift & ((1U << kBits) - 1); };
            for (std::size_t i = 0; i < n; ++i) ++next[digit(code[i]) + 1];
            for (std::size_t k = 1; k < next.size(); ++k) next[k] += next[k - 1];
            for (std::size_t i = 0; i < n; ++i) {
                const std::uint32_t to = next[digit(code[i])]++;
                to_code[to] = code[i];
                to_order[to] = order[i];
            }
            code.swap(to_code);
            order.swap(to_order);
        }
    }

    std::uint32_t build(const std::uint32_t* code, std::uint32_t begin, std::uint32_t end) {
        const auto index = static_cast<std::uint32_t>(nodes_.size());
        nodes_.push_back({{}, begin, end});
        Box box;
        if (end - begin <= kLeaf) {
            for (int axis = 0; axis < 3; ++axis) {
                for (std::uint32_t i = begin; i < end; ++i) box.take(axis, axis_[axis][i], axis_[axis][i]);
            }
        } else {
            const std::uint32_t cut = split(code, begin, end);
            build(code, begin, cut);
            const std::uint32_t right = build(code, cut, end);
            nodes_[index].right = right;
            for (const std::uint32_t child : {index + 1, right}) {
                const Box& part = nodes_[child].box;
                for (int axis = 0; axis < 3; ++axis) box.take(axis, part.low[axis], part.high[axis]);
            }
        }
        nodes_[index].box = box;
        return index;
    }

    // Where the highest bit changes in which codes differ; the middle of points that have the same one.
    static std::uint32_t split(const std::uint32_t* code, std::uint32_t begin, std::uint32_t end) {
        std::uint32_t differ = code[begin] ^ code[end - 1];
        if (differ == 0) return begin + (end - begin) / 2;
        while ((differ & (differ - 1)) != 0) differ &= differ - 1;
        const auto* cut = std::partition_point(code + begin, code + end, [=](std::uint32_t c) { return (c & differ) == 0; });
        return static_cast<std::uint32_t>(cut - code);
    }

    // Two zeros between the bits.
    static std::uint32_t spread(std::uint32_t bits) {
        bits = (bits | bits << 16) & 0x030000FFU;
        bits = (bits | bits << 8) & 0x0300F00FU;
        bits = (bits | bits << 4) & 0x030C30C3U;
        return (bits | bits << 2) & 0x09249249U;
    }

    static double to_box(const Box& box, const double* p) {
        double square = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double off = std::max(0.0, std::max(box.low[axis] - p[axis], p[axis] - box.high[axis]));
            square += off * off;
        }
        return square;
    }

    double squared(const double* p, std::size_t i) const {
        const double dx = p[0] - axis_[0][i], dy = p[1] - axis_[1][i], dz = p[2] - axis_[2][i];
        return dx * dx + dy * dy + dz * dz;
    }

    // Lowers `best`, a squared distance, and returns the point that has it; `found` where none is nearer.
    std::size_t search(const double* p, double& best, std::size_t found) const {
        Waiting stack[kMaxDepth];
        int waiting = 0;
        std::uint32_t at = 0;
        for (;;) {
            const Node& node = nodes_[at];
            if (node.right == 0) {
                for (std::uint32_t i = node.begin; i < node.end; ++i) {
                    const double square = squared(p, i);
                    if (square < best) best = square, found = i;
                }
            } else {
                const double to_left = to_box(nodes_[at + 1].box, p), to_right = to_box(nodes_[node.right].box, p);
                const bool left_first = to_left <= to_right;
                const double nearer = left_first ? to_left : to_right, farther = left_first ? to_right : to_left;
                if (farther < best) stack[waiting++] = {left_first ? node.right : at + 1, farther};
                if (nearer < best) {
                    at = left_first ? at + 1 : node.right;
                    continue;
                }
            }
            while (waiting > 0 && !(stack[waiting - 1].square < best)) --waiting;
            if (waiting == 0) return found;
            at = stack[--waiting].node;
        }
    }

    std::vector<Node> nodes_;
    std::vector<double> axis_[3];
};

}  // namespace anm
