// The mapper's kernel: whole training steps and queries. Compiled once per instruction set, see CMakeLists.txt.
//
// A step has four phases, each split into tasks whose number and order of sums do not depend on the threads:
//   1. blocks of rays: sample depths and positions, count samples per loss term;
//   2. levels: encode all samples on one level, whose table (512 KB) then stays in the second-level cache;
//   3. blocks of rays: decode, render, losses, back to the features, which are overwritten with their gradients;
//   4. levels: scatter the gradients into a table that stays in the cache too, and Adam on it; beside them the
//   decoders.
#include "adam.h"
#include "rendering.h"
#include "roofline.h"

#ifndef ANM_KERNEL
#define ANM_KERNEL generic
#endif
#define ANM_JOIN_(a, b) a##b
#define ANM_JOIN(a, b) ANM_JOIN_(a, b)
#define ANM_STRING_(a) #a
#define ANM_STRING(a) ANM_STRING_(a)

namespace {

using anm::Arena;
using anm::Gradients;
using anm::kBlockAlign;
using anm::kGradientTasks;
using anm::Losses;
using anm::Parallel;
using anm::Rays;

// Keys of the arena's buffers; those of workers follow, kWorkerStride apart.
enum Key { kSlots, kFeatures, kPacked, kPartial, kSmall, kWorkerScratch, kWorkerTable, kWorkerLattice, kNumKeys };

ANM_INLINE float* floats(const Arena& arena, int key, int worker, std::size_t count) {
    return static_cast<float*>(arena.get(arena.owner, key + worker * kNumKeys, count * sizeof(float)));
}

template <class Fn>
void run_tasks(const Parallel& parallel, int count, Fn&& fn) {
    struct Call {
        static void task(void* arg, int task, int worker) { (*static_cast<Fn*>(arg))(task, worker); }
    };
    parallel.run(parallel.pool, count, &Call::task, &fn);
}

ANM_INLINE int smaller(int a, int b) { return a < b ? a : b; }

// How rays are laid out in slots: blocks of a few whole rays, each padded to a multiple of kBlockAlign.
struct Layout {
    int samples, rays_per_block, block_slots, blocks;

    Layout(int rays, int samples_) : samples(samples_) {
        // Blocks of at most about a hundred slots keep the activations near the first-level cache; among them, the one
        // that pays least for padding and for starting.
        rays_per_block = 1;
        double best = 1e9;
        for (int n = 1; n == 1 || n * samples <= 96; ++n) {
            const int slots = round_up(n * samples, kBlockAlign);
            const double cost = (slots + 8.0) / (n * samples);
            if (cost < best) {
                best = cost;
                rays_per_block = n;
            }
        }
        block_slots = round_up(rays_per_block * samples, kBlockAlign);
        blocks = (rays + rays_per_block - 1) / rays_per_block;
    }

    int slots() const { return blocks * block_slots; }
    int capacity() const { return round_up(block_slots, kGroup); }
    int padded_slots() const { return round_up(slots(), kGroup); }
};

ANM_INLINE void place_sample(const Positions& at, std::ptrdiff_t slot, const float* origin, const float* direction,
                             float z) {
    for (int axis = 0; axis < 3; ++axis) at.axis[axis][slot] = origin[axis] + rounded(direction[axis] * z);
}

// One training step, or its gradients.
class Step {
public:
    Step(Model& model, const Rays& rays, std::uint32_t seed, const float* depths, const float* corner,
         const Gradients* gradients, const Parallel& parallel, const Arena& arena)
        : model_(model),
          c_(model.settings),
          rays_(rays),
          seed_(seed),
          depths_(depths),
          corner_(corner),
          gradients_(gradients),
          parallel_(parallel),
          layout_(rays.count, c_.samples()),
          level_stride_(feature_stride(layout_.padded_slots())) {
        const std::size_t slots = static_cast<std::size_t>(layout_.padded_slots()) + kGroup;
        float* base = floats(arena, kSlots, 0, 4 * slots);
        for (int axis = 0; axis < 3; ++axis) at_.axis[axis] = base + axis * slots;
        z_ = base + 3 * slots;
        features_ = floats(arena, kFeatures, 0, static_cast<std::size_t>(c_.levels * level_stride_));
        packed_ = floats(arena, kPacked, 0, c_.packed_size());
        partial_ = floats(arena, kPartial, 0, static_cast<std::size_t>(kGradientTasks) * c_.gradient_size());
        for (int worker = 0; worker < parallel.workers; ++worker) {
            // Asked for here, because the arena may not grow while tasks run.
            const std::size_t scratch = Activations::size(c_, layout_.capacity());
            floats(arena, kWorkerScratch, worker, scratch);
            floats(arena, kWorkerTable, worker, 2 * static_cast<std::size_t>(c_.entries()));
            if (corner != nullptr) floats(arena, kWorkerLattice, worker, lattice_size());
        }
        arena_ = arena;
    }

