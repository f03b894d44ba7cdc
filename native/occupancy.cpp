// See occupancy.h.
#include "occupancy.h"

#include <cstring>

#include "simd.h"

#ifndef ANM_KERNEL
#define ANM_KERNEL generic
#endif
#define ANM_JOIN_(a, b) a##b
#define ANM_JOIN(a, b) ANM_JOIN_(a, b)

namespace {

using anm::Arena;
using anm::CarveSettings;
using anm::kBlockShift;
using anm::MarkSettings;
using anm::Parallel;
using anm::View;
using anm::Voxels;

constexpr int kLevels = 5;      // of the footprint pyramid, see footprint_minima()
constexpr int kRowTasks = 8;    // of an image
constexpr float kInfinity = __builtin_inff();

enum Key { kLimit, kPyramid, kRowShares, kSeen, kNumKeys };

template <class T>
T* buffer(const Arena& arena, int key, int worker, std::size_t count) {
    return static_cast<T*>(arena.get(arena.owner, key + worker * kNumKeys, count * sizeof(T)));
}

template <class Fn>
void run_tasks(const Parallel& parallel, int count, Fn&& fn) {
    struct Call {
        static void task(void* arg, int task, int worker) { (*static_cast<Fn*>(arg))(task, worker); }
    };
    parallel.run(parallel.pool, count, &Call::task, &fn);
}

// Room for a line of voxels, with a vector's width to spare.
inline int padded(std::int64_t count) { return static_cast<int>((count + 31) / 16 * 16); }

inline float least(float a, float b) { return b < a ? b : a; }

// Depth up to which each pixel vouches for free space.
void carve_limit(const View& view, bool no_depth_is_free, float* limit, const Parallel& parallel) {
    const int height = view.height, width = view.width;
    const auto own = [&](float depth) {
        return depth > 0.0F ? (!no_depth_is_free && depth == kInfinity ? 0.0F : depth) : kInfinity;
    };
    run_tasks(parallel, kRowTasks, [&](int task, int) {
        for (int row = height * task / kRowTasks; row < height * (task + 1) / kRowTasks; ++row) {
            const float* depth = view.depth + static_cast<std::ptrdiff_t>(row) * width;
            for (int col = 0; col < width; ++col) {
                float value = own(depth[col]);
                if (!(depth[col] > 0.0F)) {
                    // What was not measured belongs to the nearest of what was, beside it.
                    bool beside = false;
                    for (int r = row > 0 ? row - 1 : 0; r <= row + 1 && r < height; ++r) {
                        for (int c = col > 0 ? col - 1 : 0; c <= col + 1 && c < width; ++c) {
                            const float near = view.depth[static_cast<std::ptrdiff_t>(r) * width + c];
                            beside |= near > 0.0F;
                            value = least(value, own(near));
                        }
                    }
                    if (!beside) value = 0.0F;
                }
                limit[static_cast<std::ptrdiff_t>(row) * width + col] = value;
            }
        }
    });
}

// Smallest value within `shift` of each pixel, of those at -shift, 0 and shift along both axes.
void spread(const float* in, int height, int width, int shift, float* out, const Parallel& parallel, const Arena& arena) {
    run_tasks(parallel, kRowTasks, [&](int task, int worker) {
        float* line = buffer<float>(arena, kRowShares, worker, static_cast<std::size_t>(width));
        for (int row = height * task / kRowTasks; row < height * (task + 1) / kRowTasks; ++row) {
            const float* middle = in + static_cast<std::ptrdiff_t>(row) * width;
            const float* above = row >= shift ? middle - static_cast<std::ptrdiff_t>(shift) * width : middle;
            const float* below = row + shift < height ? middle + static_cast<std::ptrdiff_t>(shift) * width : middle;
            for (int col = 0; col < width; ++col) line[col] = least(least(middle[col], above[col]), below[col]);
            float* to = out + static_cast<std::ptrdiff_t>(row) * width;
            for (int col = 0; col < width; ++col) to[col] = line[col];
            for (int col = shift; col < width; ++col) to[col] = least(to[col], line[col - shift]);
            for (int col = 0; col < width - shift; ++col) to[col] = least(to[col], line[col + shift]);
        }
    });
}

// Narrows [first, last] to where a + b x > 0, give or take rounding and a voxel: what lies at the edge is tested one by
// one.
inline void narrow(double a, double b, double& first, double& last) {
    a += 0.01;
    if (b == 0.0) {
        if (a <= 0.0) last = first - 4.0;
        return;
    }
    const double root = -a / b;
    if (b > 0.0) {
        if (root - 1.5 > first) first = root - 1.5;
    } else {
        if (root + 1.5 < last) last = root + 1.5;
    }
}

struct CarveRow {
    const Voxels& voxels;
    const View& view;
    const CarveSettings& settings;
    const std::int64_t* low;
    const std::int64_t* high;
    const float* pyramid;

