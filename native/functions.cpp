// Functions that stand beside the engine, as Python sees them.
#include <nanobind/stl/string.h>

#include "bindings.h"
#include "field_blocks.h"
#include "lattice.h"
#include "nearest.h"
#include "outliers.h"
#include "pass_variance.h"
#include "pixels.h"
#include "sample_cells.h"
#include "thread_pool.h"
#include "triangles.h"

namespace {

using Grid = Array<std::int8_t, 3>;
using ConstGrid = Array<const std::int8_t, 3>;
using Indices = Array<const std::int64_t, 1>;
using Table = Array<const std::int64_t, 2>;

constexpr std::int64_t kPlacesPerTask = 4096;

anm::Extent extent_of(const ConstGrid& grid, const Table& blocks) {
    const anm::Extent size{static_cast<std::int64_t>(grid.shape(0)), static_cast<std::int64_t>(grid.shape(1)),
                           static_cast<std::int64_t>(grid.shape(2))};
    require(blocks.shape(1) == 3, "a block has a layer, a row and a column");
    const std::int64_t most[3] = {size.layers / anm::kBlock, size.rows / anm::kBlock, size.cols / anm::kBlock};
    for (std::size_t i = 0; i < blocks.shape(0); ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            require(blocks(i, axis) >= 0 && blocks(i, axis) < most[axis], "blocks lie outside the grid");
        }
    }
    return size;
}

std::int64_t voxels_to_read(ConstGrid state, Table blocks, Array<std::int64_t, 1> out) {
    const anm::Extent size = extent_of(state, blocks);
    return anm::voxels_to_read(state.data(), nullptr, size, blocks.data(), static_cast<std::int64_t>(blocks.shape(0)),
                               out.data(), static_cast<std::int64_t>(out.size()));
}

std::int64_t voxels_in_doubt(ConstGrid state, ConstGrid agreed, Table blocks, Array<std::int64_t, 1> out) {
    const anm::Extent size = extent_of(state, blocks);
    require(agreed.shape(0) == state.shape(0) && agreed.shape(1) == state.shape(1) && agreed.shape(2) == state.shape(2),
            "the arrays differ in size");
    return anm::voxels_to_read(state.data(), agreed.data(), size, blocks.data(),
                               static_cast<std::int64_t>(blocks.shape(0)), out.data(),
                               static_cast<std::int64_t>(out.size()));
}

void write_blocks(ConstGrid state, Table blocks, Indices voxels, Array<const std::int8_t, 1> read, Grid out,
                  Array<std::uint8_t, 1> moved) {
    const anm::Extent size = extent_of(state, blocks);
    require(out.shape(0) == state.shape(0) && out.shape(1) == state.shape(1) && out.shape(2) == state.shape(2) &&
                read.size() == voxels.size() && moved.size() == blocks.shape(0),
            "the arrays differ in size");
    anm::write_blocks(state.data(), size, blocks.data(), static_cast<std::int64_t>(blocks.shape(0)), voxels.data(),
                      read.data(), static_cast<std::int64_t>(voxels.size()), out.data(), moved.data());
}

// World places of voxels; see field_blocks.h.
Out voxel_centres(Indices voxels, Indices shape, Indices corner, double resolution) {
    require(shape.size() == 3 && corner.size() == 3, "a grid has three axes");
    const anm::Extent size{shape(0), shape(1), shape(2)};
    const std::int64_t room = size.layers * size.rows * size.cols;
    for (std::size_t i = 0; i < voxels.size(); ++i) {
        require(voxels(i) >= 0 && voxels(i) < room, "voxels lie outside the grid");
    }
    float* places = nullptr;
    Out out = make_array({voxels.size(), std::size_t{3}}, places);
    anm::voxel_centres(voxels.data(), static_cast<std::int64_t>(voxels.size()), size, corner.data(), resolution, places);
    return out;
}

void decide_voxels(ConstGrid state, Array<const float, 3> seen, Indices voxels, InFlat sdf, InFlat rule,
                   Array<std::int8_t, 1> out) {
    require(seen.size() == state.size() && sdf.size() == voxels.size() && out.size() == voxels.size() && rule.size() == 5,
            "the arrays differ in size");
    for (std::size_t i = 0; i < voxels.size(); ++i) {
        require(voxels(i) >= 0 && voxels(i) < static_cast<std::int64_t>(state.size()), "voxels lie outside the grid");
    }
    const anm::DoubtRule numbers{rule(0), rule(1), rule(2), rule(3), rule(4)};
    anm::decide_voxels(state.data(), seen.data(), voxels.data(), static_cast<std::int64_t>(voxels.size()), sdf.data(),
                       numbers, out.data());
}

