// Python's view of the kernel: one engine per neural map. Compiled for the oldest processor of the platform; picks the
// kernel for the one it runs on.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "coverage.h"
#include "field_blocks.h"
#include "kernel.h"
#include "occupancy.h"
#include "pixels.h"
#include "thread_pool.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using In = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InFlat = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<nb::numpy, float>;
using InFlags = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<nb::numpy, std::uint8_t>;

// Large pages, where the system gives them to those who ask: tables are read at random, and fewer pages are looked up.
constexpr std::size_t kLargePage = std::size_t{1} << 21;

class Buffer {
public:
    explicit Buffer(std::size_t bytes) {
        const std::size_t alignment = bytes < kLargePage ? 64 : kLargePage;
        bytes_ = (bytes + 64 + alignment - 1) / alignment * alignment;
        data_ = std::aligned_alloc(alignment, bytes_);
        if (data_ == nullptr) throw std::bad_alloc();
#if defined(__linux__)
        // A refusal costs speed alone.
        if (alignment == kLargePage) madvise(data_, bytes_, MADV_HUGEPAGE);
#endif
        std::memset(data_, 0, bytes_);
    }
    ~Buffer() { std::free(data_); }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    void* data() const { return data_; }
    float* floats() const { return static_cast<float*>(data_); }
    std::size_t bytes() const { return bytes_; }
    void clear() { std::memset(data_, 0, bytes_); }

private:
    std::size_t bytes_ = 0;
    void* data_ = nullptr;
};

// Names of the kernels that this processor can run, best first.
std::vector<std::string> kernel_names() {
    std::vector<std::string> names;
#ifdef ANM_X86
    __builtin_cpu_init();
    const bool v2 =
        __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt") && __builtin_cpu_supports("ssse3");
    const bool v3 = v2 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    if (v4) names.emplace_back("v4");
    if (v3) names.emplace_back("v3");
    if (v2) names.emplace_back("v2");
#else
    names.emplace_back("generic");
#endif
    return names;
}

const anm::Kernel& find_kernel(const std::string& name) {
    for (const std::string& known : kernel_names()) {
        if (!name.empty() && name != known) continue;
#ifdef ANM_X86
        if (known == "v4") return anm::kernel_v4();
        if (known == "v3") return anm::kernel_v3();
        if (known == "v2") return anm::kernel_v2();
#else
        return anm::kernel_generic();
#endif
    }
    throw nb::value_error(("this processor cannot run the kernel '" + name + "'").c_str());
}

template <std::size_t N>
Out make_array(const std::size_t (&shape)[N], float*& data) {
    std::size_t size = 1;
    for (std::size_t extent : shape) size *= extent;
    data = new float[size > 0 ? size : 1];
    return Out(data, N, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<float*>(p); }));
}

void require(bool ok, const char* message) {
    if (!ok) throw nb::value_error(message);
}

