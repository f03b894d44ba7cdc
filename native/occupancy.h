// The occupancy grid's kernels, as anm_mj/mapping/occupancy_fusion.py has them, to the last bit. One translation unit,
// compiled once per instruction set; see kernel.h for what that forbids. Every product is rounded before it is added
// to, in all of them, so that they agree.
#pragma once

#include "kernel.h"

namespace anm {

constexpr int kBlockShift = 4;  // 16 voxels along the edge of a block

// The grid's arrays, [layer][row][col]; blocks likewise.
struct Voxels {
    std::int8_t* log_odds = nullptr;
    std::int8_t* state = nullptr;
    float* seen_range = nullptr;
    std::uint16_t* num_hits = nullptr;
    std::int32_t* block_stamp = nullptr;     // [block layer][block row][block col]
    std::int32_t* column_version = nullptr;  // [block row][block col]
    std::int64_t corner[3] = {0, 0, 0};      // x, y, z
    std::int64_t layers = 0, rows = 0, cols = 0;
};

struct View {
    const float* depth = nullptr;  // [height][width]
    int width = 0, height = 0;
    float fx = 0.0F, fy = 0.0F, cx = 0.0F, cy = 0.0F;
    float rotation[9] = {};  // camera to world, row by row
    float position[3] = {};
};

struct CarveSettings {
    float edge = 0.0F;          // of a voxel
    float margin = 0.0F;        // by which a voxel must lie before the depth about it
    float footprint_px = 0.0F;  // half width of a voxel's footprint at a depth of one metre
    float nearest = 0.0F, furthest = 0.0F;
    int miss = 0, limit = 0;
    bool no_depth_is_free = true;
    std::int32_t frame = 0;
    const std::uint8_t* heavy = nullptr;  // [block row][block col]: where a miss counts more; null for nowhere
    int heavy_miss = 0;
};

struct MarkSettings {
    float range_step = 1.0F;
    int hit = 0, limit = 0;
    std::int32_t frame = 0;
};

struct OccupancyKernel {
    // low, high: x, y, z of the box that is carved, both included, within the grid.
    void (*carve)(const Voxels&, const View&, const CarveSettings&, const std::int64_t* low, const std::int64_t* high,
                  const Parallel&, const Arena&);
    // voxels: [count][3] as x, y, z, within the grid.
    void (*mark)(const Voxels&, const std::int64_t* voxels, const float* depth, std::int64_t count, const MarkSettings&,
                 const Arena&);
    // Points in voxel edges: ray times depth, by a matrix [3][3] and an offset; whether a pixel is one of those between
    // 0 and `range` is told by its place in the output, which is dense. Returns how many.
    std::int64_t (*hits)(const float* depth, const float* rays, int height, int width, int first_row, int first_col,
                         int stride, float range, const float* matrix, const float* offset, std::int64_t* voxels,
                         float* hit_depth);
    void (*counts)(const Voxels&, const float* depth, const float* rays, int height, int width, float range,
                   const float* matrix, const float* offset, std::uint16_t* out, const Parallel&);
};

#ifdef ANM_X86
const OccupancyKernel& occupancy_v2();
const OccupancyKernel& occupancy_v3();
const OccupancyKernel& occupancy_v4();
#else
const OccupancyKernel& occupancy_generic();
#endif

}  // namespace anm
