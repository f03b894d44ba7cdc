// Which pixels of a depth image show what was not there before.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "occupancy.h"
#include "tasks.h"

namespace anm {

struct MovedSettings {
    float edge = 0.0F;      // of a voxel
    float noise = 0.0F;     // by this times its square depth may be wrong
    float doubt = 0.0F;     // by this, too: the position
    float turn = 0.0F;      // and by this times its depth: the rotation
    float range = 0.0F;     // farther pixels are not looked at
    int free = 0;           // log-odds of a voxel that is surely free, or less
    int known = 0;          // of one that surely holds surface, or more
    int support = 0;        // neighbours that a pixel needs
    float reach_m = 0.0F;   // what hangs together with such pixels belongs to them, up to this far along the image
    float focal_px = 1.0F;
    float apart_m = 0.0F;   // neighbours hang together whose depths differ by less, or by less than
    float apart_share = 0.0F;  // this share
};

constexpr int kBorder = 2;  // pixels
constexpr int kTasks = 32;

class MovedPixels {
public:
    MovedPixels(const Voxels& voxels, const float* depth, const float* rays, int height, int width, const float* matrix,
                const float* offset, const MovedSettings& settings)
        : v_(voxels), depth_(depth), rays_(rays), height_(height), width_(width), matrix_(matrix), offset_(offset), s_(settings) {}

    // out: [height][width], 1 for moved pixels. Returns how many there are.
    std::int64_t find(std::uint8_t* out, const Parallel& parallel) const {
        std::vector<std::uint8_t> seed(static_cast<std::size_t>(height_) * static_cast<std::size_t>(width_), 0);
        std::uint8_t found[kTasks] = {};
        run_tasks(parallel, kTasks, [&](int task, int) {
            for (int pixel = height_ * task / kTasks * width_; pixel < height_ * (task + 1) / kTasks * width_; ++pixel) {
                out[pixel] = 0;
                if (contradicts(pixel)) seed[static_cast<std::size_t>(pixel)] = found[task] = 1;
            }
        });
        if (std::find(found, found + kTasks, 1) == found + kTasks) return 0;
        // Breadth first, so that each pixel is reached by a shortest way.
        std::vector<std::pair<int, float>> queue;
        for (int row = 1; row + 1 < height_; ++row) {
            for (int col = 1; col + 1 < width_; ++col) {
                const int pixel = row * width_ + col;
                if (!seed[static_cast<std::size_t>(pixel)]) continue;
                int beside = -1;
                for (int r = -1; r <= 1; ++r) {
                    for (int c = -1; c <= 1; ++c) beside += seed[static_cast<std::size_t>(pixel + r * width_ + c)];
                }
                if (beside < s_.support) continue;
                out[pixel] = 1;
                queue.emplace_back(pixel, 0.0F);
            }
        }
        for (std::size_t next = 0; next < queue.size(); ++next) grow(next, queue, out);
        const std::size_t inner = queue.size();
        for (std::size_t next = 0; next < inner; ++next) border(queue[next].first, queue, out);
        for (std::size_t next = inner; next < queue.size(); ++next) out[queue[next].first] = 1;
        return static_cast<std::int64_t>(queue.size());
    }

private:
    // Whether a pixel lies in surely free space, and so does all of it that its depth may be too short by.
    bool contradicts(int pixel) const {
        const float z = depth_[pixel];
        if (!(z > 0.0F && z <= s_.range) || odds(pixel, z) > s_.free) return false;
        const float turned = s_.turn * z;
        const float end = z + s_.noise * z * z + std::sqrt(s_.doubt * s_.doubt + turned * turned);
        for (float behind = z + s_.edge; behind < end + s_.edge; behind += s_.edge) {
            if (odds(pixel, behind < end ? behind : end) > s_.free) return false;
        }
        return true;
    }

    void grow(std::size_t from, std::vector<std::pair<int, float>>& queue, std::uint8_t* out) const {
        const auto [pixel, so_far] = queue[from];
        const float z = depth_[pixel], reached = so_far + z / s_.focal_px;
        if (reached > s_.reach_m) return;
        const int row = pixel / width_, col = pixel % width_;
        const int beside[4][2] = {{row - 1, col}, {row + 1, col}, {row, col - 1}, {row, col + 1}};
        for (const auto& place : beside) {
            if (place[0] < 0 || place[0] >= height_ || place[1] < 0 || place[1] >= width_) continue;
            const int other = place[0] * width_ + place[1];
            const float depth = depth_[other];
            if (out[other] || !(depth > 0.0F && depth <= s_.range)) continue;
            const float apart = depth > z ? depth - z : z - depth;
            if (apart > s_.apart_m && apart > s_.apart_share * z) continue;
            if (odds(other, depth) >= s_.known) continue;
            out[other] = 1;
            queue.emplace_back(other, reached);
        }
    }