    void operator()(std::int64_t y, float* scratch) const {
        const int count = padded(high[0] - low[0] + 1);
        float* share[3] = {scratch, scratch + count, scratch + 2 * count};
        float* planar = scratch + 3 * count;
        int* index = reinterpret_cast<int*>(scratch + 4 * count);
        auto* changed = reinterpret_cast<std::int8_t*>(scratch + 5 * count);
        const float* R = view.rotation;
        const float away_y = static_cast<float>(y) * settings.edge - view.position[1];
        for (int k = 0; k < 3; ++k) {
            for (int i = 0; i < count; ++i) {
                const float away_x = static_cast<float>(low[0] + i) * settings.edge - view.position[0];
                share[k][i] = R[k] * away_x + R[3 + k] * away_y;
            }
        }
        const std::int64_t row = y - voxels.corner[1];
        const std::int64_t block_cols = voxels.cols >> kBlockShift;
        std::int32_t* versions = voxels.column_version + (row >> kBlockShift) * block_cols;
        for (std::int64_t z = low[2]; z <= high[2]; ++z) {
            const float away_z = static_cast<float>(z) * settings.edge - view.position[2];
            const float layer[3] = {R[6] * away_z, R[7] * away_z, R[8] * away_z};
            int first = 0, last = count;
            span(share, layer, static_cast<int>(high[0] - low[0] + 1), first, last);
            if (first >= last) continue;
            const std::int64_t start = ((z - voxels.corner[2]) * voxels.rows + row) * voxels.cols + low[0] - voxels.corner[0];
            if (z < high[2]) ask_for(start + voxels.rows * voxels.cols, first, last);
            project(share, layer, first, last, planar, index);
            const std::int64_t first_col = low[0] - voxels.corner[0];
            bool any = false;
            if (settings.heavy == nullptr) {
                any = lower(start, first, last, planar, index, changed, settings.miss);
            } else {
                // Neighbouring blocks with the same miss in one go: most lines have one only.
                const std::uint8_t* heavy = settings.heavy + (row >> kBlockShift) * block_cols;
                for (int from = first, to = first; from < last; from = to) {
                    std::int64_t block = (first_col + from) >> kBlockShift;
                    const bool is_heavy = heavy[block] != 0;
                    const std::int64_t last_block = (first_col + last - 1) >> kBlockShift;
                    while (block < last_block && (heavy[block + 1] != 0) == is_heavy) ++block;
                    const std::int64_t end = ((block + 1) << kBlockShift) - first_col;
                    to = end < last ? static_cast<int>(end) : last;
                    any |= lower(start, from, to, planar, index, changed, is_heavy ? settings.heavy_miss : settings.miss);
                }
            }
            if (!any) continue;
            for (int i = first; i < last; ++i) {
                // Several rows share a block, and all write the same.
                if (changed[i]) __atomic_store_n(versions + ((first_col + i) >> kBlockShift), settings.frame, __ATOMIC_RELAXED);
            }
        }
    }

