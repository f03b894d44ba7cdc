// The kernels of an occupancy grid as Python sees them.
#include <nanobind/stl/string.h>

#include "bindings.h"
#include "buffer.h"
#include "moved_pixels.h"
#include "occupancy.h"

namespace {

// One per occupancy grid: the memory that its kernels work in. The arrays belong to the grid.
class Occupancy {
public:
    template <class T>
    using Cells = Array<T, 3>;
    template <class T>
    using Plane = Array<T, 2>;
    template <class T>
    using Line = Array<T, 1>;
    using Image = In;
    using Rays = Array<const float, 3>;
    using Places = Array<const std::int64_t, 2>;
    using Blocks = Array<const std::uint8_t, 2>;
    using Corner = Array<const std::int64_t, 1>;

    Occupancy(int num_threads, const std::string& kernel) : kernel_(find(kernel)), work_(num_threads) {
        require(num_threads >= 1, "at least one thread is needed");
    }
    Occupancy(const Occupancy&) = delete;
    Occupancy& operator=(const Occupancy&) = delete;

    void bind(Cells<std::int8_t> log_odds, Cells<std::int8_t> state, Cells<float> seen_range,
              Cells<std::uint16_t> num_hits, Cells<std::int32_t> block_stamp, Plane<std::int32_t> column_version,
              Corner corner) {
        anm::Voxels v;
        v.layers = static_cast<std::int64_t>(state.shape(0));
        v.rows = static_cast<std::int64_t>(state.shape(1));
        v.cols = static_cast<std::int64_t>(state.shape(2));
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::size_t n = state.shape(axis);
            require(log_odds.shape(axis) == n && seen_range.shape(axis) == n && num_hits.shape(axis) == n &&
                        block_stamp.shape(axis) << anm::kBlockShift == n,
                    "the grid's arrays differ in size");
        }
        require(column_version.shape(0) == block_stamp.shape(1) && column_version.shape(1) == block_stamp.shape(2),
                "there is one version per column of blocks");
        require(corner.size() == 3, "a corner has three coordinates");
        v.log_odds = log_odds.data();
        v.state = state.data();
        v.seen_range = seen_range.data();
        v.num_hits = num_hits.data();
        v.block_stamp = block_stamp.data();
        v.column_version = column_version.data();
        for (std::size_t axis = 0; axis < 3; ++axis) v.corner[axis] = corner(axis);
        voxels_ = v;
    }

    void carve(Image depth, float fx, float fy, float cx, float cy, InFlat rotation, InFlat position, Corner low,
               Corner high, float edge, float margin, float footprint_px, float nearest, float furthest, int miss,
               int limit, bool no_depth_is_free, std::int32_t frame, Blocks heavy, int heavy_miss) {
        const auto block_rows = static_cast<std::size_t>(voxels_.rows >> anm::kBlockShift);
        const auto block_cols = static_cast<std::size_t>(voxels_.cols >> anm::kBlockShift);
        require(heavy.size() == 0 || (heavy.shape(0) == block_rows && heavy.shape(1) == block_cols),
                "one truth value per column of blocks is needed, or none");
        require(rotation.size() == 9 && position.size() == 3 && low.size() == 3 && high.size() == 3,
                "a pose has nine and three numbers, a box three and three");
        require_inside(low.data(), high.data());
        anm::View view;
        view.depth = depth.data();
        view.height = static_cast<int>(depth.shape(0));
        view.width = static_cast<int>(depth.shape(1));
        view.fx = fx, view.fy = fy, view.cx = cx, view.cy = cy;
        std::memcpy(view.rotation, rotation.data(), sizeof view.rotation);
        std::memcpy(view.position, position.data(), sizeof view.position);
        anm::CarveSettings settings{edge, margin, footprint_px, nearest, furthest, miss, limit, no_depth_is_free, frame,
                                    heavy.size() ? heavy.data() : nullptr, heavy_miss};
        nb::gil_scoped_release release;
        kernel_.carve(voxels_, view, settings, low.data(), high.data(), work_.parallel(), work_.arena());
    }

    void mark(Places voxels, InFlat depth, float range_step, int hit, int limit, std::int32_t frame) {
        require(voxels.shape(1) == 3 && voxels.shape(0) == depth.size(), "one depth per voxel is needed");
        for (std::size_t i = 0; i < depth.size(); ++i) require_inside(voxels.data() + 3 * i, voxels.data() + 3 * i);
        anm::MarkSettings settings{range_step, hit, limit, frame};
        kernel_.mark(voxels_, voxels.data(), depth.data(), static_cast<std::int64_t>(depth.size()), settings, work_.arena());
    }

    std::int64_t hits(Image depth, Rays rays, int first_row, int first_col, int stride, float range, InFlat matrix,
                      InFlat offset, Plane<std::int64_t> voxels, Line<float> hit_depth) {
        require_rays(depth, rays, matrix, offset);
        require(first_row >= 0 && first_col >= 0 && stride >= 1, "rows and columns are counted from 0");
        const auto step = static_cast<std::size_t>(stride);
        const std::size_t most = ((depth.shape(0) + step - 1) / step) * ((depth.shape(1) + step - 1) / step);
        require(voxels.shape(0) >= most && voxels.shape(1) == 3 && hit_depth.size() >= most, "the outputs are too small");
        return kernel_.hits(depth.data(), rays.data(), static_cast<int>(depth.shape(0)),
                            static_cast<int>(depth.shape(1)), first_row, first_col, stride, range, matrix.data(),
                            offset.data(), voxels.data(), hit_depth.data());
    }