    void run(Losses& losses) {
        pack(c_, model_.decoders, packed_);
        run_tasks(parallel_, kGradientTasks, [this](int task, int) { sample_blocks(task); });
        pad_tail();
        run_tasks(parallel_, c_.levels, [this](int level, int) {
            encode(model_.level[level], level_table(model_.table, level), at_, 0, layout_.padded_slots(),
                   features_ + level * level_stride_);
        });
        clear_tail();
        set_scale();
        if (Widths<32, 16>::fits(c_)) {
            run_tasks(parallel_, kGradientTasks,
                      [this](int task, int worker) { train_blocks(Widths<32, 16>(c_), task, worker); });
        } else {
            run_tasks(parallel_, kGradientTasks,
                      [this](int task, int worker) { train_blocks(Widths<0, 0>(c_), task, worker); });
        }
        ++model_.iteration;
        run_tasks(parallel_, c_.levels + 1, [this](int task, int worker) {
            if (task == 0) {
                update_decoders();
            } else {
                update_level(task - 1, worker);
            }
        });
        if (gradients_ != nullptr) --model_.iteration;
        report(losses);
    }

private:
    float* level_table(float* table, int level) const {
        return table + 2 * static_cast<std::ptrdiff_t>(level) * c_.entries();
    }

    std::size_t lattice_size() const {
        const std::size_t k = c_.smoothness_points;
        return 2 * k * k * k + 12 * k;
    }

    int first_block(int task) const {
        return static_cast<int>(static_cast<std::int64_t>(layout_.blocks) * task / kGradientTasks);
    }

    void sample_blocks(int task) {
        Counts counts;
        float z[kMaxSamples + kLanes];
        for (int block = first_block(task); block < first_block(task + 1); ++block) {
            std::ptrdiff_t slot = static_cast<std::ptrdiff_t>(block) * layout_.block_slots;
            const std::ptrdiff_t end = slot + layout_.block_slots;
            const int first = block * layout_.rays_per_block;
            for (int ray = first; ray < smaller(first + layout_.rays_per_block, rays_.count); ++ray) {
                const float measured = rays_.depth[ray];
                const bool hit = has_surface(c_, measured);
                if (depths_ != nullptr) {
                    std::memcpy(z, depths_ + static_cast<std::ptrdiff_t>(ray) * c_.samples(),
                                sizeof(float) * c_.samples());
                } else {
                    sample_ray(model_, measured, seed_, static_cast<std::uint32_t>(ray), z);
                }
                counts.valid += hit;
                for (int j = 0; j < c_.samples(); ++j, ++slot) {
                    z_[slot] = z[j];
                    place_sample(at_, slot, rays_.origin + 3 * ray, rays_.direction + 3 * ray, z[j]);
                    const Place place = place_of(c_, hit, measured, z[j]);
                    counts.free += place == Place::kFree;
                    counts.band += place == Place::kBand;
                }
            }
            for (; slot < end; ++slot) {
                z_[slot] = 0.0F;
                for (float* axis : at_.axis) axis[slot] = 0.0F;
            }
        }
        counts_[task] = counts;
    }