    // Has the voxels brought near that are carved next: layers lie so far apart that the processor does not foresee them.
    void ask_for(std::int64_t start, int first, int last) const {
        constexpr int kLine = 64;
        for (int i = first;; i = i + kLine < last ? i + kLine : last - 1) {
            __builtin_prefetch(voxels.log_odds + start + i, 1);
            __builtin_prefetch(voxels.state + start + i, 1);
            if (i == last - 1) return;
        }
    }

    // Takes a miss from the voxels of a line that lie before the depth about them, and says whether any changed its
    // state.
    bool lower(std::int64_t start, int first, int last, const float* __restrict planar, int* __restrict index,
               std::int8_t* __restrict changed, int weight) const {
        for (int i = first; i < last; ++i) index[i] = planar[i] + settings.margin < pyramid[index[i]] ? -1 : 0;
        std::int8_t* __restrict log_odds = voxels.log_odds + start;
        std::int8_t* __restrict state = voxels.state + start;
        const auto miss = static_cast<std::int8_t>(weight);
        const auto floor = static_cast<std::int8_t>(weight - settings.limit);
        for (int i = first; i < last; ++i) changed[i] = static_cast<std::int8_t>(index[i]);
        std::int8_t any = 0;
        for (int i = first; i < last; ++i) {
            const std::int8_t front = changed[i], before = log_odds[i], old = state[i];
            const auto value = static_cast<std::int8_t>((before > floor ? before : floor) - miss);
            const std::int8_t carved = value > 0;
            log_odds[i] = static_cast<std::int8_t>((value & front) | (before & ~front));
            state[i] = static_cast<std::int8_t>((carved & front) | (old & ~front));
            changed[i] = static_cast<std::int8_t>((carved ^ old) & front);
            any |= changed[i];
        }
        return any != 0;
    }

    // Which voxels of a line may be in view.
    void span(float* const* share, const float* layer, int count, int& first, int& last) const {
        const float* R = view.rotation;
        const double slope[3] = {static_cast<double>(R[0]) * settings.edge, static_cast<double>(R[1]) * settings.edge,
                                 static_cast<double>(R[2]) * settings.edge};
        const double right = static_cast<double>(layer[0]) + share[0][0];
        const double down = static_cast<double>(layer[1]) + share[1][0];
        const double planar = static_cast<double>(layer[2]) + share[2][0];
        double from = 0.0, to = count - 1.0;
        narrow(planar - settings.nearest, slope[2], from, to);
        narrow(settings.furthest - planar, -slope[2], from, to);
        const double side[4] = {view.cx, view.width - static_cast<double>(view.cx), view.cy,
                                view.height - static_cast<double>(view.cy)};
        narrow(right * view.fx + side[0] * planar, slope[0] * view.fx + side[0] * slope[2], from, to);
        narrow(side[1] * planar - right * view.fx, side[1] * slope[2] - slope[0] * view.fx, from, to);
        narrow(down * view.fy + side[2] * planar, slope[1] * view.fy + side[2] * slope[2], from, to);
        narrow(side[3] * planar - down * view.fy, side[3] * slope[2] - slope[1] * view.fy, from, to);
        if (!(from <= to)) {
            last = first;
            return;
        }
        first = from <= 0.0 ? 0 : static_cast<int>(from);
        last = to >= count - 1.0 ? count : static_cast<int>(to) + 2;
        if (last > count) last = count;
    }

