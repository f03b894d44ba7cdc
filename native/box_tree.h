// Boxes about points and triangles, and the order that trees of them are read off: that of the Morton codes of places.
// Sorting those is quicker than parting the places again and again.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

namespace anm {

struct Box {
    double low[3] = {kInfinity, kInfinity, kInfinity}, high[3] = {-kInfinity, -kInfinity, -kInfinity};

    void take(int axis, double from, double to) {
        low[axis] = std::min(low[axis], from);
        high[axis] = std::max(high[axis], to);
    }
    void take(const Box& other) {
        for (int axis = 0; axis < 3; ++axis) take(axis, other.low[axis], other.high[axis]);
    }
    static constexpr double kInfinity = std::numeric_limits<double>::infinity();
};

// Squared distance from a place to the nearest point of a box; 0 within.
inline double squared_to_box(const Box& box, const double* p) {
    double square = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        const double off = std::max(0.0, std::max(box.low[axis] - p[axis], p[axis] - box.high[axis]));
        square += off * off;
    }
    return square;
}

constexpr int kMortonBits = 10;  // of each axis in a Morton code
constexpr int kMaxTreeDepth = 64;  // 30 bits of a code, and what halves the places of one code

// Two zeros between the bits.
inline std::uint32_t spread_bits(std::uint32_t bits) {
    bits = (bits | bits << 16) & 0x030000FFU;
    bits = (bits | bits << 8) & 0x0300F00FU;
    bits = (bits | bits << 4) & 0x030C30C3U;
    return (bits | bits << 2) & 0x09249249U;
}

// Sorts finite places, x y z each, by their codes: `order` holds which of them comes when, `code` its code.
inline void morton_order(const double* places, std::vector<std::uint32_t>& code, std::vector<std::uint32_t>& order) {
    const std::size_t n = code.size();
    Box all;
    for (std::size_t i = 0; i < n; ++i) {
        for (int axis = 0; axis < 3; ++axis) all.take(axis, places[3 * i + axis], places[3 * i + axis]);
    }
    double edge = 0.0;
    for (int axis = 0; axis < 3 && n > 0; ++axis) edge = std::max(edge, all.high[axis] - all.low[axis]);
    const double cells = edge > 0.0 ? (1 << kMortonBits) / edge : 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        code[i] = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double place = (places[3 * i + axis] - all.low[axis]) * cells;
            const double most = (1 << kMortonBits) - 1;
            code[i] |= spread_bits(static_cast<std::uint32_t>(std::min(std::max(0.0, place), most))) << axis;
        }
        order[i] = static_cast<std::uint32_t>(i);
    }
    std::vector<std::uint32_t> to_code(n), to_order(n);
    for (int shift = 0; shift < 3 * kMortonBits; shift += kMortonBits) {
        std::vector<std::uint32_t> next((1 << kMortonBits) + 1);
        const auto digit = [=](std::uint32_t value) { return value >> shift & ((1U << kMortonBits) - 1); };
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

// Where the highest bit changes in which sorted codes differ; the middle of places that have the same one.
inline std::uint32_t split_codes(const std::uint32_t* code, std::uint32_t begin, std::uint32_t end) {
    std::uint32_t differ = code[begin] ^ code[end - 1];
    if (differ == 0) return begin + (end - begin) / 2;
    while ((differ & (differ - 1)) != 0) differ &= differ - 1;
    const auto* cut = std::partition_point(code + begin, code + end, [=](std::uint32_t c) { return (c & differ) == 0; });
    return static_cast<std::uint32_t>(cut - code);
}

// A tree of tight boxes about items in the order of their codes; the left child of a node follows it.
class BoxTree {
public:
    struct Node {
        Box box;
        std::uint32_t begin, end;  // its items
        std::uint32_t right = 0;   // 0: a leaf
    };

    // `box_of(i)` is the box of item i in that order.
    template <class BoxOf>
    BoxTree(const std::vector<std::uint32_t>& code, std::uint32_t leaf, const BoxOf& box_of) {
        const std::size_t n = code.size();
        nodes_.reserve(n / 2 + 1);
        if (n > 0) build(code.data(), 0, static_cast<std::uint32_t>(n), leaf, box_of);
    }

    bool empty() const { return nodes_.empty(); }
    const Box& box() const { return nodes_.front().box; }

    // Goes through the items that may lie nearer to `p` than the square `best`, near ones first; `look(begin, end)` may
    // lower it.
    template <class Look>
    void search(const double* p, const double& best, const Look& look) const {
        struct Waiting {
            std::uint32_t node;
            double square;
        };
        Waiting stack[kMaxTreeDepth];
        int waiting = 0;
        std::uint32_t at = 0;
        for (;;) {
            const Node& node = nodes_[at];
            if (node.right == 0) {
                look(node.begin, node.end);
            } else {
                const double to_left = squared_to_box(nodes_[at + 1].box, p);
                const double to_right = squared_to_box(nodes_[node.right].box, p);
                const bool left_first = to_left <= to_right;
                const double nearer = left_first ? to_left : to_right, farther = left_first ? to_right : to_left;
                if (farther < best) stack[waiting++] = {left_first ? node.right : at + 1, farther};
                if (nearer < best) {
                    at = left_first ? at + 1 : node.right;
                    continue;
                }
            }
            while (waiting > 0 && !(stack[waiting - 1].square < best)) --waiting;
            if (waiting == 0) return;
            at = stack[--waiting].node;
        }
    }

private:
    template <class BoxOf>
    std::uint32_t build(const std::uint32_t* code, std::uint32_t begin, std::uint32_t end, std::uint32_t leaf,
                        const BoxOf& box_of) {
        const auto index = static_cast<std::uint32_t>(nodes_.size());
        nodes_.push_back({{}, begin, end});
        Box box;
        if (end - begin <= leaf) {
            for (std::uint32_t i = begin; i < end; ++i) box.take(box_of(i));
        } else {
            const std::uint32_t cut = split_codes(code, begin, end);
            build(code, begin, cut, leaf, box_of);
            const std::uint32_t right = build(code, cut, end, leaf, box_of);
            nodes_[index].right = right;
            box.take(nodes_[index + 1].box);
            box.take(nodes_[right].box);
        }
        nodes_[index].box = box;
        return index;
    }

    std::vector<Node> nodes_;
};

}  // namespace anm