    void pad_tail() {
        for (int slot = layout_.slots(); slot < layout_.padded_slots() + kGroup; ++slot) {
            for (float* axis : at_.axis) axis[slot] = 0.0F;
        }
    }

    // The slots that fill the last group belong to no block, which would replace their features by gradients.
    void clear_tail() {
        for (int slot = layout_.slots(); slot < layout_.padded_slots(); ++slot) {
            for (int level = 0; level < c_.levels; ++level) {
                store2(features_ + level * level_stride_ + 2 * slot, F2{});
            }
        }
    }

    void set_scale() {
        Counts& all = total_;
        for (const Counts& part : counts_) {
            all.free += part.free;
            all.band += part.band;
            all.valid += part.valid;
        }
        const double supervised = static_cast<double>(all.free + all.band > 0 ? all.free + all.band : 1);
        const double samples = static_cast<double>(rays_.count) * c_.samples();
        // Each term is weighted by the other's share of the supervised samples.
        mean_.free = static_cast<double>(all.band) / supervised / samples;
        mean_.sdf = static_cast<double>(all.free) / supervised / samples;
        mean_.rgb = 1.0 / (3.0 * rays_.count);
        mean_.depth = 1.0 / static_cast<double>(all.valid > 0 ? all.valid : 1);
        scale_.rgb = static_cast<float>(2.0 * c_.weight_rgb * mean_.rgb);
        scale_.depth = static_cast<float>(2.0 * c_.weight_depth * mean_.depth);
        scale_.sdf = static_cast<float>(2.0 * c_.weight_sdf * mean_.sdf * c_.truncation);
        scale_.free = static_cast<float>(2.0 * c_.weight_free * mean_.free);
    }

    template <class Shape>
    void train_blocks(const Shape& shape, int task, int worker) {
        const PackedDecoders weights(c_, packed_);
        float* partial = partial_ + static_cast<std::ptrdiff_t>(task) * c_.gradient_size();
        std::memset(partial, 0, sizeof(float) * static_cast<std::size_t>(c_.gradient_size()));
        const PackedDecoders gradient(c_, partial);
        const Activations a(c_, layout_.capacity(), floats(arena_, kWorkerScratch, worker, 0));
        const int slots = layout_.block_slots;
        LossSums sums;
        for (int block = first_block(task); block < first_block(task + 1); ++block) {
            const int first = block * slots;
            float* features = features_ + 2 * static_cast<std::ptrdiff_t>(first);
            const Pairs grid{features, level_stride_};
            one_blob(c_, at_, first, slots, a.blobs);
            forward(c_, shape, weights, grid, slots, a);
            float* value = a.row;
            float* slope = a.row + a.capacity;
            bell(a.s, slots, value, slope);
            const int first_ray = block * layout_.rays_per_block;
            int slot = 0;
            for (int ray = first_ray; ray < smaller(first_ray + layout_.rays_per_block, rays_.count); ++ray) {
                ray_loss(c_, scale_, a, slot, z_ + first + slot, value, slope, rays_.depth[ray], rays_.rgb + 3 * ray,
                         sums);
                slot += layout_.samples;
            }
            for (; slot < slots; ++slot) {
                a.d_s[slot] = 0.0F;
                std::memset(a.d_rgb + 4 * slot, 0, 4 * sizeof(float));
            }
            backward(c_, shape, weights, gradient, features, level_stride_, slots, a);
        }
        sums_[task] = sums;
    }

    void update_decoders() {
        for (int task = 1; task < kGradientTasks; ++task) {
            const float* part = partial_ + static_cast<std::ptrdiff_t>(task) * c_.gradient_size();
            for (int i = 0; i < c_.gradient_size(); ++i) partial_[i] += part[i];
        }
        const AdamScale adam(c_, c_.decoder_rate, model_.iteration);
        const float decay = static_cast<float>(c_.decoder_decay);
        const int size = c_.decoder_size();
        float* canonical = packed_;  // the packed weights have served
        for_each_weight(c_, PackedDecoders(c_, partial_),
                        [&](int index, const float* g, const float*) { canonical[index] = *g; });
        if (gradients_ != nullptr) {
            for (int i = 0; i < size; ++i) gradients_->decoders[i] = canonical[i];
            return;
        }
        // The buffers of the decoders are padded to whole vectors.
        for (int i = 0; i < size; i += kLanes) {
            F g = load(canonical + i) + decay * load(model_.decoders + i);
            adam.update(model_.decoders + i, model_.decoders_m + i, model_.decoders_v + i, g);
        }
    }