    // Depth of each voxel, and where in the pyramid the smallest depth of its footprint stands; at its end stands
    // nothing, for voxels out of view.
    void project(float* const* share, const float* layer, int first, int last, float* planar, int* index) const {
        const int width = view.width, pixels = view.width * view.height;
        const float right_end = static_cast<float>(view.width), down_end = static_cast<float>(view.height);
        // A line's arrays are padded, so whole vectors may be read and written beyond its end.
        for (int i = first; i < last; i += kLanes) {
            const F right = layer[0] + load(share[0] + i);
            const F down = layer[1] + load(share[1] + i);
            const F ahead = layer[2] + load(share[2] + i);
            const F u = right * (view.fx / ahead) + view.cx;
            const F v = down * (view.fy / ahead) + view.cy;
            const I seen = (ahead > settings.nearest) & (ahead < settings.furthest) & (u >= 0.0F) & (u < right_end) &
                           (v >= 0.0F) & (v < down_end);
            const F ratio = settings.footprint_px / ahead;
            I bits;
            std::memcpy(&bits, &ratio, sizeof bits);
            I level = ((bits >> 23) & 255) - 126;
            level = level < 0 ? I{} : level;
            level = level > kLevels - 1 ? I{} + (kLevels - 1) : level;
            const I column = to_int(seen ? u : F{});
            const I line = to_int(seen ? v : F{});
            const I place = seen ? level * pixels + line * width + column : I{} + kLevels * pixels;
            store(planar + i, ahead);
            std::memcpy(index + i, &place, sizeof place);
        }
    }
};

void carve(const Voxels& voxels, const View& view, const CarveSettings& settings, const std::int64_t* low,
           const std::int64_t* high, const Parallel& parallel, const Arena& arena) {
    for (int axis = 0; axis < 3; ++axis) {
        if (high[axis] < low[axis]) return;
    }
    const std::size_t pixels = static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height);
    const auto count = static_cast<std::size_t>(padded(high[0] - low[0] + 1));
    // Asked for here, because a worker must not make the owner's memory grow while another one asks.
    const auto width = static_cast<std::size_t>(view.width);
    const std::size_t scratch = 6 * count > width ? 6 * count : width;
    for (int worker = 0; worker < parallel.workers; ++worker) buffer<float>(arena, kRowShares, worker, scratch);
    float* limit = buffer<float>(arena, kLimit, 0, pixels);
    float* pyramid = buffer<float>(arena, kPyramid, 0, kLevels * pixels + 1);
    carve_limit(view, settings.no_depth_is_free, limit, parallel);
    spread(limit, view.height, view.width, 1, pyramid, parallel, arena);
    for (int level = 0; level + 1 < kLevels; ++level) {
        spread(pyramid + level * pixels, view.height, view.width, 1 << level, pyramid + (level + 1) * pixels, parallel,
               arena);
    }
    pyramid[kLevels * pixels] = -kInfinity;
    const CarveRow carve_row{voxels, view, settings, low, high, pyramid};
    run_tasks(parallel, static_cast<int>(high[1] - low[1] + 1), [&](int task, int worker) {
        carve_row(low[1] + task, buffer<float>(arena, kRowShares, worker, scratch));
    });
}

void mark(const Voxels& voxels, const std::int64_t* places, const float* depth, std::int64_t count,
          const MarkSettings& settings, const Arena& arena) {
    // A table of the voxels that this frame has hit: each gets its log-odds once.
    std::size_t size = 64;
    while (size < 2 * static_cast<std::size_t>(count)) size *= 2;
    std::int64_t* table = buffer<std::int64_t>(arena, kSeen, 0, size);
    std::memset(table, 0xFF, size * sizeof *table);
    const std::int64_t block_rows = voxels.rows >> kBlockShift, block_cols = voxels.cols >> kBlockShift;
    const auto flat_of = [&](std::int64_t col, std::int64_t row, std::int64_t layer) {
        return (layer * voxels.rows + row) * voxels.cols + col;
    };
    constexpr std::int64_t kAhead = 8;
    for (std::int64_t i = 0; i < count; ++i) {
        if (i + kAhead < count) {
            const std::int64_t* place = places + 3 * (i + kAhead);
            const std::int64_t next =
                flat_of(place[0] - voxels.corner[0], place[1] - voxels.corner[1], place[2] - voxels.corner[2]);
            __builtin_prefetch(voxels.seen_range + next, 1);
            __builtin_prefetch(voxels.num_hits + next, 1);
            __builtin_prefetch(voxels.log_odds + next, 1);
            __builtin_prefetch(voxels.state + next, 1);
        }
        const std::int64_t col = places[3 * i] - voxels.corner[0];
        const std::int64_t row = places[3 * i + 1] - voxels.corner[1];
        const std::int64_t layer = places[3 * i + 2] - voxels.corner[2];
        const std::int64_t flat = flat_of(col, row, layer);
        std::int32_t* version = voxels.column_version + (row >> kBlockShift) * block_cols + (col >> kBlockShift);
        float& seen = voxels.seen_range[flat];
        if (depth[i] < seen) {
            if (__builtin_ceilf(depth[i] / settings.range_step) < __builtin_ceilf(seen / settings.range_step)) {
                *version = settings.frame;
            }
            seen = depth[i];
        }
        if (voxels.num_hits[flat] != 0xFFFF) ++voxels.num_hits[flat];
        std::size_t slot = (static_cast<std::uint64_t>(flat) * 0x9E3779B97F4A7C15ULL >> 20) & (size - 1);
        while (table[slot] != -1 && table[slot] != flat) slot = (slot + 1) & (size - 1);
        if (table[slot] == flat) continue;
        table[slot] = flat;
        int value = voxels.log_odds[flat] + settings.hit;
        value = value > settings.limit ? settings.limit : value;
        voxels.log_odds[flat] = static_cast<std::int8_t>(value);
        const std::int8_t marked = value > 0;
        if (marked != voxels.state[flat]) {
            voxels.state[flat] = marked;
            *version = settings.frame;
        }
        voxels.block_stamp[((layer >> kBlockShift) * block_rows + (row >> kBlockShift)) * block_cols +
                           (col >> kBlockShift)] = settings.frame;
    }
}