    // The image's edge of what moved belongs to it where the grid knows no surface: single voxels would be left of it.
    void border(int pixel, std::vector<std::pair<int, float>>& queue, std::uint8_t* out) const {
        const int row = pixel / width_, col = pixel % width_;
        const auto inner = [&](int r, int c) { return r < 0 || r >= height_ || c < 0 || c >= width_ || out[r * width_ + c] == 1; };
        if (inner(row - 1, col) && inner(row + 1, col) && inner(row, col - 1) && inner(row, col + 1)) return;
        for (int r = row > kBorder ? row - kBorder : 0; r <= row + kBorder && r < height_; ++r) {
            for (int c = col > kBorder ? col - kBorder : 0; c <= col + kBorder && c < width_; ++c) {
                const int other = r * width_ + c;
                const float depth = depth_[other];
                if (out[other] || !(depth > 0.0F && depth <= s_.range) || odds(other, depth) >= s_.known) continue;
                out[other] = 2;
                queue.emplace_back(other, 0.0F);
            }
        }
    }

    // Log-odds at a depth along a pixel's ray; 0 outside of the grid.
    int odds(int pixel, float depth) const {
        const float* ray = rays_ + 3 * static_cast<std::ptrdiff_t>(pixel);
        std::int64_t at[3];
        for (int k = 0; k < 3; ++k) {
            const float scaled = ray[0] * depth * matrix_[k] + ray[1] * depth * matrix_[3 + k] + ray[2] * depth * matrix_[6 + k] + offset_[k];
            at[k] = static_cast<std::int64_t>(__builtin_rintf(scaled)) - v_.corner[k];
        }
        if (at[0] < 0 || at[0] >= v_.cols || at[1] < 0 || at[1] >= v_.rows || at[2] < 0 || at[2] >= v_.layers) return 0;
        return v_.log_odds[(at[2] * v_.rows + at[1]) * v_.cols + at[0]];
    }

    const Voxels& v_;
    const float* depth_;
    const float* rays_;
    int height_, width_;
    const float* matrix_;
    const float* offset_;
    const MovedSettings& s_;
};

// What is left of things that have gone: in columns, three by three, most of which was hit once and was looked through
// since, what was not looked through has gone, too. Low parts of somebody who stood there lie out of the camera's view.
class LeftVoxels {
public:
    LeftVoxels(const Voxels& voxels, const std::uint8_t* heavy, int low, int high, int miss, std::int32_t frame)
        : v_(voxels), heavy_(heavy), low_(low < 0 ? 0 : low), high_(high < v_.layers ? high : static_cast<int>(v_.layers)), miss_(miss), frame_(frame) {}

    // Frees them in the blocks that `heavy` names and this frame changed; returns how many there were.
    std::int64_t free() {
        const std::int64_t block_rows = v_.rows >> kBlockShift, block_cols = v_.cols >> kBlockShift;
        std::int64_t count = 0;
        for (std::int64_t row = 0; row < block_rows; ++row) {
            for (std::int64_t col = 0; col < block_cols; ++col) {
                const std::int64_t block = row * block_cols + col;
                if (heavy_[block] && v_.column_version[block] == frame_) count += free_block(row << kBlockShift, col << kBlockShift);
            }
        }
        return count;
    }

private:
    static constexpr int kSide = (1 << kBlockShift) + 2;
    static constexpr int kLeast = 6, kShare = 2;

    bool is_left(std::int64_t i) const { return v_.state[i] == 1 && v_.log_odds[i] >= 0; }
    bool is_gone(std::int64_t i) const { return v_.num_hits[i] != 0 && v_.log_odds[i] < 0; }

    std::int64_t free_block(std::int64_t first_row, std::int64_t first_col) {
        int gone[kSide][kSide] = {}, left[kSide][kSide] = {};
        bool any = false;
        visit(first_row - 1, first_col - 1, kSide, [&](int r, int c, std::int64_t i) {
            gone[r][c] += is_gone(i);
            left[r][c] += is_left(i);
            any |= v_.state[i] == 1;
        });
        if (!any) return 0;
        std::int64_t count = 0;
        visit(first_row, first_col, kSide - 2, [&](int r, int c, std::int64_t i) {
            if (left[r + 1][c + 1] == 0) return;
            int went = 0, stays = 0;
            for (int dr = 0; dr < 3; ++dr) {
                for (int dc = 0; dc < 3; ++dc) went += gone[r + dr][c + dc], stays += left[r + dr][c + dc];
            }
            if (went < kLeast || went < kShare * stays || !is_left(i)) return;
            v_.log_odds[i] = static_cast<std::int8_t>(-miss_);
            v_.state[i] = 0;
            v_.num_hits[i] = 0;
            ++count;
        });
        return count;
    }

    // Calls with row and column from 0, and the voxel's index, layer by layer.
    template <class Call>
    void visit(std::int64_t first_row, std::int64_t first_col, int side, const Call& call) const {
        for (std::int64_t z = low_; z < high_; ++z) {
            for (int r = 0; r < side; ++r) {
                if (first_row + r < 0 || first_row + r >= v_.rows) continue;
                for (int c = 0; c < side; ++c) {
                    if (first_col + c >= 0 && first_col + c < v_.cols) call(r, c, (z * v_.rows + first_row + r) * v_.cols + first_col + c);
                }
            }
        }
    }

    const Voxels& v_;
    const std::uint8_t* heavy_;
    int low_, high_, miss_;
    std::int32_t frame_;
};

}  // namespace anm
