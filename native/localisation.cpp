// What localisation computes beside the engine, as Python sees it.
#include <algorithm>
#include <vector>

#include "bindings.h"
#include "frame_to_frame.h"
#include "thread_pool.h"

namespace {

constexpr int kPart = 512;  // points of a task; fixed, so that sums do not depend on the number of threads

using DoublesIn = Array<const double, 2>;
using DoublesFlat = Array<const double, 1>;

// Normal equations [2][6][6] and [2][6], costs, weights and counts [2][3] of a frame against an earlier one, whose depth is
// of 16 bits and whose grey values are of 8.
nb::tuple frame_to_frame(In points, InFlat gray, InFlat variance, InFlat trust, Array<const std::uint16_t, 2> depth,
                         Array<const std::uint8_t, 2> image_gray,
                         DoublesFlat camera, DoublesIn T, DoublesFlat settings, int num_threads) {
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
    struct Call {
        const anm::FramePoints& frame;
        const float* gray;
        const anm::Image& image;
        const anm::FrameAlignment& at;
        std::vector<anm::FrameSums> parts;
    };
    Call call{frame, gray.data(), image, at, std::vector<anm::FrameSums>((count + kPart - 1) / kPart)};
    const auto part = [](void* arg, int task, int) {
        Call& of = *static_cast<Call*>(arg);
        const int begin = task * kPart, end = std::min(begin + kPart, of.frame.count);
        anm::frame_to_frame(of.frame, of.gray, begin, end, of.image, of.at, of.parts[static_cast<std::size_t>(task)]);
    };
    anm::FrameSums whole;
    {
        nb::gil_scoped_release release;
        anm::thread_pool().run(num_threads, static_cast<int>(call.parts.size()), part, &call);
        for (const anm::FrameSums& each : call.parts) whole.add(each);
    }
    whole.gain.marginalize(whole.of[1]);
    return as_arrays(whole.of);
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
          "camera"_a, "T"_a, "settings"_a, "num_threads"_a);
    m.def("smoothed_depth", &smoothed_depth, "depth"_a, "radius"_a, "noise"_a, "spread_share"_a);
}