// The voxel that a pixel shows.
inline void voxel_of(const float* ray, float depth, const float* matrix, const float* offset, std::int64_t* out) {
    const float point[3] = {ray[0] * depth, ray[1] * depth, ray[2] * depth};
    for (int k = 0; k < 3; ++k) {
        const float scaled = point[0] * matrix[k] + point[1] * matrix[3 + k] + point[2] * matrix[6 + k] + offset[k];
        out[k] = static_cast<std::int64_t>(__builtin_rintf(scaled));
    }
}

std::int64_t hits(const float* depth, const float* rays, int height, int width, int first_row, int first_col, int stride,
                  float range, const float* matrix, const float* offset, std::int64_t* voxels, float* hit_depth) {
    std::int64_t count = 0;
    for (int row = first_row; row < height; row += stride) {
        for (int col = first_col; col < width; col += stride) {
            const std::ptrdiff_t pixel = static_cast<std::ptrdiff_t>(row) * width + col;
            const float z = depth[pixel];
            if (!(z > 0.0F && z <= range)) continue;
            voxel_of(rays + 3 * pixel, z, matrix, offset, voxels + 3 * count);
            hit_depth[count++] = z;
        }
    }
    return count;
}

void counts(const Voxels& voxels, const float* depth, const float* rays, int height, int width, float range,
            const float* matrix, const float* offset, std::uint16_t* out, const Parallel& parallel) {
    run_tasks(parallel, kRowTasks, [&](int task, int) {
        const std::ptrdiff_t stop = static_cast<std::ptrdiff_t>(height * (task + 1) / kRowTasks) * width;
        for (std::ptrdiff_t pixel = static_cast<std::ptrdiff_t>(height * task / kRowTasks) * width; pixel < stop; ++pixel) {
            const float z = depth[pixel];
            out[pixel] = 0;
            if (!(z > 0.0F && z <= range)) continue;
            std::int64_t at[3];
            voxel_of(rays + 3 * pixel, z, matrix, offset, at);
            for (int axis = 0; axis < 3; ++axis) at[axis] -= voxels.corner[axis];
            if (at[0] < 0 || at[0] >= voxels.cols || at[1] < 0 || at[1] >= voxels.rows || at[2] < 0 || at[2] >= voxels.layers) {
                continue;
            }
            out[pixel] = voxels.num_hits[(at[2] * voxels.rows + at[1]) * voxels.cols + at[0]];
        }
    });
}

const anm::OccupancyKernel kKernel = {carve, mark, hits, counts};

}  // namespace

namespace anm {

const OccupancyKernel& ANM_JOIN(occupancy_, ANM_KERNEL)() { return kKernel; }

}  // namespace anm