// Which lattice cells voxels of blocks touch; see lattice.h.
anm::TouchedCells touched_by(const Table& blocks, const Array<const std::int64_t, 3>& low,
                             const Array<const std::int64_t, 3>& high) {
    for (const auto* spans : {&low, &high}) {
        require(spans->shape(0) == blocks.shape(0) && spans->shape(1) == 3 && spans->shape(2) == anm::kBlock,
                "each voxel of a block spans cells along three axes");
    }
    for (std::size_t i = 0; i < low.size(); ++i) require(low.data()[i] <= high.data()[i], "a voxel touches no cell");
    return {low.data(), high.data()};
}

// The cells that occupied voxels touch, in the box about them, and the box's first cell; None where there is none.
nb::object touched_cells(ConstGrid state, Table blocks, Array<const std::int64_t, 3> low,
                         Array<const std::int64_t, 3> high) {
    const anm::Extent size = extent_of(state, blocks);
    const anm::TouchedCells touched = touched_by(blocks, low, high);
    const auto count = static_cast<std::int64_t>(blocks.shape(0));
    const anm::Box3 box = anm::touched_box(state.data(), size, blocks.data(), count, touched);
    if (box.empty()) return nb::none();
    const std::size_t shape[3] = {static_cast<std::size_t>(box.size(0)), static_cast<std::size_t>(box.size(1)),
                                  static_cast<std::size_t>(box.size(2))};
    auto* cells = new std::uint8_t[shape[0] * shape[1] * shape[2]]();
    Flags out(cells, 3, shape, nb::capsule(cells, [](void* p) noexcept { delete[] static_cast<std::uint8_t*>(p); }));
    anm::mark_touched(state.data(), size, blocks.data(), count, touched, box, cells);
    return nb::make_tuple(out, nb::make_tuple(box.low[0], box.low[1], box.low[2]));
}

// Size of an array of corners [x][y][z].
struct CornerSize {
    std::int64_t axis[3];
    explicit CornerSize(const Array<std::uint8_t, 3>& corners)
        : axis{static_cast<std::int64_t>(corners.shape(0)), static_cast<std::int64_t>(corners.shape(1)),
               static_cast<std::int64_t>(corners.shape(2))} {}
};

// Marks the corners of cells and returns their world places; see lattice.h.
Out lattice_corners(Array<const std::uint8_t, 3> cells, Indices corner, double spacing, Array<std::uint8_t, 3> corners) {
    require(corner.size() == 3, "a cell has three indices");
    const CornerSize size(corners);
    std::int64_t cell_size[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        cell_size[axis] = static_cast<std::int64_t>(cells.shape(axis));
        require(size.axis[axis] == cell_size[axis] + 1, "there is one corner more than cells along each axis");
    }
    const std::int64_t count = anm::mark_corners(cells.data(), cell_size, corners.data());
    float* places = nullptr;
    Out out = make_array({static_cast<std::size_t>(count), std::size_t{3}}, places);
    anm::corner_places(corners.data(), size.axis, corner.data(), spacing, places);
    return out;
}