    void update_level(int level, int worker) {
        float* d_table = floats(arena_, kWorkerTable, worker, 0);
        const float* table = level_table(model_.table, level);
        scatter(model_.level[level], at_, 0, layout_.padded_slots(), features_ + level * level_stride_, d_table);
        smoothness_[level] = 0.0;
        if (corner_ != nullptr) {
            const int k = c_.smoothness_points;
            float* lattice = floats(arena_, kWorkerLattice, worker, 0);
            smoothness_[level] = smoothness(model_.level[level], table, corner_, c_.smoothness_spacing, k,
                                            static_cast<float>(c_.weight_smoothness * smoothness_mean()), lattice,
                                            lattice + 2 * k * k * k, d_table);
        }
        const int entries = c_.entries();
        if (gradients_ != nullptr) {
            const std::size_t bytes = 2 * sizeof(float) * static_cast<std::size_t>(entries);
            std::memcpy(level_table(gradients_->table, level), d_table, bytes);
            std::memset(d_table, 0, bytes);
            return;
        }
        adam_level(AdamScale(c_, c_.table_rate, model_.iteration), entries, level_table(model_.table, level),
                   level_table(model_.table_m, level), level_table(model_.table_v, level),
                   model_.touched + static_cast<std::ptrdiff_t>(level) * (entries / 8), d_table);
    }

    double smoothness_mean() const {
        const double edge = c_.smoothness_points + 1.0;
        return 1.0 / (edge * edge * edge);
    }

    void report(Losses& out) const {
        LossSums all;
        for (const LossSums& part : sums_) {
            all.rgb += part.rgb;
            all.depth += part.depth;
            all.sdf += part.sdf;
            all.free += part.free;
        }
        double smooth = 0.0;
        for (int level = 0; level < c_.levels; ++level) smooth += smoothness_[level];
        out.rgb = all.rgb * mean_.rgb;
        out.depth = all.depth * mean_.depth;
        out.sdf = all.sdf * mean_.sdf;
        out.free_space = all.free * mean_.free;
        out.smoothness = corner_ != nullptr ? smooth * smoothness_mean() : 0.0;
        out.total = c_.weight_rgb * out.rgb + c_.weight_depth * out.depth + c_.weight_sdf * out.sdf +
                    c_.weight_free * out.free_space + c_.weight_smoothness * out.smoothness;
    }

    Model& model_;
    const Settings& c_;
    const Rays& rays_;
    std::uint32_t seed_;
    const float* depths_;
    const float* corner_;
    const Gradients* gradients_;
    const Parallel& parallel_;
    Arena arena_;
    Layout layout_;
    std::ptrdiff_t level_stride_;
    Positions at_;
    float *z_, *features_, *packed_, *partial_;
    Counts counts_[kGradientTasks], total_;
    LossSums mean_, sums_[kGradientTasks];
    LossScale scale_{};
    double smoothness_[anm::kMaxLevels] = {};
};

void step(Model& model, const Rays& rays, std::uint32_t seed, const float* depths, const float* corner,
          const Gradients* gradients, const Parallel& parallel, const Arena& arena, Losses& losses) {
    Step(model, rays, seed, depths, corner, gradients, parallel, arena).run(losses);
}

void sample(const Model& model, const Rays& rays, std::uint32_t seed, float* depths) {
    const int samples = model.settings.samples();
    for (int ray = 0; ray < rays.count; ++ray) {
        sample_ray(model, rays.depth[ray], seed, static_cast<std::uint32_t>(ray),
                   depths + static_cast<std::ptrdiff_t>(ray) * samples);
    }
}

// Points are answered in chunks, so that a chunk's features stay in the cache, each by one task in blocks.
constexpr int kChunk = 8192;
constexpr int kQueryBlock = 64;

// What one worker needs to answer a chunk.
struct ChunkScratch {
    Positions at;
    std::ptrdiff_t level_stride;
    float* features;
    Activations activations;

