// What localisation computes beside the engine, as Python sees it.
#include "bindings.h"
#include "frame_to_frame.h"

namespace {

using DoublesIn = Array<const double, 2>;
using DoublesFlat = Array<const double, 1>;

// Depth is of 16 bits, grey values are of 8. Normal equations [2][6][6] and [2][6], costs, weights and counts [2][3] of a frame against an earlier one.
nb::tuple frame_to_frame(In points, InFlat gray, InFlat variance, InFlat trust, Array<const std::uint16_t, 2> depth,
                         Array<const std::uint8_t, 2> image_gray,
                         DoublesFlat camera, DoublesIn T, DoublesFlat settings) {
    const std::size_t count = points.shape(0);
    require(points.shape(1) == 3 && gray.size() == count && variance.size() == count && trust.size() == count,
            "grey values, variance and trust need a value per point");
    require(camera.size() == 4 && T.shape(0) >= 3 && T.shape(1) == 4 && settings.size() == 9, "wrong sizes");
    const anm::FramePoints frame{points.data(), nullptr, variance.data(), trust.data(), static_cast<int>(count)};
    const anm::Image image{depth.data(), image_gray.data(), static_cast<int>(depth.shape(1)),
                           static_cast<int>(depth.shape(0)), static_cast<int>(image_gray.shape(1)),
                           static_cast<int>(image_gray.shape(0)), settings(8), camera(0), camera(1), camera(2), camera(3)};
    anm::FrameAlignment at;
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) at.rotation[3 * i + j] = T(i, j);
        at.position[i] = T(i, 3);
    }
    at.noise = settings(0);
    at.deviation = settings(1);
    at.kernel = settings(2);
    at.reach = settings(3);
    at.edge_share = settings(4);
    at.gray_deviation = settings(5);
    at.gray_kernel = settings(6);
    at.stencil = static_cast<int>(settings(7));
    anm::NormalEquations sums[2];
    {
        nb::gil_scoped_release release;
        anm::frame_to_frame(frame, gray.data(), image, at, sums);
    }
    return as_arrays(sums);
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
    m.def("frame_to_frame", &frame_to_frame, "points"_a, "gray"_a, "variance"_a, "trust"_a, "depth"_a, "image_gray"_a,
          "camera"_a, "T"_a, "settings"_a);
    m.def("smoothed_depth", &smoothed_depth, "depth"_a, "radius"_a, "noise"_a, "spread_share"_a);
}