nb::ndarray<nb::numpy, double> lattice_crossings(Array<std::uint8_t, 3> corners, InFlat values, Indices corner,
                                                 double spacing) {
    require(corner.size() == 3, "a cell has three indices");
    std::size_t count = 0;
    for (std::size_t i = 0; i < corners.size(); ++i) count += corners.data()[i] != 0;
    require(count == values.size(), "each corner has a value");
    auto* found = new std::vector<double>;
    const nb::capsule owner(found, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
    anm::crossings(corners.data(), CornerSize(corners).axis, values.data(), corner.data(), spacing, *found);
    return nb::ndarray<nb::numpy, double>(found->data(), {found->size() / 3, 3}, owner);
}

// Variance over passes; see pass_variance.h.
Out pass_variance(In sdf, Array<const float, 3> rgb, float color_weight) {
    require(rgb.shape(0) == sdf.shape(0) && rgb.shape(1) == sdf.shape(1) && rgb.shape(2) == 3 && sdf.shape(0) >= 2,
            "a pass gives s and a colour for each point");
    float* variance = nullptr;
    Out out = make_array({sdf.shape(1)}, variance);
    anm::pass_variance(sdf.data(), rgb.data(), static_cast<std::int64_t>(sdf.shape(0)),
                       static_cast<std::int64_t>(sdf.shape(1)), color_weight, variance);
    return out;
}

// Rays of `batches` batches, each of stored pixels and of a share of other rays; see pixels.h.
nb::tuple ray_batches(InFlags pixels, In cameras, Table place, Table keyframe, float depth_unit, In origin,
                      In direction, In rgb, InFlat depth) {
    const auto batches = static_cast<std::int64_t>(place.shape(0)), stored = static_cast<std::int64_t>(place.shape(1));
    const auto others = static_cast<std::int64_t>(depth.size());
    require(keyframe.shape(0) == place.shape(0) && keyframe.shape(1) == place.shape(1),
            "each pixel was seen in one keyframe");
    require(batches > 0 && others % batches == 0 && origin.shape(0) == depth.size() && origin.shape(1) == 3 &&
                direction.shape(0) == depth.size() && direction.shape(1) == 3 && rgb.shape(0) == depth.size() &&
                rgb.shape(1) == 3,
            "each batch gets as many of the other rays");
    require(cameras.shape(1) == anm::kCameraNumbers, "a camera has 17 numbers");
    const auto num_pixels = static_cast<std::int64_t>(pixels.size()) / anm::kPixelBytes;
    const auto num_cameras = static_cast<std::int64_t>(cameras.shape(0));
    for (std::int64_t i = 0; i < batches * stored; ++i) {
        require(place.data()[i] >= 0 && place.data()[i] < num_pixels && keyframe.data()[i] >= 0 &&
                    keyframe.data()[i] < num_cameras && cameras.data()[keyframe.data()[i] * anm::kCameraNumbers] >= 1.0F,
                "pixels or keyframes are not among those stored");
    }
    const auto count = static_cast<std::size_t>(batches * stored + others);
    anm::RayArrays from, to;
    from.origin = const_cast<float*>(origin.data());
    from.direction = const_cast<float*>(direction.data());
    from.rgb = const_cast<float*>(rgb.data());
    from.depth = const_cast<float*>(depth.data());
    Out to_origin = make_array({count, std::size_t{3}}, to.origin);
    Out to_direction = make_array({count, std::size_t{3}}, to.direction);
    Out to_rgb = make_array({count, std::size_t{3}}, to.rgb);
    Out to_depth = make_array({count}, to.depth);
    anm::ray_batches(pixels.data(), cameras.data(), place.data(), keyframe.data(), batches, stored, depth_unit, from,
                     others / batches, to);
    return nb::make_tuple(to_origin, to_direction, to_rgb, to_depth);
}

// Calls `work(begin, count)` for parts of many places, several at a time.
template <class Work>
void in_parts(int num_threads, std::int64_t count, const Work& work) {
    struct Call {
        const Work& work;
        std::int64_t count;
    };
    Call call{work, count};
    const auto part = [](void* arg, int task, int) {
        const Call& of = *static_cast<const Call*>(arg);
        const std::int64_t begin = task * kPlacesPerTask;
        of.work(begin, std::min(of.count - begin, kPlacesPerTask));
    };
    const auto tasks = static_cast<int>((count + kPlacesPerTask - 1) / kPlacesPerTask);
    anm::thread_pool().run(num_threads, tasks, part, &call);
}

// Lowers the distance of each place to that of the nearest point; see nearest.h.
void lower_distances(Array<const double, 2> points, Array<const double, 2> places, Array<double, 1> distance,
                     int num_threads) {
    require(points.shape(1) == 3 && places.shape(1) == 3, "a point has three coordinates");
    require(points.shape(0) < std::size_t{1} << 31, "these are too many points");
    require(places.shape(0) == distance.size(), "each place has a distance");
    require(num_threads >= 1, "at least one thread is needed");
    nb::gil_scoped_release release;
    const anm::PointTree tree(points.data(), static_cast<std::int64_t>(points.shape(0)));
    in_parts(num_threads, static_cast<std::int64_t>(distance.size()), [&](std::int64_t begin, std::int64_t count) {
        tree.lower(places.data() + 3 * begin, distance.data() + begin, count);
    });
}

// Distance of each place to the nearest triangle; see triangles.h.
void triangle_distances(Array<const double, 3> triangles, Array<const double, 2> places, Array<double, 1> distance,
                        int num_threads) {
    require(triangles.shape(1) == 3 && triangles.shape(2) == 3 && places.shape(1) == 3,
            "a triangle has three corners, and a point three coordinates");
    require(triangles.shape(0) > 0, "a surface is needed");
    require(triangles.shape(0) < std::size_t{1} << 31, "these are too many triangles");
    require(places.shape(0) == distance.size(), "each place has a distance");
    require(num_threads >= 1, "at least one thread is needed");
    nb::gil_scoped_release release;
    const anm::TriangleTree tree(triangles.data(), static_cast<std::int64_t>(triangles.shape(0)));
    in_parts(num_threads, static_cast<std::int64_t>(distance.size()), [&](std::int64_t begin, std::int64_t count) {
        tree.distances(places.data() + 3 * begin, distance.data() + begin, count);
    });
}

// Marks the samples that points come close to; see sample_cells.h.
std::int64_t cover_samples(Array<const double, 2> points, Array<const double, 2> samples,
                           Array<const std::int32_t, 1> level, Indices column_start, Array<const double, 1> low,
                           double cell, double within, Array<std::uint8_t, 1> covered, Array<std::uint8_t, 3> near) {
    require(points.shape(1) == 3 && samples.shape(1) == 3 && low.size() == 3, "a point has three coordinates");
    require(level.size() == samples.shape(0) && covered.size() == samples.shape(0), "the arrays differ in size");
    require(near.shape(0) >= 3 && near.shape(1) >= 3 && near.shape(2) >= 3, "the samples have cells around them");
    const std::size_t columns = near.shape(0) * near.shape(1);
    require(column_start.size() == columns + 1 && column_start(0) == 0 &&
                column_start(columns) == static_cast<std::int64_t>(samples.shape(0)),
            "each sample is in one column");
    require(within > 0.0 && within <= cell, "cells are no smaller than the distance");
    anm::SampleCells cells{samples.data(), level.data(), column_start.data(), {}, {}, 1.0 / cell};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        cells.size[axis] = static_cast<std::int64_t>(near.shape(axis));
        cells.low[axis] = low(axis);
    }
    nb::gil_scoped_release release;
    return anm::cover_samples(cells, points.data(), static_cast<std::int64_t>(points.shape(0)), within, covered.data(),
                              near.data());
}

