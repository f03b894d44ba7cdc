// The training engine as Python sees it: one per neural map.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

#include "bindings.h"
#include "buffer.h"

namespace {

class Engine {
public:
    Engine(const anm::Settings& settings, InFlat cells_per_m,
           nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig> factors,
           nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig> masks, InFlat linspace_free, InFlat linspace_band,
           InFlat linspace_spare, int num_threads, const std::string& kernel)
        : kernel_(find_kernel(kernel)),
          work_(num_threads),
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
        require(settings.free_samples >= 1 && settings.near_samples >= 1 && settings.samples() <= anm::kMaxSamples,
                "a ray has samples before the surface and about it, as many as fit");
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
    int num_threads() const { return work_.num_threads(); }

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
        const float* at = corner_of(corner);
        anm::Losses losses{};
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.step(model_, &rays, 1, &seed, nullptr, &at, nullptr, work_.parallel(), work_.arena(), &losses);
        }
        return as_tuple(losses);
    }

    // Steps by batches of rays, each with its seed and its corner; losses of those that were done.
    nb::list steps(const std::vector<std::tuple<In, In, In, InFlat>>& batches, const std::vector<std::uint32_t>& seeds,
                   const std::vector<std::optional<InFlat>>& corners) {
        const std::size_t count = batches.size();
        require(seeds.size() == count && corners.size() == count, "each batch needs a seed and a corner");
        std::vector<anm::Rays> rays;
        std::vector<const float*> at;
        for (const auto& [origin, direction, rgb, depth] : batches) rays.push_back(as_rays(origin, direction, rgb, depth));
        for (const auto& corner : corners) at.push_back(corner_of(corner));
        std::vector<anm::Losses> losses(count);
        int done = 0;
        if (count > 0) {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            done = kernel_.step(model_, rays.data(), static_cast<int>(count), seeds.data(), nullptr, at.data(), nullptr,
                                work_.parallel(), work_.arena(), losses.data());
        }
        nb::list out;
        for (int k = 0; k < done; ++k) out.append(as_tuple(losses[static_cast<std::size_t>(k)]));
        return out;
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
            const std::uint32_t seed = 0;
            const float* at = corner_of(corner);
            kernel_.step(model_, &rays, 1, &seed, depths.data(), &at, &out, work_.parallel(), work_.arena(), &losses);
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
            kernel_.hidden(model_, points.data(), static_cast<std::int64_t>(points.shape(0)), hidden, work_.parallel(),
                           work_.arena());
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
            kernel_.sensitivity(model_, points.data(), static_cast<std::int64_t>(points.shape(0)), sdf, rgb, work_.parallel(),
                                work_.arena());
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
                           static_cast<int>(depths.shape(1)), rgb, depth, work_.parallel(), work_.arena());
        }
        return nb::make_tuple(rgb_out, depth_out);
    }

    // Normal equations of distances and of colours, [2][6][6] and [2][6], their costs, weights and counts, [2][3].
    nb::tuple align(In points, In rgb, InFlat variance, InFlat trust, In rotation, InFlat position,
                    const std::tuple<float, float, float>& slopes, float field_variance, float kernel,
                    float color_deviation, float color_kernel) {
        require_points(points);
        const std::size_t count = points.shape(0);
        require(rgb.shape(0) == count && rgb.shape(1) == 3 && variance.size() == count && trust.size() == count,
                "colour, variance and trust need a row per point");
        require(rotation.shape(0) == 3 && rotation.shape(1) == 3 && position.size() == 3, "a pose is 3 x 3 and 3");
        const anm::FramePoints frame{points.data(), rgb.data(), variance.data(), trust.data(), static_cast<int>(count)};
        anm::Alignment at;
        std::memcpy(at.rotation, rotation.data(), sizeof at.rotation);
        std::memcpy(at.position, position.data(), sizeof at.position);
        std::tie(at.saturation, at.least_slope, at.most_slope) = slopes;
        at.field_variance = field_variance;
        at.kernel = kernel;
        at.color_deviation = color_deviation;
        at.color_kernel = color_kernel;
        anm::NormalEquations sums[2];
        {
            nb::gil_scoped_release release;
            const std::lock_guard<std::mutex> lock(mutex_);
            kernel_.align(model_, frame, at, sums, work_.parallel(), work_.arena());
        }
        return as_arrays(sums);
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
                      work_.parallel(), work_.arena());
    }

    const anm::Kernel& kernel_;
    Workspace work_;
    std::vector<float> free_, band_, spare_;
    std::size_t table_size_;
    Buffer table_, table_m_, table_v_, touched_, decoders_, decoders_m_, decoders_v_;
    anm::Model model_;
    std::mutex mutex_;
};

}  // namespace

void bind_engine(nb::module_& m) {
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
        .def("steps", &Engine::steps, "batches"_a, "seeds"_a, "corners"_a)
        .def("gradients", &Engine::gradients, "origin"_a, "direction"_a, "rgb"_a, "depth"_a, "depths"_a,
             "corner"_a.none())
        .def("sample", &Engine::sample, "depth"_a, "seed"_a)
        .def("query_sdf", &Engine::query_sdf, "points"_a)
        .def("query_rgb", &Engine::query_rgb, "points"_a)
        .def("query_perturbed", &Engine::query_perturbed, "points"_a, "decoders"_a)
        .def("query_hidden", &Engine::query_hidden, "points"_a)
        .def("query_sensitivity", &Engine::query_sensitivity, "points"_a)
        .def("render", &Engine::render, "origin"_a, "direction"_a, "depths"_a)
        .def("align", &Engine::align, "points"_a, "rgb"_a, "variance"_a, "trust"_a, "rotation"_a, "position"_a,
             "slopes"_a, "field_variance"_a, "kernel"_a, "color_deviation"_a, "color_kernel"_a);
}
