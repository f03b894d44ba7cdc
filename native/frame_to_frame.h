// Registration of a frame to an earlier one: normal equations of point-to-plane distances and grey values, where each
// point falls into the other image. It needs no map: sharp where the two overlap, blind elsewhere.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "kernel.h"

namespace anm {

// A number of 16 bits (IEEE 754); what is not finite becomes at least 65536.
inline float from_half(std::uint16_t bits) {
    const std::uint32_t shifted = static_cast<std::uint32_t>(bits & 0x7FFFU) << 13;
    float size;
    std::memcpy(&size, &shifted, sizeof size);
    size *= 0x1p112F;
    return (bits & 0x8000U) != 0U ? -size : size;
}

// An earlier frame: planar depth (not finite, or 0, where nothing was measured; negative where it lies on no plane), grey
// values in 255ths, and its camera.
struct Image {
    static constexpr float kMeasured = 65000.0F;
    const std::uint16_t* depth = nullptr;
    const std::uint8_t* gray = nullptr;
    int width = 0, height = 0;
    int gray_width = 0, gray_height = 0;
    double gray_share = 1.0;  // pixels of the grey image to one of depth, along a side: less than 1 where it is coarser
    double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  // pixel (u, v) has its centre at (u + 0.5, v + 0.5)
    double per_fx = 1.0 / fx, per_fy = 1.0 / fy;

    // Depth of a pixel, or 0 where it is not in the image or was not measured.
    double depth_at(int row, int col) const {
        if (row < 0 || col < 0 || row >= height || col >= width) return 0.0;
        const float z = from_half(depth[static_cast<std::ptrdiff_t>(row) * width + col]);
        return z > 0.0F && z < kMeasured ? static_cast<double>(z) : 0.0;
    }
    // The same, also where it lies on no plane.
    double seen_at(int row, int col) const {
        const double z = std::abs(static_cast<double>(from_half(depth[static_cast<std::ptrdiff_t>(row) * width + col])));
        return z < kMeasured ? z : 0.0;
    }
    double gray_at(int row, int col) const { return gray[static_cast<std::ptrdiff_t>(row) * gray_width + col] * (1.0 / 255.0); }
    void point(int row, int col, double z, double (&out)[3]) const {
        out[0] = (col + 0.5 - cx) * per_fx * z;
        out[1] = (row + 0.5 - cy) * per_fy * z;
        out[2] = z;
    }
};

struct FrameAlignment {
    double rotation[9] = {};  // this camera to the earlier one, row by row
    double position[3] = {};
    double noise = 0.0;       // deviation of the earlier depth: this times its square, 1/m
    double deviation = 0.0;   // of a surface's distance beside the sensors' noise, m
    double kernel = 0.0;      // of Geman and McClure, in deviations
    double reach = 0.0;       // points that are farther from the surface are not the same, m
    int stencil = 1;          // normals come from pixels so far away
    double edge_share = 0.0;  // depth that bends by a larger share of itself is an edge
    double gray_deviation = 0.0, gray_kernel = 0.0;  // 0 = without grey values
};

inline void add_row(NormalEquations& out, const double (&row)[6], double residual, double weight) {
    int k = 0;
    for (int i = 0; i < 6; ++i) {
        const double weighted = weight * row[i];
        out.gradient[i] += weighted * residual;
        for (int j = i; j < 6; ++j) out.hessian[k++] += weighted * row[j];
    }
}

// The surface about a pixel: its point, its unit normal. False at edges and where a neighbour was not measured.
inline bool surface_at(const Image& image, int row, int col, int stencil, double edge_share, double (&point)[3], double (&normal)[3]) {
    const double z = image.depth_at(row, col);
    const double left = image.depth_at(row, col - stencil), right = image.depth_at(row, col + stencil);
    const double up = image.depth_at(row - stencil, col), down = image.depth_at(row + stencil, col);
    if (z == 0.0 || left == 0.0 || right == 0.0 || up == 0.0 || down == 0.0) return false;
    if (std::abs(left + right - 2.0 * z) > edge_share * z || std::abs(up + down - 2.0 * z) > edge_share * z) return false;
    double a[3], b[3], other[3];
    image.point(row, col + stencil, right, a);
    image.point(row, col - stencil, left, other);
    for (int axis = 0; axis < 3; ++axis) a[axis] -= other[axis];
    image.point(row + stencil, col, down, b);
    image.point(row - stencil, col, up, other);
    for (int axis = 0; axis < 3; ++axis) b[axis] -= other[axis];
    // Towards the camera.
    normal[0] = b[1] * a[2] - b[2] * a[1];
    normal[1] = b[2] * a[0] - b[0] * a[2];
    normal[2] = b[0] * a[1] - b[1] * a[0];
    const double length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    if (!(length > 1e-12)) return false;
    const double scale = 1.0 / length;
    for (double& value : normal) value *= scale;
    image.point(row, col, z, point);
    return true;
}

// Exposure changes from frame to frame: grey values are compared up to a factor, which is solved for with the motion and
// eliminated (Schur's complement).
struct Gain {
    static constexpr double kDeviation = 0.1;
    double cross[6] = {}, square = 0.0, gradient = 0.0;

