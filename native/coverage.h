// Which samples of a surface lie within a radius of a cloud of points, as anm_mj/environments/reward.py has it, to the
// last bit: the same products and sums as a search of all points, so compile without fused ones.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace anm {

// Points by the cell that they lie in, cells in a hash table.
class PointCells {
public:
    PointCells(const double* points, std::int64_t count, double cell) : cell_(cell) {
        const auto n = static_cast<std::size_t>(count);
        std::size_t slots = 64;
        while (slots < 2 * n) slots *= 2, ++bits_;
        keys_.assign(slots, kEmpty);
        start_.assign(slots + 1, 0);
        std::vector<std::int32_t> slot_of(n);
        for (std::size_t i = 0; i < n; ++i) {
            const double* p = points + 3 * i;
            const std::uint64_t wanted = key(index(p[0]), index(p[1]), index(p[2]));
            const std::size_t slot = find(wanted);
            keys_[slot] = wanted;
            ++start_[slot + 1];
            slot_of[i] = static_cast<std::int32_t>(slot);
        }
        for (std::size_t slot = 0; slot < slots; ++slot) start_[slot + 1] += start_[slot];
        std::vector<std::int32_t> next(start_.begin(), start_.end() - 1);
        sorted_.resize(3 * n);
        for (std::size_t i = 0; i < n; ++i) {
            const auto to = static_cast<std::size_t>(next[static_cast<std::size_t>(slot_of[i])]++);
            for (std::size_t axis = 0; axis < 3; ++axis) sorted_[3 * to + axis] = points[3 * i + axis];
        }
    }

    // Whether a point is nearer to `p` than the radius.
    bool any_within(const double* p, double radius) const {
        // Rounding must not hide a point at the bound.
        const double reach = radius * kSlack, square = reach * reach;
        std::int64_t low[3], high[3];
        for (int axis = 0; axis < 3; ++axis) {
            low[axis] = index(p[axis] - reach);
            high[axis] = index(p[axis] + reach);
        }
        for (std::int64_t x = low[0]; x <= high[0]; ++x) {
            for (std::int64_t y = low[1]; y <= high[1]; ++y) {
                for (std::int64_t z = low[2]; z <= high[2]; ++z) {
                    const std::size_t slot = find(key(x, y, z));
                    if (keys_[slot] == kEmpty) continue;
                    const double* end = sorted_.data() + 3 * static_cast<std::ptrdiff_t>(start_[slot + 1]);
                    for (const double* q = sorted_.data() + 3 * static_cast<std::ptrdiff_t>(start_[slot]); q < end; q += 3) {
                        const double dx = p[0] - q[0], dy = p[1] - q[1], dz = p[2] - q[2];
                        const double squared = dx * dx + dy * dy + dz * dz;
                        if (squared <= square && std::sqrt(squared) < radius) return true;
                    }
                }
            }
        }
        return false;
    }

private:
    static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};
    static constexpr double kSlack = 1.0 + 1e-9;

    std::int64_t index(double value) const { return static_cast<std::int64_t>(std::floor(value / cell_)); }

    // 21 bits an axis: places 2^21 cells apart share a cell, which costs time alone.
    static std::uint64_t key(std::int64_t x, std::int64_t y, std::int64_t z) {
        constexpr std::uint64_t kMask = (std::uint64_t{1} << 21) - 1;
        return (static_cast<std::uint64_t>(x) & kMask) << 42 | (static_cast<std::uint64_t>(y) & kMask) << 21 |
               (static_cast<std::uint64_t>(z) & kMask);
    }

    std::size_t find(std::uint64_t wanted) const {
        std::size_t slot = (wanted * 0x9E3779B97F4A7C15U) >> (64 - bits_);
        while (keys_[slot] != kEmpty && keys_[slot] != wanted) slot = (slot + 1) & (keys_.size() - 1);
        return slot;
    }

    double cell_;
    int bits_ = 6;
    std::vector<std::uint64_t> keys_;
    std::vector<std::int32_t> start_;
    std::vector<double> sorted_;
};

}  // namespace anm