class Engine {
public:
    Engine(const anm::Settings& settings, InFlat cells_per_m,
           nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig> factors,
           nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig> masks, InFlat linspace_free, InFlat linspace_band,
           InFlat linspace_spare, int num_threads, const std::string& kernel)
        : kernel_(find_kernel(kernel)),
          threads_(num_threads),
          free_(copy(linspace_free)),
          band_(copy(linspace_band)),
          spare_(copy(linspace_spare)),
          table_size_(2 * static_cast<std::size_t>(settings.levels) * settings.entries()),
          table_(4 * table_size_),
          table_m_(4 * table_size_),
          table_v_(4 * table_size_),
          touched_(table_size_ / 16 + 64),
          decoders_(4 * static_cast<std::size_t>(settings.decoder_size()) + 64),
          decoders_m_(decoders_.bytes()),
          decoders_v_(decoders_.bytes()) {
        const auto levels = static_cast<std::size_t>(settings.levels);
        require(levels <= anm::kMaxLevels && cells_per_m.shape(0) == levels && factors.shape(0) == 3 &&
                    factors.shape(1) == levels && masks.shape(0) == 3 && masks.shape(1) == levels,
                "one cell size, three factors and three masks per level are needed");
        require(num_threads >= 1, "at least one thread is needed");
        model_.settings = settings;
        for (std::size_t level = 0; level < levels; ++level) {
            model_.level[level].cells_per_m = cells_per_m(level);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                model_.level[level].factor[axis] = static_cast<std::uint32_t>(factors(axis, level));
                model_.level[level].mask[axis] = static_cast<std::uint32_t>(masks(axis, level));
            }
        }
        model_.linspace_free = free_.data();
        model_.linspace_band = band_.data();
        model_.linspace_spare = spare_.data();
        model_.table = table_.floats();
        model_.table_m = table_m_.floats();
        model_.table_v = table_v_.floats();
        model_.touched = static_cast<std::uint8_t*>(touched_.data());
        model_.decoders = decoders_.floats();
        model_.decoders_m = decoders_m_.floats();
        model_.decoders_v = decoders_v_.floats();
    }

    std::string kernel_name() const { return kernel_.name; }
    int num_threads() const { return threads_; }

    void set_state(In table, InFlat decoders) {
        require(table.size() == table_size_, "the table has another size");
        require(decoders.size() == decoder_size(), "the decoders have another size");
        const std::lock_guard<std::mutex> lock(mutex_);
        std::memcpy(model_.table, table.data(), 4 * table_size_);
        std::memcpy(model_.decoders, decoders.data(), 4 * decoder_size());
        for (Buffer* buffer : {&table_m_, &table_v_, &touched_, &decoders_m_, &decoders_v_}) buffer->clear();
        model_.iteration = 0;
    }

    nb::tuple get_state() {
        float *table = nullptr, *decoders = nullptr;
        Out table_out = make_array({table_size_ / 2, std::size_t{2}}, table);
        Out decoders_out = make_array({decoder_size()}, decoders);
        const std::lock_guard<std::mutex> lock(mutex_);
        std::memcpy(table, model_.table, 4 * table_size_);
        std::memcpy(decoders, model_.decoders, 4 * decoder_size());
        return nb::make_tuple(table_out, decoders_out);
    }

    // The optimiser's moments of table and decoders, the table's lines that ever had a gradient, and the iteration.
    nb::tuple get_optimizer() {
        float *table_m = nullptr, *table_v = nullptr, *decoders_m = nullptr, *decoders_v = nullptr;
        Out table_m_out = make_array({table_size_ / 2, std::size_t{2}}, table_m);
        Out table_v_out = make_array({table_size_ / 2, std::size_t{2}}, table_v);
        Out decoders_m_out = make_array({decoder_size()}, decoders_m);
        Out decoders_v_out = make_array({decoder_size()}, decoders_v);
        auto* touched = new std::uint8_t[num_lines() > 0 ? num_lines() : 1];
        Flags touched_out(touched, {num_lines()},
                          nb::capsule(touched, [](void* p) noexcept { delete[] static_cast<std::uint8_t*>(p); }));
        const std::lock_guard<std::mutex> lock(mutex_);
        std::memcpy(table_m, model_.table_m, 4 * table_size_);
        std::memcpy(table_v, model_.table_v, 4 * table_size_);
        std::memcpy(decoders_m, model_.decoders_m, 4 * decoder_size());
        std::memcpy(decoders_v, model_.decoders_v, 4 * decoder_size());
        std::memcpy(touched, model_.touched, num_lines());
        return nb::make_tuple(table_m_out, table_v_out, touched_out, decoders_m_out, decoders_v_out, model_.iteration);
    }

    void set_optimizer(In table_m, In table_v, InFlags touched, InFlat decoders_m, InFlat decoders_v,
                       std::int64_t iteration) {
        require(table_m.size() == table_size_ && table_v.size() == table_size_, "the table's moments have another size");
        require(touched.size() == num_lines(), "the table has another number of lines");
        require(decoders_m.size() == decoder_size() && decoders_v.size() == decoder_size(),
                "the decoders' moments have another size");
        require(iteration >= 0, "an iteration is not negative");
        const std::lock_guard<std::mutex> lock(mutex_);
        std::memcpy(model_.table_m, table_m.data(), 4 * table_size_);
        std::memcpy(model_.table_v, table_v.data(), 4 * table_size_);
        std::memcpy(model_.touched, touched.data(), num_lines());
        std::memcpy(model_.decoders_m, decoders_m.data(), 4 * decoder_size());
        std::memcpy(model_.decoders_v, decoders_v.data(), 4 * decoder_size());
        model_.iteration = iteration;
    }

    nb::tuple step(In origin, In direction, In rgb, InFlat depth, std::uint32_t seed, std::optional<InFlat> corner) {
        const anm::Rays rays = as_rays(origin, direction, rgb, depth);
        anm::Losses losses{};
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.step(model_, rays, seed, nullptr, corner_of(corner), nullptr, parallel(), arena(), losses);
        }
        return as_tuple(losses);
    }

    nb::tuple gradients(In origin, In direction, In rgb, InFlat depth, In depths, std::optional<InFlat> corner) {
        const anm::Rays rays = as_rays(origin, direction, rgb, depth);
        require(depths.shape(0) == depth.shape(0) && depths.shape(1) == samples(),
                "one row of samples per ray is needed");
        anm::Losses losses{};
        anm::Gradients out;
        Out table = make_array({table_size_ / 2, std::size_t{2}}, out.table);
        Out decoders = make_array({decoder_size()}, out.decoders);
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.step(model_, rays, 0, depths.data(), corner_of(corner), &out, parallel(), arena(), losses);
        }
        return nb::make_tuple(as_tuple(losses), table, decoders);
    }

    Out sample(InFlat depth, std::uint32_t seed) {
        anm::Rays rays;
        rays.depth = depth.data();
        rays.count = static_cast<int>(depth.size());
        float* z = nullptr;
        Out out = make_array({depth.size(), samples()}, z);
        kernel_.sample(model_, rays, seed, z);
        return out;
    }

    Out query_sdf(In points) {
        float* sdf = nullptr;
        Out out = make_array({points.shape(0)}, sdf);
        query(points, model_.decoders, 1, sdf, nullptr);
        return out;
    }

    Out query_rgb(In points) {
        float* rgb = nullptr;
        Out out = make_array({points.shape(0), std::size_t{3}}, rgb);
        query(points, model_.decoders, 1, nullptr, rgb);
        return out;
    }

    nb::tuple query_perturbed(In points, In decoders) {
        require(decoders.shape(1) == decoder_size(), "each row must hold all decoder weights");
        float *sdf = nullptr, *rgb = nullptr;
        Out sdf_out = make_array({decoders.shape(0), points.shape(0)}, sdf);
        Out rgb_out = make_array({decoders.shape(0), points.shape(0), std::size_t{3}}, rgb);
        query(points, decoders.data(), static_cast<int>(decoders.shape(0)), sdf, rgb);
        return nb::make_tuple(sdf_out, rgb_out);
    }

    Out query_hidden(In points) {
        require_points(points);
        float* hidden = nullptr;
        Out out = make_array({points.shape(0), static_cast<std::size_t>(model_.settings.hidden)}, hidden);
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.hidden(model_, points.data(), static_cast<std::int64_t>(points.shape(0)), hidden, parallel(),
                           arena());
        }
        return out;
    }

    nb::tuple query_sensitivity(In points) {
        require_points(points);
        float *sdf = nullptr, *rgb = nullptr;
        Out sdf_out = make_array({points.shape(0)}, sdf);
        Out rgb_out = make_array({points.shape(0)}, rgb);
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.sensitivity(model_, points.data(), static_cast<std::int64_t>(points.shape(0)), sdf, rgb, parallel(),
                                arena());
        }
        return nb::make_tuple(sdf_out, rgb_out);
    }

    nb::tuple render(In origin, In direction, In depths) {
        require_points(origin);
        require_points(direction);
        const std::size_t count = depths.shape(0);
        require(origin.shape(0) == count && direction.shape(0) == count, "one origin and direction per ray are needed");
        require(depths.shape(1) >= 1, "at least one sample per ray is needed");
        float *rgb = nullptr, *depth = nullptr;
        Out rgb_out = make_array({count, std::size_t{3}}, rgb);
        Out depth_out = make_array({count}, depth);
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.render(model_, origin.data(), direction.data(), depths.data(), static_cast<int>(count),
                           static_cast<int>(depths.shape(1)), rgb, depth, parallel(), arena());
        }
        return nb::make_tuple(rgb_out, depth_out);
    }