    void add(const double (&row)[6], double difference, double value, double weight) {
        for (int k = 0; k < 6; ++k) cross[k] += weight * row[k] * value;
        square += weight * value * value;
        gradient += weight * value * difference;
    }
    void add(const Gain& other) {
        for (int k = 0; k < 6; ++k) cross[k] += other.cross[k];
        square += other.square;
        gradient += other.gradient;
    }
    void marginalize(NormalEquations& out) const {
        const double whole = square + 1.0 / (kDeviation * kDeviation);
        int k = 0;
        for (int i = 0; i < 6; ++i) {
            out.gradient[i] -= cross[i] * gradient / whole;
            for (int j = i; j < 6; ++j) out.hessian[k++] -= cross[i] * cross[j] / whole;
        }
        out.cost -= gradient * gradient / whole;
    }
};

// Sums over points: of distances, then of grey values.
struct FrameSums {
    NormalEquations of[2];
    Gain gain;

    void add(const FrameSums& other) {
        for (int kind = 0; kind < 2; ++kind) {
            for (int k = 0; k < 21; ++k) of[kind].hessian[k] += other.of[kind].hessian[k];
            for (int k = 0; k < 6; ++k) of[kind].gradient[k] += other.of[kind].gradient[k];
            of[kind].cost += other.of[kind].cost;
            of[kind].weight += other.of[kind].weight;
            of[kind].count += other.of[kind].count;
        }
        gain.add(other.gain);
    }
};

// Sums over some of a frame's points, by this camera's displacement along the earlier camera's axes and its rotation
// vector about them. gray: of the points.
inline void frame_to_frame(const FramePoints& points, const float* gray, int begin, int end, const Image& image,
                           const FrameAlignment& at, FrameSums& out) {
    NormalEquations* sums = out.of;
    for (int i = begin; i < end; ++i) {
        if (!(points.trust[i] > 0.0F)) continue;
        const float* x = points.camera + 3 * static_cast<std::ptrdiff_t>(i);
        double arm[3], p[3], length = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double* r = at.rotation + 3 * axis;
            arm[axis] = r[0] * x[0] + r[1] * x[1] + r[2] * x[2];
            p[axis] = arm[axis] + at.position[axis];
            length += arm[axis] * arm[axis];
        }
        if (!(p[2] > 0.05)) continue;
        const double per_depth = 1.0 / p[2];
        const double u = image.fx * p[0] * per_depth + image.cx, v = image.fy * p[1] * per_depth + image.cy;
        if (!(u >= 1.0 && v >= 1.0 && u < image.width - 1.0 && v < image.height - 1.0)) continue;
        const int col_of = static_cast<int>(u), row_of = static_cast<int>(v);
        const auto jacobian = [&](const double (&g)[3], double (&row)[6]) {
            for (int axis = 0; axis < 3; ++axis) row[axis] = g[axis];
            row[3] = arm[1] * g[2] - arm[2] * g[1];
            row[4] = arm[2] * g[0] - arm[0] * g[2];
            row[5] = arm[0] * g[1] - arm[1] * g[0];
        };
        double surface[3], normal[3], row[6], weight;
        if (surface_at(image, row_of, col_of, at.stencil, at.edge_share, surface, normal)) {
            double distance = 0.0, incidence = 0.0;
            for (int axis = 0; axis < 3; ++axis) {
                distance += normal[axis] * (p[axis] - surface[axis]);
                incidence += normal[axis] * arm[axis];
            }
            if (std::abs(distance) > at.reach) continue;
            incidence *= incidence / (length > 0.0 ? length : 1.0);
            const double noise = at.noise * surface[2] * surface[2];
            const double spread = (points.variance[i] + noise * noise) * incidence + at.deviation * at.deviation;
            const double square = distance * distance / spread;
            const double share = at.kernel * at.kernel / (at.kernel * at.kernel + square);
            weight = points.trust[i] * share * share;
            jacobian(normal, row);
            add_row(sums[0], row, distance, weight / spread);
            sums[0].cost += points.trust[i] * share * square;
            sums[0].weight += weight;
            sums[0].count += 1.0;
        } else {
            // An edge, or noise: it gives no plane, but what it looks like, where it is the same surface.
            const double z = image.seen_at(row_of, col_of), apart = p[2] - z;
            if (z == 0.0 || std::abs(apart) > at.reach) continue;
            const double bend = at.edge_share * z, spread = points.variance[i] + bend * bend + at.deviation * at.deviation;
            const double share = at.kernel * at.kernel / (at.kernel * at.kernel + apart * apart / spread);
            weight = points.trust[i] * share * share;
        }
        if (!(at.gray_deviation > 0.0)) continue;
        const double left = u * image.gray_share - 0.5, top = v * image.gray_share - 0.5;
        if (!(left >= 0.0 && top >= 0.0 && left < image.gray_width - 1.0 && top < image.gray_height - 1.0)) continue;
        const int col = static_cast<int>(left), line = static_cast<int>(top);
        const double a = left - col, b = top - line;
        const double g00 = image.gray_at(line, col), g01 = image.gray_at(line, col + 1);
        const double g10 = image.gray_at(line + 1, col), g11 = image.gray_at(line + 1, col + 1);
        const double there = (1 - b) * ((1 - a) * g00 + a * g01) + b * ((1 - a) * g10 + a * g11);
        const double difference = there - gray[i];
        const double by_u = (1 - b) * (g01 - g00) + b * (g11 - g10), by_v = (1 - a) * (g10 - g00) + a * (g11 - g01);
        const double gray_per_m = image.gray_share * per_depth;
        const double du = by_u * image.fx * gray_per_m, dv = by_v * image.fy * gray_per_m;
        const double slope[3] = {du, dv, -(du * p[0] + dv * p[1]) * per_depth};
        const double precision = 1.0 / (at.gray_deviation * at.gray_deviation);
        const double total = difference * difference * precision;
        const double gray_share = at.gray_kernel * at.gray_kernel / (at.gray_kernel * at.gray_kernel + total);
        const double believed = weight * gray_share * gray_share * precision;
        jacobian(slope, row);
        add_row(sums[1], row, difference, believed);
        sums[1].cost += weight * gray_share * total;
        sums[1].weight += weight * gray_share * gray_share;
        sums[1].count += 1.0;
        out.gain.add(row, difference, there, believed);
    }
}

