// Rays through the cells of the information gain, as anm_mj/planning/policies/gvg/ray_casting.py has it.
#pragma once

#include <algorithm>
#include <cstdint>

#include "field_blocks.h"

namespace anm {

// Rays of places, [row][ray]; see Rays in anm_mj/planning/policies/gvg/ray_casting.py.
struct RayRows {
    std::int32_t* hit;
    std::int8_t* state;
    std::uint8_t *sample, *depth;
    std::int64_t num_rays, num_samples;
    const std::int64_t* start;   // [row] cell that its rays start in
    const std::int64_t* offset;  // [ray][sample] from that cell
};

// Casts those rays of a row again whose cells have another state than they had. False where a ray leaves the cells.
inline bool cast_row(const std::int8_t* cells, std::int64_t num_cells, const RayRows& rays, std::int64_t row) {
    for (std::int64_t ray = 0; ray < rays.num_rays; ++ray) {
        const std::int64_t at = row * rays.num_rays + ray;
        if (rays.hit[at] < 0 || rays.hit[at] >= num_cells) return false;
        if (cells[rays.hit[at]] == rays.state[at]) continue;
        const std::int64_t* offset = rays.offset + ray * rays.num_samples;
        const auto cell_at = [&](std::int64_t sample) { return rays.start[row] + offset[sample]; };
        const auto inside = [&](std::int64_t sample) { return cell_at(sample) >= 0 && cell_at(sample) < num_cells; };
        std::int64_t first = 0;
        while (first < rays.num_samples && inside(first) && cells[cell_at(first)] == kFreeState) ++first;
        // A ray that meets nothing ends where it begins.
        if (first == rays.num_samples) first = 0;
        if (!inside(first)) return false;
        const std::int8_t state = cells[cell_at(first)];
        rays.hit[at] = static_cast<std::int32_t>(cell_at(first));
        rays.sample[at] = static_cast<std::uint8_t>(first);
        rays.state[at] = state;
        if (state != kUnknownState) continue;
        const std::int64_t last = rays.num_samples - 1;
        std::int64_t end = std::min(first + 1, last);
        while (end < last && inside(end) && cells[cell_at(end)] == kUnknownState) ++end;
        rays.depth[at] = static_cast<std::uint8_t>(end - first);
    }
    return true;
}

// What the gain of a ray into the unknown depends on, besides the ray.
struct GainRule {
    float cell, max_depth, range, suppressed_share, solid_angle;
};

// Expected new surface of rays; 0 where they do not end in the unknown.
inline void ray_gains(const std::int32_t* hit, const std::int8_t* state, const std::uint8_t* sample,
                      const std::uint8_t* depth, std::int64_t count, const float* distance, const float* layer_share,
                      std::int64_t cells_per_layer, const float* tried, const GainRule& rule, float* gain) {
    for (std::int64_t i = 0; i < count; ++i) {
        gain[i] = 0.0F;
        if (state[i] != kUnknownState) continue;
        const float here = distance[sample[i]];
        if (here >= rule.suppressed_share * tried[hit[i]]) continue;
        const float behind = std::min(static_cast<float>(depth[i]) * rule.cell, rule.max_depth);
        const float reach = std::min(here + behind, rule.range);
        gain[i] = reach * reach * layer_share[hit[i] / cells_per_layer] * rule.solid_angle;
    }
}

// Cells along rays that start at one place, given by their coordinates.
struct CellFrame {
    double origin[3], edge;  // of the array's outer corner, and of a cell
    double low_z, high_z;    // samples below and above count as these
    Extent size;

    // Index of the cell that holds a place; negative or too large outside.
    std::int64_t cell(double x, double y, double z) const {
        const auto along = [&](double place, int axis) {
            const double scaled = (place - origin[axis]) / edge;
            const auto whole = static_cast<std::int64_t>(scaled);
            return whole - (scaled < static_cast<double>(whole) ? 1 : 0);
        };
        return size.at(along(z, 2), along(y, 1), along(x, 0));
    }
};

// The first cell along each ray that is not free, and the number of its sample; -1 where all are. False where a ray
// leaves the cells.
inline bool first_closed(const std::int8_t* cells, const CellFrame& frame, const double* from, const double* direction,
                         std::int64_t num_rays, const double* distance, std::int64_t num_samples, std::int64_t* cell,
                         std::int64_t* sample) {
    const std::int64_t num_cells = frame.size.layers * frame.size.rows * frame.size.cols;
    for (std::int64_t ray = 0; ray < num_rays; ++ray) {
        const double* along = direction + 3 * ray;
        cell[ray] = sample[ray] = -1;
        for (std::int64_t s = 0; s < num_samples; ++s) {
            const double z = from[2] + along[2] * distance[s];
            const std::int64_t at = frame.cell(from[0] + along[0] * distance[s], from[1] + along[1] * distance[s],
                                               std::min(std::max(z, frame.low_z), frame.high_z));
            if (at < 0 || at >= num_cells) return false;
            if (cells[at] == kFreeState) continue;
            cell[ray] = at;
            sample[ray] = s;
            break;
        }
    }
    return true;
}

}  // namespace anm