private:
    static std::vector<float> copy(const InFlat& values) { return {values.data(), values.data() + values.size()}; }

    std::size_t decoder_size() const { return static_cast<std::size_t>(model_.settings.decoder_size()); }
    std::size_t num_lines() const { return table_size_ / 16; }
    std::size_t samples() const { return static_cast<std::size_t>(model_.settings.samples()); }

    static void require_points(const In& points) { require(points.shape(1) == 3, "points have three coordinates"); }

    static const float* corner_of(const std::optional<InFlat>& corner) {
        if (!corner) return nullptr;
        require(corner->size() == 3, "a corner has three coordinates");
        return corner->data();
    }

    static anm::Rays as_rays(const In& origin, const In& direction, const In& rgb, const InFlat& depth) {
        const std::size_t count = depth.shape(0);
        require(count >= 1, "at least one ray is needed");
        for (const In* array : {&origin, &direction, &rgb}) {
            require(array->shape(0) == count && array->shape(1) == 3,
                    "origin, direction and colour need a row per depth");
        }
        return {origin.data(), direction.data(), rgb.data(), depth.data(), static_cast<int>(count)};
    }

    static nb::tuple as_tuple(const anm::Losses& l) {
        return nb::make_tuple(l.total, l.rgb, l.depth, l.sdf, l.free_space, l.smoothness);
    }

    void query(const In& points, const float* decoders, int sets, float* sdf, float* rgb) {
        require_points(points);
        nb::gil_scoped_release release;
        const std::lock_guard<std::mutex> lock(mutex_);
        kernel_.query(model_, points.data(), static_cast<std::int64_t>(points.shape(0)), decoders, sets, sdf, rgb,
                      parallel(), arena());
    }

    anm::Parallel parallel() {
        return {[](void* self, int count, void (*fn)(void*, int, int), void* arg) {
                    anm::thread_pool().run(static_cast<Engine*>(self)->threads_, count, fn, arg);
                },
                this, threads_};
    }

    anm::Arena arena() {
        return {this, [](void* self, int key, std::size_t bytes) {
                    auto& slot = static_cast<Engine*>(self)->work_[key];
                    if (!slot || slot->bytes() < bytes) slot = std::make_unique<Buffer>(bytes);
                    return slot->data();
                }};
    }

    const anm::Kernel& kernel_;
    int threads_;
    std::vector<float> free_, band_, spare_;
    std::size_t table_size_;
    Buffer table_, table_m_, table_v_, touched_, decoders_, decoders_m_, decoders_v_;
    std::map<int, std::unique_ptr<Buffer>> work_;
    anm::Model model_;
    std::mutex mutex_;
};

