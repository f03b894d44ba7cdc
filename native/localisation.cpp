// What localisation computes beside the engine, as Python sees it.
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstring>
#include <tuple>
#include <vector>

#include "bindings.h"
#include "points_in_grid.h"
#include "key_depth.h"

namespace {

using DoublesIn = Array<const double, 2>;
using DoublesFlat = Array<const double, 1>;
// Depth, grey values, camera (fx, fy, cx, cy), its pose in the world, and its stencil.
using Image = std::tuple<Array<const std::uint16_t, 2>, Array<const std::uint8_t, 2>, DoublesFlat, DoublesIn, int>;

using States = Array<const std::int8_t, 3>;
using Corner = Array<const std::int64_t, 1>;

// How the camera of a frame stands to that of an earlier one, row by row, and its place there [m].
void relate(const DoublesIn& T, const DoublesIn& earlier, double (&rotation)[9], double (&position)[3]) {
    require(T.shape(0) == 4 && T.shape(1) == 4 && earlier.shape(0) == 4 && earlier.shape(1) == 4, "a pose is 4 x 4");
    for (std::size_t i = 0; i < 3; ++i) {
        position[i] = 0.0;
        for (std::size_t k = 0; k < 3; ++k) position[i] += earlier(k, i) * (T(k, 3) - earlier(k, 3));
        for (std::size_t j = 0; j < 3; ++j) {
            double& turn = rotation[3 * i + j] = 0.0;
            for (std::size_t k = 0; k < 3; ++k) turn += earlier(k, i) * T(k, j);
        }
    }
}

// Exposure changes from frame to frame: grey values are compared up to a factor, which is solved for with the motion and
// eliminated (Schur's complement).
void marginalize(const anm::Gain& gain, anm::NormalEquations& out) {
    constexpr double kDeviation = 0.1;
    const double whole = gain.square + 1.0 / (kDeviation * kDeviation);
    int k = 0;
    for (int i = 0; i < 6; ++i) {
        out.gradient[i] -= gain.cross[i] * gain.gradient / whole;
        for (int j = i; j < 6; ++j) out.hessian[k++] -= gain.cross[i] * gain.cross[j] / whole;
    }
    out.cost -= gain.gradient * gain.gradient / whole;
}

// Adds sums by motions along an earlier camera's axes, of which distances count a share, to those along the world's.
void add_turned(const anm::NormalEquations (&sums)[2], double share, const DoublesIn& T, double* hessian, double* gradient) {
    double full[6][6], slope[6], half[6][6] = {};
    int k = 0;
    for (int i = 0; i < 6; ++i) {
        slope[i] = share * sums[0].gradient[i] + sums[1].gradient[i];
        for (int j = i; j < 6; ++j, ++k) full[i][j] = full[j][i] = share * sums[0].hessian[k] + sums[1].hessian[k];
    }
    const auto turn = [&](int i, int m) { return T(static_cast<std::size_t>(i % 3), static_cast<std::size_t>(m)); };
    for (int i = 0; i < 6; ++i) {
        for (int m = 0; m < 3; ++m) {
            const int of = 3 * (i / 3) + m;
            gradient[i] += turn(i, m) * slope[of];
            for (int j = 0; j < 6; ++j) half[i][j] += turn(i, m) * full[of][j];
        }
    }
    for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 6; ++j) {
            for (int m = 0; m < 3; ++m) hessian[6 * i + j] += half[i][3 * (j / 3) + m] * turn(j, m);
        }
    }
}

