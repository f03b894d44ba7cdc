// What an occupancy grid says of points: whether surface is near, and whether it confirms or contradicts what a camera sees
// of them. The same bits everywhere: compile without fused products.
#pragma once

#include <cmath>
#include <cstdint>

#include "field_blocks.h"

namespace anm {

struct PointsGrid {
    const std::int8_t* state = nullptr;
    const std::int8_t* log_odds = nullptr;  // may be null where state_at() is not asked
    std::int64_t layers = 0, rows = 0, cols = 0;
    const std::int64_t* corner = nullptr;   // x, y, z index of the first voxel
    double voxel_m = 0.0;

    // Whether a voxel is occupied within `reach` (less than half an edge) of a place along every axis.
    bool near_occupied(const double* at, double reach) const {
        const std::int64_t count[3] = {cols, rows, layers}, stride[3] = {1, cols, rows * cols};
        std::int64_t offset[3][2];
        for (int axis = 0; axis < 3; ++axis) {
            for (int end = 0; end < 2; ++end) {
                const double voxel = std::rint((at[axis] + (end == 0 ? -reach : reach)) / voxel_m) - static_cast<double>(corner[axis]);
                // Comparisons with NaN are false.
                const bool inside = voxel >= 0.0 && voxel < static_cast<double>(count[axis]);
                offset[axis][end] = inside ? static_cast<std::int64_t>(voxel) * stride[axis] : -1;
            }
        }
        for (const std::int64_t x : offset[0]) {
            for (const std::int64_t y : offset[1]) {
                for (const std::int64_t z : offset[2]) {
                    if (x >= 0 && y >= 0 && z >= 0 && state[x + y + z] == kOccupiedState) return true;
                }
            }
        }
        return false;
    }

    // Of the voxel that holds a place; what moves and is taken for an obstacle counts as the free space that was seen.
    std::int8_t state_at(const double (&at)[3]) const {
        const std::int64_t count[3] = {cols, rows, layers}, stride[3] = {1, cols, rows * cols};
        std::int64_t offset = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double voxel = std::rint(at[axis] / voxel_m) - static_cast<double>(corner[axis]);
            if (!(voxel >= 0.0 && voxel < static_cast<double>(count[axis]))) return kUnknownState;
            offset += static_cast<std::int64_t>(voxel) * stride[axis];
        }
        return state[offset] == kOccupiedState && log_odds[offset] < 0 ? kFreeState : state[offset];
    }
};

// Whether a point that a camera sees is confirmed by the grid (beside an occupied voxel, with nothing in between), or
// contradicted (in free space, or behind an occupied voxel).
inline void agreement(const PointsGrid& grid, const double (&origin)[3], const double* at, double reach, const double* shares,
                      std::int64_t num_shares, double margin, std::uint8_t& confirmed, std::uint8_t& contradicted) {
    const bool near = grid.near_occupied(at, reach);
    const double ray[3] = {at[0] - origin[0], at[1] - origin[1], at[2] - origin[2]};
    const double length = std::sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
    bool blocked = false;
    for (std::int64_t k = 0; k < num_shares && !blocked; ++k) {
        if (!((1.0 - shares[k]) * length > margin)) continue;
        const double place[3] = {origin[0] + shares[k] * ray[0], origin[1] + shares[k] * ray[1], origin[2] + shares[k] * ray[2]};
        blocked = grid.state_at(place) == kOccupiedState;
    }
    const double end[3] = {at[0], at[1], at[2]};
    confirmed = near && !blocked;
    contradicted = blocked || (!near && grid.state_at(end) == kFreeState);
}

}  // namespace anm