// One per occupancy grid: the memory that its kernels work in. The arrays belong to the grid.
class Occupancy {
public:
    template <class T>
    using Cells = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
    template <class T>
    using Plane = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
    template <class T>
    using Line = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
    using Image = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
    using Rays = nb::ndarray<const float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
    using Places = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
    using Corner = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

    Occupancy(int num_threads, const std::string& kernel) : kernel_(find(kernel)), threads_(num_threads) {
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
               int limit, bool no_depth_is_free, std::int32_t frame) {
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
        anm::CarveSettings settings{edge, margin, footprint_px, nearest, furthest, miss, limit, no_depth_is_free, frame};
        nb::gil_scoped_release release;
        kernel_.carve(voxels_, view, settings, low.data(), high.data(), parallel(), arena());
    }

    void mark(Places voxels, InFlat depth, float range_step, int hit, int limit, std::int32_t frame) {
        require(voxels.shape(1) == 3 && voxels.shape(0) == depth.size(), "one depth per voxel is needed");
        for (std::size_t i = 0; i < depth.size(); ++i) require_inside(voxels.data() + 3 * i, voxels.data() + 3 * i);
        anm::MarkSettings settings{range_step, hit, limit, frame};
        kernel_.mark(voxels_, voxels.data(), depth.data(), static_cast<std::int64_t>(depth.size()), settings, arena());
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
                       static_cast<int>(depth.shape(1)), range, matrix.data(), offset.data(), out.data(), parallel());
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

    anm::Parallel parallel() {
        return {[](void* self, int count, void (*fn)(void*, int, int), void* arg) {
                    anm::thread_pool().run(static_cast<Occupancy*>(self)->threads_, count, fn, arg);
                },
                this, threads_};
    }

    anm::Arena arena() {
        return {this, [](void* self, int key, std::size_t bytes) {
                    auto& slot = static_cast<Occupancy*>(self)->work_[key];
                    if (!slot || slot->bytes() < bytes) slot = std::make_unique<Buffer>(bytes);
                    return slot->data();
                }};
    }