// Normal equations [6][6] and [6] of a frame at a pose against earlier ones, by its displacement in the world and its
// rotation vector, and sums over these: cost of distances, their number, mean cost of a grey value.
nb::tuple frame_to_frames(In points, InFlat gray, InFlat variance, InFlat trust, const std::vector<Image>& images,
                          DoublesIn T, double depth_share, DoublesFlat settings) {
    const std::size_t count = points.shape(0);
    require(points.shape(1) == 3 && gray.size() == count && variance.size() == count && trust.size() == count,
            "grey values, variance and trust need a value per point");
    require(settings.size() == 8, "there are eight settings");
    const anm::GrayPoints frame{points.data(), gray.data(), variance.data(), trust.data(), static_cast<int>(count)};
    const auto setting = [&](std::size_t i) { return static_cast<float>(settings(i)); };
    const anm::FrameToFrame at{setting(0), setting(1), setting(2), setting(3), setting(4), setting(5)};
    static const anm::Kernel& kernel = find_kernel("");
    double *hessian = nullptr, *gradient = nullptr, *facts = nullptr;
    Doubles hessian_out = make_doubles({6, 6}, hessian), gradient_out = make_doubles({6}, gradient);
    Doubles facts_out = make_doubles({3}, facts);
    std::memset(hessian, 0, 36 * sizeof(double));
    std::memset(gradient, 0, 6 * sizeof(double));
    std::memset(facts, 0, 3 * sizeof(double));
    for (const auto& [depth, image_gray, camera, pose, stencil] : images) {
        require(camera.size() == 4, "a camera has four numbers");
        require(stencil >= 1 && stencil <= 1 << 16, "normals come from pixels beside");
        anm::KeyView view;
        view.depth = depth.data();
        view.gray = image_gray.data();
        view.height = static_cast<int>(depth.shape(0));
        view.width = static_cast<int>(depth.shape(1));
        view.gray_height = static_cast<int>(image_gray.shape(0));
        view.gray_width = static_cast<int>(image_gray.shape(1));
        view.gray_share = setting(6);
        view.fx = static_cast<float>(camera(0));
        view.fy = static_cast<float>(camera(1));
        view.cx = static_cast<float>(camera(2));
        view.cy = static_cast<float>(camera(3));
        // Depth is a mean over squares that reach up to the stencil.
        view.noise = setting(7) / static_cast<float>(2 * stencil - 1);
        view.stencil = stencil;
        double rotation[9], position[3];
        relate(T, pose, rotation, position);
        for (int i = 0; i < 9; ++i) view.rotation[i] = static_cast<float>(rotation[i]);
        for (int i = 0; i < 3; ++i) view.position[i] = static_cast<float>(position[i]);
        anm::FrameSums sums;
        {
            nb::gil_scoped_release release;
            kernel.frame_to_frame(frame, view, at, sums);
        }
        marginalize(sums.gain, sums.of[1]);
        add_turned(sums.of, depth_share, pose, hessian, gradient);
        facts[0] += sums.of[0].cost;
        facts[1] += sums.of[0].count;
        facts[2] += sums.of[1].cost / (sums.of[1].count > 1.0 ? sums.of[1].count : 1.0);
    }
    return nb::make_tuple(hessian_out, gradient_out, facts_out);
}

// Share of a frame's points that each earlier one shows too, not hidden, at a scale that differs by less than a factor.
std::vector<double> shares_in(In points, const std::vector<Image>& images, DoublesIn T, double nearness, double slack_m,
                              double most_scale) {
    require(points.shape(1) == 3, "points have three coordinates");
    std::vector<double> shares;
    for (const auto& [depth, image_gray, camera, pose, stencil] : images) {
        require(camera.size() == 4, "a camera has four numbers");
        double rotation[9], position[3];
        relate(T, pose, rotation, position);
        const double width = static_cast<double>(depth.shape(1)), height = static_cast<double>(depth.shape(0));
        std::size_t count = 0;
        for (std::size_t i = 0; i < points.shape(0); ++i) {
            const double own[3] = {points(i, 0), points(i, 1), points(i, 2)};
            double p[3];
            for (int k = 0; k < 3; ++k) p[k] = rotation[3 * k] * own[0] + rotation[3 * k + 1] * own[1] + rotation[3 * k + 2] * own[2] + position[k];
            if (!(p[2] > 0.05 && p[2] < most_scale * own[2] && p[2] * most_scale > own[2])) continue;
            const double col = camera(0) * p[0] / p[2] + camera(2), row = camera(1) * p[1] / p[2] + camera(3);
            if (!(col >= 0.0 && row >= 0.0 && col < width && row < height)) continue;
            const float seen = anm::from_half(depth(static_cast<std::size_t>(row), static_cast<std::size_t>(col)));
            // Zero: not measured, which no slack makes a sight of the point.
            count += seen != 0.0F && std::abs(std::abs(static_cast<double>(seen)) - p[2]) < nearness * p[2] + slack_m;
        }
        shares.push_back(static_cast<double>(count) / static_cast<double>(points.shape(0) > 0 ? points.shape(0) : 1));
    }
    return shares;
}