// Marks the outliers of a depth image; see outliers.h.
void depth_outliers(In depth, int support, float share, float least, Array<std::uint8_t, 2> out) {
    require(out.shape(0) == depth.shape(0) && out.shape(1) == depth.shape(1), "the arrays differ in size");
    if (depth.size() == 0) return;
    const auto rows = static_cast<std::int64_t>(depth.shape(0)), cols = static_cast<std::int64_t>(depth.shape(1));
    anm::Outliers(depth.data(), rows, cols, share, least).mark(support, out.data());
}

nb::dict roofline(std::size_t table_bytes, const std::string& kernel) {
    anm::Roofline best{};
    find_kernel(kernel).roofline(table_bytes, best);
    nb::dict out;
    out["fma_gflops"] = best.fma_gflops;
    out["load_ns"] = best.load_ns;
    out["update_ns"] = best.update_ns;
    out["stream_gb_per_s"] = best.stream_gb_per_s;
    return out;
}

}  // namespace

void bind_functions(nb::module_& m) {
    m.def("voxels_to_read", &voxels_to_read, "state"_a, "blocks"_a, "out"_a);
    m.def("voxels_in_doubt", &voxels_in_doubt, "state"_a, "agreed"_a, "blocks"_a, "out"_a);
    m.def("write_blocks", &write_blocks, "state"_a, "blocks"_a, "voxels"_a, "read"_a, "out"_a, "moved"_a);
    m.def("voxel_centres", &voxel_centres, "voxels"_a, "shape"_a, "corner"_a, "resolution"_a);
    m.def("decide_voxels", &decide_voxels, "state"_a, "seen"_a, "voxels"_a, "sdf"_a, "rule"_a, "out"_a);
    m.def("touched_cells", &touched_cells, "state"_a, "blocks"_a, "low"_a, "high"_a);
    m.def("lattice_corners", &lattice_corners, "cells"_a, "corner"_a, "spacing"_a, "corners"_a);
    m.def("lattice_crossings", &lattice_crossings, "corners"_a, "values"_a, "corner"_a, "spacing"_a);
    m.def("pass_variance", &pass_variance, "sdf"_a, "rgb"_a, "color_weight"_a);
    m.def("ray_batches", &ray_batches, "pixels"_a, "cameras"_a, "place"_a, "keyframe"_a, "depth_unit"_a, "origin"_a,
          "direction"_a, "rgb"_a, "depth"_a);
    m.def("lower_distances", &lower_distances, "points"_a, "places"_a, "distance"_a, "num_threads"_a);
    m.def("triangle_distances", &triangle_distances, "triangles"_a, "places"_a, "distance"_a, "num_threads"_a);
    m.def("cover_samples", &cover_samples, "points"_a, "samples"_a, "level"_a, "column_start"_a, "low"_a, "cell"_a,
          "within"_a, "covered"_a, "near"_a);
    m.def("depth_outliers", &depth_outliers, "depth"_a, "support"_a, "share"_a, "least"_a, "out"_a);
    m.def("lend_cores", [](int cores) { anm::thread_pool().lend(cores); }, "cores"_a);
    m.def("roofline", &roofline, "table_bytes"_a, "kernel"_a);
}