    const anm::OccupancyKernel& kernel_;
    int threads_;
    anm::Voxels voxels_;
    std::map<int, std::unique_ptr<Buffer>> work_;
};

using Grid = nb::ndarray<std::int8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using ConstGrid = nb::ndarray<const std::int8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

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

std::int64_t voxels_to_read(ConstGrid state, Table blocks,
                            nb::ndarray<std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> out) {
    const anm::Extent size = extent_of(state, blocks);
    return anm::voxels_to_read(state.data(), size, blocks.data(), static_cast<std::int64_t>(blocks.shape(0)),
                               out.data(), static_cast<std::int64_t>(out.size()));
}

void write_blocks(ConstGrid state, Table blocks, Indices voxels,
                  nb::ndarray<const std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> read, Grid out,
                  nb::ndarray<std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> moved) {
    const anm::Extent size = extent_of(state, blocks);
    require(out.shape(0) == state.shape(0) && out.shape(1) == state.shape(1) && out.shape(2) == state.shape(2) &&
                read.size() == voxels.size() && moved.size() == blocks.shape(0),
            "the arrays differ in size");
    anm::write_blocks(state.data(), size, blocks.data(), static_cast<std::int64_t>(blocks.shape(0)), voxels.data(),
                      read.data(), static_cast<std::int64_t>(voxels.size()), out.data(), moved.data());
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

// Of the samples that `which` names, the places in it of those within a radius of a point; see coverage.h.
std::int64_t samples_within(nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu> points,
                            nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu> samples,
                            Indices which, double radius,
                            nb::ndarray<std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> out) {
    require(points.shape(1) == 3 && samples.shape(1) == 3, "a point has three coordinates");
    require(radius > 0.0, "a radius is positive");
    require(out.size() >= which.size(), "the output is too small");
    for (std::size_t i = 0; i < which.size(); ++i) {
        require(which(i) >= 0 && which(i) < static_cast<std::int64_t>(samples.shape(0)), "there is no such sample");
    }
    nb::gil_scoped_release release;
    const anm::PointCells cells(points.data(), static_cast<std::int64_t>(points.shape(0)), 2.0 * radius);
    std::int64_t found = 0;
    for (std::size_t i = 0; i < which.size(); ++i) {
        if (cells.any_within(samples.data() + 3 * which.data()[i], radius)) out.data()[found++] = static_cast<std::int64_t>(i);
    }
    return found;
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

NB_MODULE(_native, m) {
    using anm::Settings;
    nb::class_<Settings>(m, "Settings")
        .def(nb::init<>())
        .def_rw("levels", &Settings::levels)
        .def_rw("log2_table_size", &Settings::log2_table_size)
        .def_rw("bins", &Settings::bins)
        .def_rw("hidden", &Settings::hidden)
        .def_rw("geometry", &Settings::geometry)
        .def_prop_rw(
            "bins_per_m",
            [](const Settings& s) { return nb::make_tuple(s.bins_per_m[0], s.bins_per_m[1], s.bins_per_m[2]); },
            [](Settings& s, const std::vector<float>& values) {
                require(values.size() == 3, "bins_per_m has three values");
                for (int axis = 0; axis < 3; ++axis) s.bins_per_m[axis] = values[static_cast<std::size_t>(axis)];
            })
        .def_rw("truncation", &Settings::truncation)
        .def_rw("guided", &Settings::guided)
        .def_rw("free_samples", &Settings::free_samples)
        .def_rw("near_samples", &Settings::near_samples)
        .def_rw("max_depth", &Settings::max_depth)
        .def_rw("none_step", &Settings::none_step)
        .def_rw("weight_rgb", &Settings::weight_rgb)
        .def_rw("weight_depth", &Settings::weight_depth)
        .def_rw("weight_sdf", &Settings::weight_sdf)
        .def_rw("weight_free", &Settings::weight_free)
        .def_rw("weight_smoothness", &Settings::weight_smoothness)
        .def_rw("smoothness_points", &Settings::smoothness_points)
        .def_rw("smoothness_spacing", &Settings::smoothness_spacing)
        .def_rw("no_depth_rgb", &Settings::no_depth_rgb)
        .def_rw("no_depth_is_free", &Settings::no_depth_is_free)
        .def_rw("table_rate", &Settings::table_rate)
        .def_rw("decoder_rate", &Settings::decoder_rate)
        .def_rw("beta1", &Settings::beta1)
        .def_rw("beta2", &Settings::beta2)
        .def_rw("epsilon", &Settings::epsilon)
        .def_rw("decoder_decay", &Settings::decoder_decay);
    nb::class_<Engine>(m, "Engine")
        .def(nb::init<const Settings&, InFlat, nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig>,
                      nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig>, InFlat, InFlat, InFlat, int,
                      const std::string&>(),
             "settings"_a, "cells_per_m"_a, "factors"_a, "masks"_a, "linspace_free"_a, "linspace_band"_a,
             "linspace_spare"_a, "num_threads"_a, "kernel"_a)
        .def_prop_ro("kernel", &Engine::kernel_name)
        .def_prop_ro("num_threads", &Engine::num_threads)
        .def("set_state", &Engine::set_state, "table"_a, "decoders"_a)
        .def("get_state", &Engine::get_state)
        .def("set_optimizer", &Engine::set_optimizer, "table_m"_a, "table_v"_a, "touched"_a, "decoders_m"_a,
             "decoders_v"_a, "iteration"_a)
        .def("get_optimizer", &Engine::get_optimizer)
        .def("step", &Engine::step, "origin"_a, "direction"_a, "rgb"_a, "depth"_a, "seed"_a, "corner"_a.none())
        .def("gradients", &Engine::gradients, "origin"_a, "direction"_a, "rgb"_a, "depth"_a, "depths"_a,
             "corner"_a.none())
        .def("sample", &Engine::sample, "depth"_a, "seed"_a)
        .def("query_sdf", &Engine::query_sdf, "points"_a)
        .def("query_rgb", &Engine::query_rgb, "points"_a)
        .def("query_perturbed", &Engine::query_perturbed, "points"_a, "decoders"_a)
        .def("query_hidden", &Engine::query_hidden, "points"_a)
        .def("query_sensitivity", &Engine::query_sensitivity, "points"_a)
        .def("render", &Engine::render, "origin"_a, "direction"_a, "depths"_a);
    nb::class_<Occupancy>(m, "Occupancy")
        .def(nb::init<int, const std::string&>(), "num_threads"_a, "kernel"_a)
        .def("bind", &Occupancy::bind, "log_odds"_a, "state"_a, "seen_range"_a, "num_hits"_a, "block_stamp"_a,
             "column_version"_a, "corner"_a)
        .def("carve", &Occupancy::carve, "depth"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a, "rotation"_a, "position"_a,
             "low"_a, "high"_a, "edge"_a, "margin"_a, "footprint_px"_a, "nearest"_a, "furthest"_a, "miss"_a, "limit"_a,
             "no_depth_is_free"_a, "frame"_a)
        .def("mark", &Occupancy::mark, "voxels"_a, "depth"_a, "range_step"_a, "hit"_a, "limit"_a, "frame"_a)
        .def("hits", &Occupancy::hits, "depth"_a, "rays"_a, "first_row"_a, "first_col"_a, "stride"_a, "range"_a,
             "matrix"_a, "offset"_a, "voxels"_a, "hit_depth"_a)
        .def("counts", &Occupancy::counts, "depth"_a, "rays"_a, "range"_a, "matrix"_a, "offset"_a, "out"_a);
    m.def("kernel_names", &kernel_names);
    m.def("voxels_to_read", &voxels_to_read, "state"_a, "blocks"_a, "out"_a);
    m.def("write_blocks", &write_blocks, "state"_a, "blocks"_a, "voxels"_a, "read"_a, "out"_a, "moved"_a);
    m.def("ray_batches", &ray_batches, "pixels"_a, "cameras"_a, "place"_a, "keyframe"_a, "depth_unit"_a, "origin"_a,
          "direction"_a, "rgb"_a, "depth"_a);
    m.def("samples_within", &samples_within, "points"_a, "samples"_a, "which"_a, "radius"_a, "out"_a);
    m.def("lend_cores", [](int cores) { anm::thread_pool().lend(cores); }, "cores"_a);
    m.def("roofline", &roofline, "table_bytes"_a, "kernel"_a);
}