    static std::size_t size(const Settings& c, int slots, int block) {
        return 3 * static_cast<std::size_t>(slots) + static_cast<std::size_t>(c.levels * feature_stride(slots)) +
               Activations::size(c, block);
    }

    ChunkScratch(const Settings& c, int slots, int block, float* base)
        : level_stride(feature_stride(slots)),
          features(base + 3 * static_cast<std::size_t>(slots)),
          activations(c, block, features + c.levels * level_stride) {
        for (int axis = 0; axis < 3; ++axis) at.axis[axis] = base + axis * static_cast<std::size_t>(slots);
    }

    void encode_all(const Model& model, int slots) const {
        const Settings& c = model.settings;
        for (int level = 0; level < c.levels; ++level) {
            encode(model.level[level], model.table + 2 * static_cast<std::ptrdiff_t>(level) * c.entries(), at, 0,
                   round_up(slots, kGroup), features + level * level_stride);
        }
    }
};

// Calls answer(scratch, first point, number of points, chunk's first point) for blocks of points, after encoding them.
template <class Answer>
void for_each_block(const Model& model, const float* points, std::int64_t count, const Parallel& parallel,
                    const Arena& arena, const Answer& answer) {
    const Settings& c = model.settings;
    const std::int64_t chunk = count < 4 * kChunk ? kQueryBlock * 16 : kChunk;
    for (int worker = 0; worker < parallel.workers; ++worker) {
        floats(arena, kWorkerScratch, worker, ChunkScratch::size(c, kChunk, kQueryBlock));
    }
    const int tasks = static_cast<int>((count + chunk - 1) / chunk);
    run_tasks(parallel, tasks, [&](int task, int worker) {
        const ChunkScratch scratch(c, kChunk, kQueryBlock, floats(arena, kWorkerScratch, worker, 0));
        const std::int64_t first = task * chunk;
        const int size = static_cast<int>(count - first < chunk ? count - first : chunk);
        for (int i = 0; i < round_up(size, kQueryBlock); ++i) {
            for (int axis = 0; axis < 3; ++axis) {
                scratch.at.axis[axis][i] = i < size ? points[3 * (first + i) + axis] : 0.0F;
            }
        }
        scratch.encode_all(model, round_up(size, kQueryBlock));
        for (int i = 0; i < size; i += kQueryBlock) {
            one_blob(c, scratch.at, i, kQueryBlock, scratch.activations.blobs);
            answer(scratch, Pairs{scratch.features + 2 * i, scratch.level_stride}, first + i,
                   smaller(kQueryBlock, size - i));
        }
    });
}

template <class Shape>
void query_as(const Shape& shape, const Model& model, const float* points, std::int64_t count, const float* packed,
              int sets, float* sdf, float* rgb, const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    for_each_block(model, points, count, parallel, arena,
                   [&](const ChunkScratch& scratch, const Pairs& grid, std::int64_t first, int size) {
                       const Activations& a = scratch.activations;
                       for (int k = 0; k < sets; ++k) {
                           const PackedDecoders w(
                               c, const_cast<float*>(packed) + static_cast<std::ptrdiff_t>(k) * c.packed_size());
                           if (rgb == nullptr) {
                               forward_sdf(c, shape, w, grid, kQueryBlock, a);
                           } else {
                               forward(c, shape, w, grid, kQueryBlock, a);
                           }
                           const std::int64_t row = k * count + first;
                           if (sdf != nullptr) std::memcpy(sdf + row, a.s, sizeof(float) * size);
                           if (rgb == nullptr) continue;
                           for (int i = 0; i < size; ++i) {
                               for (int channel = 0; channel < 3; ++channel) {
                                   rgb[3 * (row + i) + channel] = a.rgb[channel * a.capacity + i];
                               }
                           }
                       }
                   });
}

void query(const Model& model, const float* points, std::int64_t count, const float* decoders, int sets, float* sdf,
           float* rgb, const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    float* packed = floats(arena, kPacked, 0, static_cast<std::size_t>(sets) * c.packed_size());
    for (int k = 0; k < sets; ++k) {
        pack(c, decoders + static_cast<std::ptrdiff_t>(k) * c.decoder_size(),
             packed + static_cast<std::ptrdiff_t>(k) * c.packed_size());
    }
    if (Widths<32, 16>::fits(c)) {
        query_as(Widths<32, 16>(c), model, points, count, packed, sets, sdf, rgb, parallel, arena);
    } else {
        query_as(Widths<0, 0>(c), model, points, count, packed, sets, sdf, rgb, parallel, arena);
    }
}

ANM_INLINE float square_norm(const float* v, int width) {
    F total{};
    for (int n = 0; n < width; n += kLanes) total += load(v + n) * load(v + n);
    return sum(total);
}

constexpr int kMaxWidth = 1024;

// Squared norms of the gradients of s and of the colours (mean over channels) at sample i of a block. A layer's
// gradient is an outer product, so its squared norm is a product of two and no gradient is formed.
void sample_sensitivity(const Settings& c, const PackedDecoders& w, const Pairs& grid, const Activations& a, int i,
                        float& sdf, float& rgb) {
    const int h = c.hidden_pad(), o = c.outputs_pad();
    const float* hidden = a.hidden + i * h;
    const float* color_hidden = a.color_hidden + i * h;
    const float* outputs = a.outputs + i * o;
    float grid_norm = 0.0F, blob_norm = 0.0F, active_norm = 0.0F;
    for (int k = 0; k < c.features(); ++k) grid_norm += grid(i, k) * grid(i, k);
    for (int axis = 0; axis < 3; ++axis) {
        for (int j = 0; j < 3; ++j) blob_norm += a.blobs.mass[axis][j][i] * a.blobs.mass[axis][j][i];
    }
    for (int j = 0; j < h; ++j) active_norm += hidden[j] > 0.0F ? w.sdf_out[j] * w.sdf_out[j] : 0.0F;
    const float input_norm = grid_norm + blob_norm;
    const float hidden_norm = square_norm(hidden, h);
    const float color_norm = square_norm(color_hidden, h);
    const float color_input_norm = blob_norm + square_norm(outputs, o) - outputs[0] * outputs[0];
    sdf = hidden_norm + active_norm * input_norm;
    alignas(64) float back_color[kMaxWidth], back_geometry[kMaxWidth], back_hidden[kMaxWidth];
    float total = 0.0F;
    for (int channel = 0; channel < 3; ++channel) {
        for (int k = 0; k < o; ++k) back_geometry[k] = 0.0F;
        for (int j = 0; j < h; ++j) {
            back_hidden[j] = 0.0F;
            back_color[j] = color_hidden[j] > 0.0F ? w.color_out[channel * h + j] : 0.0F;
            for (int k = 0; k < o; ++k) back_geometry[k] += back_color[j] * w.color_geo_t[j * o + k];
        }
        for (int k = 1; k < o; ++k) {
            for (int j = 0; j < h; ++j) back_hidden[j] += back_geometry[k] * w.sdf_out[k * h + j];
        }
        for (int j = 0; j < h; ++j) back_hidden[j] = hidden[j] > 0.0F ? back_hidden[j] : 0.0F;
        const float color = a.rgb[channel * a.capacity + i];
        const float slope = color * (1.0F - color);
        total += slope * slope *
                 (color_norm + square_norm(back_color, h) * color_input_norm +
                  square_norm(back_geometry, o) * hidden_norm + square_norm(back_hidden, h) * input_norm);
    }
    rgb = total / 3.0F;
}

void sensitivity(const Model& model, const float* points, std::int64_t count, float* sdf, float* rgb,
                 const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    const Widths<0, 0> shape(c);
    float* packed = floats(arena, kPacked, 0, c.packed_size());
    pack(c, model.decoders, packed);
    const PackedDecoders w(c, packed);
    for_each_block(model, points, count, parallel, arena,
                   [&](const ChunkScratch& scratch, const Pairs& grid, std::int64_t first, int size) {
                       forward(c, shape, w, grid, kQueryBlock, scratch.activations);
                       for (int i = 0; i < size; ++i) {
                           sample_sensitivity(c, w, grid, scratch.activations, i, sdf[first + i], rgb[first + i]);
                       }
                   });
}

template <class Shape>
void render_as(const Shape& shape, const Model& model, const float* origin, const float* direction, const float* depths,
               int count, int samples, float* rgb, float* depth, const float* packed, const Parallel& parallel,
               const Arena& arena) {
    const Settings& c = model.settings;
    const PackedDecoders w(c, const_cast<float*>(packed));
    const Layout layout(count, samples);
    const int blocks_per_task = 1 + 2047 / layout.block_slots;
    const int slots = round_up(blocks_per_task * layout.block_slots, kGroup) + kGroup;
    for (int worker = 0; worker < parallel.workers; ++worker) {
        floats(arena, kWorkerScratch, worker, ChunkScratch::size(c, slots, layout.capacity()));
    }
    run_tasks(parallel, (layout.blocks + blocks_per_task - 1) / blocks_per_task, [&](int task, int worker) {
        const ChunkScratch scratch(c, slots, layout.capacity(), floats(arena, kWorkerScratch, worker, 0));
        const Activations& a = scratch.activations;
        const int first_block = task * blocks_per_task;
        const int blocks = smaller(blocks_per_task, layout.blocks - first_block);
        for (int i = 0; i < slots; ++i) {
            for (float* axis : scratch.at.axis) axis[i] = 0.0F;
        }
        for (int block = 0; block < blocks; ++block) {
            const int first_ray = (first_block + block) * layout.rays_per_block;
            int slot = block * layout.block_slots;
            for (int ray = first_ray; ray < smaller(first_ray + layout.rays_per_block, count); ++ray) {
                for (int j = 0; j < samples; ++j, ++slot) {
                    place_sample(scratch.at, slot, origin + 3 * ray, direction + 3 * ray,
                                 depths[static_cast<std::ptrdiff_t>(ray) * samples + j]);
                }
            }
        }
        scratch.encode_all(model, blocks * layout.block_slots);
        for (int block = 0; block < blocks; ++block) {
            const int first = block * layout.block_slots;
            one_blob(c, scratch.at, first, layout.block_slots, a.blobs);
            forward(c, shape, w, Pairs{scratch.features + 2 * first, scratch.level_stride}, layout.block_slots, a);
            bell(a.s, layout.block_slots, a.row, a.row + a.capacity);
            const int first_ray = (first_block + block) * layout.rays_per_block;
            for (int i = 0; i < smaller(layout.rays_per_block, count - first_ray); ++i) {
                const int ray = first_ray + i;
                const Rendered seen = render_ray(a, i * samples, depths + static_cast<std::ptrdiff_t>(ray) * samples,
                                                 samples, c.truncation, a.row);
                std::memcpy(rgb + 3 * ray, seen.rgb, sizeof seen.rgb);
                depth[ray] = seen.depth;
            }
        }
    });
}

void render(const Model& model, const float* origin, const float* direction, const float* depths, int count,
            int samples, float* rgb, float* depth, const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    float* packed = floats(arena, kPacked, 0, c.packed_size());
    pack(c, model.decoders, packed);
    if (Widths<32, 16>::fits(c)) {
        render_as(Widths<32, 16>(c), model, origin, direction, depths, count, samples, rgb, depth, packed, parallel,
                  arena);
    } else {
        render_as(Widths<0, 0>(c), model, origin, direction, depths, count, samples, rgb, depth, packed, parallel,
                  arena);
    }
}

const anm::Kernel kKernel = {ANM_STRING(ANM_KERNEL), step, sample, query, sensitivity, render, measure_roofline};

}  // namespace

namespace anm {

const Kernel& ANM_JOIN(kernel_, ANM_KERNEL)() { return kKernel; }

}  // namespace anm
