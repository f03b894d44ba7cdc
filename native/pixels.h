// Rays of stored pixels, as anm_mj/mapping/rays.py has them, to the last bit: compile without fused products.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace anm {

constexpr int kPixelBytes = 9;      // place in the image (4), colour (3), depth in units (2), in little-endian order
constexpr int kCameraNumbers = 17;  // width, fx, fy, cx, cy; three rows of camera to world

struct RayArrays {
    float* origin = nullptr;     // [count][3]
    float* direction = nullptr;  // [count][3]
    float* rgb = nullptr;        // [count][3]
    float* depth = nullptr;      // [count]
};

// The ray of a pixel that was seen by a camera.
inline void ray_of_pixel(const std::uint8_t* pixel, const float* camera, float depth_unit, float* origin,
                         float* direction, float* rgb, float* depth) {
    std::uint32_t index = 0;
    std::uint16_t units = 0;
    std::memcpy(&index, pixel, sizeof index);
    std::memcpy(&units, pixel + 7, sizeof units);
    const auto width = static_cast<std::uint32_t>(camera[0]);
    const std::uint32_t row = index / width, col = index % width;
    const auto x = static_cast<float>((col + 0.5 - static_cast<double>(camera[3])) / static_cast<double>(camera[1]));
    const auto y = static_cast<float>((row + 0.5 - static_cast<double>(camera[4])) / static_cast<double>(camera[2]));
    for (int axis = 0; axis < 3; ++axis) {
        const float* pose = camera + 5 + 4 * axis;
        direction[axis] = (pose[0] * x + pose[1] * y) + pose[2];
        origin[axis] = pose[3];
        rgb[axis] = static_cast<float>(pixel[4 + axis]) / 255.0F;
    }
    *depth = units == 0 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(units) * depth_unit;
}

// Batch after batch, the rays of `stored` pixels by their place and keyframe, and then `current` other rays.
inline void ray_batches(const std::uint8_t* pixels, const float* cameras, const std::int64_t* place,
                        const std::int64_t* keyframe, std::int64_t batches, std::int64_t stored, float depth_unit,
                        const RayArrays& others, std::int64_t current, const RayArrays& out) {
    std::int64_t to = 0;
    for (std::int64_t batch = 0; batch < batches; ++batch) {
        for (std::int64_t k = batch * stored; k < (batch + 1) * stored; ++k, ++to) {
            ray_of_pixel(pixels + place[k] * kPixelBytes, cameras + keyframe[k] * kCameraNumbers, depth_unit,
                         out.origin + 3 * to, out.direction + 3 * to, out.rgb + 3 * to, out.depth + to);
        }
        const auto bytes = static_cast<std::size_t>(current) * sizeof(float);
        const std::int64_t from = batch * current;
        std::memcpy(out.origin + 3 * to, others.origin + 3 * from, 3 * bytes);
        std::memcpy(out.direction + 3 * to, others.direction + 3 * from, 3 * bytes);
        std::memcpy(out.rgb + 3 * to, others.rgb + 3 * from, 3 * bytes);
        std::memcpy(out.depth + to, others.depth + from, bytes);
        to += current;
    }
}

}  // namespace anm