// The mean of inverse depth over squares that reach `radius` pixels, as depth; at edges, where the squares spread by more
// than a share of themselves and the noise, what was measured, negative; 0 where nothing was measured.
inline void smoothed_depth(const float* depth, int height, int width, int radius, double noise, double spread_share,
                           float* out) {
    constexpr float kNearest = 1e-3F;  // m; the squares of what is nearer would drown the others in the running sums
    struct Sums { double count, total, square; };
    const int size = 2 * radius + 1;
    std::vector<Sums> columns(static_cast<std::size_t>(width), Sums{0.0, 0.0, 0.0});
    const auto inverse_at = [&](int row, int col) {
        const float z = depth[static_cast<std::ptrdiff_t>(row) * width + col];
        return z > kNearest && z < Image::kMeasured ? 1.0 / static_cast<double>(z) : 0.0;
    };
    const auto add_line = [&](int row, double sign) {
        if (row < 0 || row >= height) return;
        for (int col = 0; col < width; ++col) {
            const double inverse = inverse_at(row, col);
            Sums& sums = columns[static_cast<std::size_t>(col)];
            sums.count += inverse > 0.0 ? sign : 0.0;
            sums.total += sign * inverse;
            sums.square += sign * inverse * inverse;
        }
    };
    for (int row = 0; row < radius; ++row) add_line(row, 1.0);
    for (int row = 0; row < height; ++row) {
        add_line(row + radius, 1.0);
        add_line(row - radius - 1, -1.0);
        Sums sums{0.0, 0.0, 0.0};
        const auto add_column = [&](int col, double sign) {
            if (col < 0 || col >= width) return;
            const Sums& other = columns[static_cast<std::size_t>(col)];
            sums.count += sign * other.count;
            sums.total += sign * other.total;
            sums.square += sign * other.square;
        };
        for (int col = 0; col < radius; ++col) add_column(col, 1.0);
        for (int col = 0; col < width; ++col) {
            add_column(col + radius, 1.0);
            add_column(col - radius - 1, -1.0);
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(row) * width + col;
            const double inverse = inverse_at(row, col);
            if (!(inverse > 0.0)) {
                out[at] = 0.0F;
                continue;
            }
            const double mean = sums.total / sums.count;
            const double variance = sums.square / sums.count - mean * mean;
            // A plane spreads too, but over a few pixels only by a small share.
            const double most = std::max(spread_share * mean, 2.0 * noise);
            const bool smooth = 2.0 * sums.count > size * size && variance < most * most;
            out[at] = smooth ? static_cast<float>(1.0 / mean) : -depth[at];
        }
    }
}

}  // namespace anm