anm::PointsGrid grid_of(const States& state, const Corner& corner, double voxel_m) {
    require(corner.size() == 3, "a corner has three indices");
    anm::PointsGrid grid;
    grid.state = state.data();
    grid.layers = static_cast<std::int64_t>(state.shape(0));
    grid.rows = static_cast<std::int64_t>(state.shape(1));
    grid.cols = static_cast<std::int64_t>(state.shape(2));
    grid.corner = corner.data();
    grid.voxel_m = voxel_m;
    return grid;
}

void near_occupied(States state, Corner corner, double voxel_m, DoublesIn points, double reach, Array<std::uint8_t, 1> out) {
    require(points.shape(1) == 3 && out.size() == points.shape(0), "points have three coordinates, and an answer each");
    const anm::PointsGrid grid = grid_of(state, corner, voxel_m);
    nb::gil_scoped_release release;
    for (std::size_t i = 0; i < points.shape(0); ++i) out(i) = grid.near_occupied(points.data() + 3 * i, reach);
}

void agreement(States state, States log_odds, Corner corner, double voxel_m, DoublesIn points, DoublesFlat origin, double reach,
               DoublesFlat shares, double margin, Array<std::uint8_t, 2> out) {
    const std::size_t count = points.shape(0);
    require(points.shape(1) == 3 && out.shape(0) == 2 && out.shape(1) == count, "points have three coordinates, and two answers each");
    require(origin.size() == 3 && log_odds.size() == state.size(), "log-odds and states are of the same voxels");
    anm::PointsGrid grid = grid_of(state, corner, voxel_m);
    grid.log_odds = log_odds.data();
    const double from[3] = {origin(0), origin(1), origin(2)};
    nb::gil_scoped_release release;
    for (std::size_t i = 0; i < count; ++i) {
        anm::agreement(grid, from, points.data() + 3 * i, reach, shares.data(), static_cast<std::int64_t>(shares.size()), margin,
                       out(0, i), out(1, i));
    }
}

Out smoothed_depth(In depth, int radius, double noise, double spread_share) {
    float* out = nullptr;
    Out result = make_array({depth.shape(0), depth.shape(1)}, out);
    nb::gil_scoped_release release;
    anm::smoothed_depth(depth.data(), static_cast<int>(depth.shape(0)), static_cast<int>(depth.shape(1)), radius, noise,
                        spread_share, out);
    return result;
}

}  // namespace

void bind_localisation(nb::module_& m) {
    m.def("frame_to_frames", &frame_to_frames, "points"_a, "gray"_a, "variance"_a, "trust"_a, "images"_a, "T"_a,
          "depth_share"_a, "settings"_a);
    m.def("shares_in", &shares_in, "points"_a, "images"_a, "T"_a, "nearness"_a, "slack_m"_a, "most_scale"_a);
    m.def("near_occupied", &near_occupied, "state"_a, "corner"_a, "voxel_m"_a, "points"_a, "reach"_a, "out"_a);
    m.def("agreement", &agreement, "state"_a, "log_odds"_a, "corner"_a, "voxel_m"_a, "points"_a, "origin"_a, "reach"_a,
          "shares"_a, "margin"_a, "out"_a);
    m.def("smoothed_depth", &smoothed_depth, "depth"_a, "radius"_a, "noise"_a, "spread_share"_a);
}
