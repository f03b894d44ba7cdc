// Pixels of a depth image that no pixel beside them agrees with, for anm_mj/sensing/pixel_state.py. The same bits
// everywhere: compile without fused products.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace anm {

// Two measured pixels agree where their depths differ by at most `share` of the own one, or by `least`.
class Outliers {
public:
    Outliers(const float* depth, std::int64_t rows, std::int64_t cols, float share, float least)
        : depth_(depth), rows_(rows), cols_(cols), share_(share), least_(least) {}

    // Marks the measured pixels that fewer than `support` of their neighbours agree with.
    void mark(int support, std::uint8_t* out) const {
        std::vector<std::int32_t> lacking(static_cast<std::size_t>(cols_));
        for (std::int64_t row = 0; row < rows_; ++row) {
            // Next to all pixels have neighbours enough in their row.
            const float* own = depth_ + row * cols_;
            lacking[0] = lacks(own[0], 0, cols_ > 1 ? agrees(own[1], own[0]) : 0, support);
            for (std::int64_t col = 1; col < cols_ - 1; ++col) {
                const auto at = static_cast<std::size_t>(col);
                lacking[at] = lacks(own[col], agrees(own[col - 1], own[col]), agrees(own[col + 1], own[col]), support);
            }
            const std::int64_t last = cols_ - 1;
            if (last > 0) lacking.back() = lacks(own[last], agrees(own[last - 1], own[last]), 0, support);
            for (std::int64_t col = 0; col < cols_; ++col) {
                out[row * cols_ + col] = lacking[static_cast<std::size_t>(col)] && agreeing(row, col) < support;
            }
        }
    }

private:
    std::int32_t agrees(float beside, float own) const {
        // Comparisons with NaN are false, and nothing is near to infinity.
        const float limit = std::max(share_ * own, least_);
        return (std::fabs(beside - own) <= limit) & (beside > 0.0F);
    }

    static std::int32_t lacks(float own, std::int32_t left, std::int32_t right, int support) {
        return (own > 0.0F) & (own <= std::numeric_limits<float>::max()) & (left + right < support);
    }

    // How many of the eight neighbours agree.
    int agreeing(std::int64_t row, std::int64_t col) const {
        const float own = depth_[row * cols_ + col];
        int count = -1;  // it agrees with itself
        for (std::int64_t r = std::max<std::int64_t>(row - 1, 0); r <= std::min(row + 1, rows_ - 1); ++r) {
            for (std::int64_t c = std::max<std::int64_t>(col - 1, 0); c <= std::min(col + 1, cols_ - 1); ++c) {
                count += agrees(depth_[r * cols_ + c], own);
            }
        }
        return count;
    }

    const float* depth_;
    std::int64_t rows_, cols_;
    float share_, least_;
};

}  // namespace anm