    void counts(Image depth, Rays rays, float range, InFlat matrix, InFlat offset, Plane<std::uint16_t> out) {
        require_rays(depth, rays, matrix, offset);
        require(out.shape(0) == depth.shape(0) && out.shape(1) == depth.shape(1), "one count per pixel is given");
        nb::gil_scoped_release release;
        kernel_.counts(voxels_, depth.data(), rays.data(), static_cast<int>(depth.shape(0)),
                       static_cast<int>(depth.shape(1)), range, matrix.data(), offset.data(), out.data(), work_.parallel());
    }

    std::int64_t free_left(Blocks heavy, int low, int high, int miss, std::int32_t frame) {
        require(heavy.shape(0) == static_cast<std::size_t>(voxels_.rows >> anm::kBlockShift) &&
                    heavy.shape(1) == static_cast<std::size_t>(voxels_.cols >> anm::kBlockShift),
                "one truth value per column of blocks is given");
        nb::gil_scoped_release release;
        return anm::LeftVoxels(voxels_, heavy.data(), low, high, miss, frame).free();
    }

    std::int64_t moved(Image depth, Rays rays, InFlat matrix, InFlat offset, float edge, float noise, float doubt, float turn,
                       float range, int free, int known, int support, float reach_m, float focal_px, float apart_m,
                       float apart_share, Plane<std::uint8_t> out) {
        require_rays(depth, rays, matrix, offset);
        require(out.shape(0) == depth.shape(0) && out.shape(1) == depth.shape(1), "one truth value per pixel is given");
        require(edge > 0.0F && focal_px > 0.0F, "the voxels' edge and the focal length are above zero");
        const anm::MovedSettings settings{edge,    noise,    doubt,   turn,        range, free, known, support,
                                          reach_m, focal_px, apart_m, apart_share};
        nb::gil_scoped_release release;
        const anm::MovedPixels pixels(voxels_, depth.data(), rays.data(), static_cast<int>(depth.shape(0)),
                                      static_cast<int>(depth.shape(1)), matrix.data(), offset.data(), settings);
        return pixels.find(out.data(), work_.parallel());
    }

private:
    static const anm::OccupancyKernel& find(const std::string& name) {
        const std::string known = find_kernel(name).name;
#ifdef ANM_X86
        if (known == "v4") return anm::occupancy_v4();
        if (known == "v3") return anm::occupancy_v3();
        return anm::occupancy_v2();
#else
        return anm::occupancy_generic();
#endif
    }

    static void require_rays(const Image& depth, const Rays& rays, const InFlat& matrix, const InFlat& offset) {
        require(rays.shape(0) == depth.shape(0) && rays.shape(1) == depth.shape(1) && rays.shape(2) == 3,
                "one ray per pixel is needed");
        require(matrix.size() == 9 && offset.size() == 3, "a matrix has nine numbers, an offset three");
    }

    void require_inside(const std::int64_t* low, const std::int64_t* high) const {
        const std::int64_t size[3] = {voxels_.cols, voxels_.rows, voxels_.layers};
        for (int axis = 0; axis < 3; ++axis) {
            require(high[axis] < low[axis] || (low[axis] >= voxels_.corner[axis] && high[axis] < voxels_.corner[axis] + size[axis]),
                    "voxels lie outside the grid");
        }
    }

    const anm::OccupancyKernel& kernel_;
    Workspace work_;
    anm::Voxels voxels_;
};

}  // namespace

void bind_occupancy(nb::module_& m) {
    nb::class_<Occupancy>(m, "Occupancy")
        .def(nb::init<int, const std::string&>(), "num_threads"_a, "kernel"_a)
        // Not converted: a copy would be gone when the call returns.
        .def("bind", &Occupancy::bind, "log_odds"_a.noconvert(), "state"_a.noconvert(), "seen_range"_a.noconvert(),
             "num_hits"_a.noconvert(), "block_stamp"_a.noconvert(), "column_version"_a.noconvert(), "corner"_a)
        .def("carve", &Occupancy::carve, "depth"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a, "rotation"_a, "position"_a,
             "low"_a, "high"_a, "edge"_a, "margin"_a, "footprint_px"_a, "nearest"_a, "furthest"_a, "miss"_a, "limit"_a,
             "no_depth_is_free"_a, "frame"_a, "heavy"_a, "heavy_miss"_a)
        .def("mark", &Occupancy::mark, "voxels"_a, "depth"_a, "range_step"_a, "hit"_a, "limit"_a, "frame"_a)
        .def("hits", &Occupancy::hits, "depth"_a, "rays"_a, "first_row"_a, "first_col"_a, "stride"_a, "range"_a,
             "matrix"_a, "offset"_a, "voxels"_a, "hit_depth"_a)
        .def("counts", &Occupancy::counts, "depth"_a, "rays"_a, "range"_a, "matrix"_a, "offset"_a, "out"_a)
        .def("free_left", &Occupancy::free_left, "heavy"_a, "low"_a, "high"_a, "miss"_a, "frame"_a)
        .def("moved", &Occupancy::moved, "depth"_a, "rays"_a, "matrix"_a, "offset"_a, "edge"_a, "noise"_a, "doubt"_a, "turn"_a,
             "range"_a, "free"_a, "known"_a, "support"_a, "reach_m"_a, "focal_px"_a, "apart_m"_a, "apart_share"_a,
             "out"_a);
}
