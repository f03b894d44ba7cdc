// Whole training steps, or the gradients of one. Four phases, each split into tasks whose number and order of sums do not
// depend on the threads:
//   1. blocks of rays: sample depths and positions, count samples per loss term;
//   2. levels: encode all samples on one level, whose table (512 KB) then stays in the second-level cache;
//   3. blocks of rays: decode, render, losses, back to the features, which are overwritten with their gradients;
//   4. levels: scatter the gradients into a table that stays in the cache too, and Adam on it; beside them the
//   decoders.
// Where another step follows, its phase 1 runs with phase 3, and its phase 2 level by level with phase 4, which has just
// brought the level's table into the cache.
#pragma once

#include "adam.h"
#include "rendering.h"
#include "smoothness.h"
#include "tasks.h"

namespace {

using anm::Gradients;
using anm::kGradientTasks;
using anm::Losses;
using anm::Rays;

// One training step, or its gradients.
class Step {
public:
    // Two steps that overlap have different sides.
    Step(Model& model, const Gradients* gradients, const Parallel& parallel, const Arena& arena, int side)
        : model_(model),
          settings_(model.settings),
          gradients_(gradients),
          parallel_(parallel),
          arena_(arena),
          side_(side),
          layout_(1, settings_.samples()) {
        packed_ = floats(arena, kPacked, 0, settings_.packed_size());
        partial_ = floats(arena, kPartial, 0, static_cast<std::size_t>(kGradientTasks) * settings_.gradient_size());
        for (int worker = 0; worker < parallel.workers; ++worker) {
            // Asked for here, because the arena may not grow while tasks run.
            const std::size_t scratch = Activations::size(settings_, layout_.capacity());
            floats(arena, kWorkerScratch, worker, scratch);
            floats(arena, kWorkerTable, worker, 2 * static_cast<std::size_t>(settings_.entries()));
            floats(arena, kWorkerLattice, worker, lattice_size());
        }
    }

    // What the step is made of; see Kernel::step.
    void take(const Rays& rays, std::uint32_t seed, const float* depths, const float* corner) {
        rays_ = rays;
        seed_ = seed;
        depths_ = depths;
        corner_ = corner;
        layout_ = Layout(rays.count, settings_.samples());
        level_stride_ = feature_stride(layout_.padded_slots());
        const std::size_t slots = static_cast<std::size_t>(layout_.padded_slots()) + kGroup;
        float* base = floats(arena_, side_ == 0 ? kSlots : kOtherSlots, 0, 4 * slots);
        for (int axis = 0; axis < 3; ++axis) at_.axis[axis] = base + axis * slots;
        z_ = base + 3 * slots;
        features_ = floats(arena_, side_ == 0 ? kFeatures : kOtherFeatures, 0,
                           static_cast<std::size_t>(settings_.levels * level_stride_));
    }

    // Phases 1 and 2 of a step that follows none.
    void begin() {
        pack(settings_, model_.decoders, packed_);
        run_tasks(parallel_, kGradientTasks, [this](int task, int) { sample_blocks(task); });
        pad_tail();
        run_tasks(parallel_, settings_.levels, [this](int level, int) { encode_level(level); });
    }

    // Phases 3 and 4, with 1 and 2 of the next step, if there is one.
    void end(Step* next, Losses& losses) {
        clear_tail();
        set_scale();
        const int sampled = next != nullptr ? kGradientTasks : 0;
        const bool usual = Widths<32, 16>::fits(settings_);
        run_tasks(parallel_, kGradientTasks + sampled, [this, next, usual](int task, int worker) {
            if (task >= kGradientTasks) {
                next->sample_blocks(task - kGradientTasks);
            } else if (usual) {
                train_blocks(Widths<32, 16>(settings_), task, worker);
            } else {
                train_blocks(Widths<0, 0>(settings_), task, worker);
            }
        });
        if (next != nullptr) next->pad_tail();
        ++model_.iteration;
        run_tasks(parallel_, settings_.levels + 1, [this, next](int task, int worker) {
            if (task == 0) {
                update_decoders();
                if (next != nullptr) pack(settings_, model_.decoders, packed_);
            } else {
                update_level(task - 1, worker);
                if (next != nullptr) next->encode_level(task - 1);
            }
        });
        if (gradients_ != nullptr) --model_.iteration;
        report(losses);
    }

private:
    float* level_table(float* table, int level) const {
        return table + 2 * static_cast<std::ptrdiff_t>(level) * settings_.entries();
    }

    std::size_t lattice_size() const {
        const std::size_t k = settings_.smoothness_points;
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
                const bool hit = has_surface(settings_, measured);
                if (depths_ != nullptr) {
                    std::memcpy(z, depths_ + static_cast<std::ptrdiff_t>(ray) * settings_.samples(),
                                sizeof(float) * settings_.samples());
                } else {
                    sample_ray(model_, measured, seed_, static_cast<std::uint32_t>(ray), z);
                }
                counts.valid += hit;
                for (int j = 0; j < settings_.samples(); ++j, ++slot) {
                    z_[slot] = z[j];
                    place_sample(at_, slot, rays_.origin + 3 * ray, rays_.direction + 3 * ray, z[j]);
                    const Place place = place_of(settings_, hit, measured, z[j]);
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

    void encode_level(int level) {
        encode(model_.level[level], level_table(model_.table, level), settings_.entries(), at_, 0, layout_.padded_slots(),
               features_ + level * level_stride_);
    }

    void pad_tail() {
        for (int slot = layout_.slots(); slot < layout_.padded_slots() + kGroup; ++slot) {
            for (float* axis : at_.axis) axis[slot] = 0.0F;
        }
    }

    // The slots that fill the last group belong to no block, which would replace their features by gradients.
    void clear_tail() {
        for (int slot = layout_.slots(); slot < layout_.padded_slots(); ++slot) {
            for (int level = 0; level < settings_.levels; ++level) {
                store2(features_ + level * level_stride_ + 2 * slot, F2{});
            }
        }
    }

    void set_scale() {
        Counts& all = total_ = Counts();
        for (const Counts& part : counts_) {
            all.free += part.free;
            all.band += part.band;
            all.valid += part.valid;
        }
        const double supervised = static_cast<double>(all.free + all.band > 0 ? all.free + all.band : 1);
        const double samples = static_cast<double>(rays_.count) * settings_.samples();
        // Each term is weighted by the other's share of the supervised samples.
        mean_.free = static_cast<double>(all.band) / supervised / samples;
        mean_.sdf = static_cast<double>(all.free) / supervised / samples;
        mean_.rgb = 1.0 / (3.0 * rays_.count);
        mean_.depth = 1.0 / static_cast<double>(all.valid > 0 ? all.valid : 1);
        scale_.rgb = static_cast<float>(2.0 * settings_.weight_rgb * mean_.rgb);
        scale_.depth = static_cast<float>(2.0 * settings_.weight_depth * mean_.depth);
        scale_.sdf = static_cast<float>(2.0 * settings_.weight_sdf * mean_.sdf * settings_.truncation);
        scale_.free = static_cast<float>(2.0 * settings_.weight_free * mean_.free);
    }

    template <class Shape>
    void train_blocks(const Shape& shape, int task, int worker) {
        const PackedDecoders weights(settings_, packed_);
        float* partial = partial_ + static_cast<std::ptrdiff_t>(task) * settings_.gradient_size();
        std::memset(partial, 0, sizeof(float) * static_cast<std::size_t>(settings_.gradient_size()));
        const PackedDecoders gradient(settings_, partial);
        const Activations a(settings_, layout_.capacity(), floats(arena_, kWorkerScratch, worker, 0));
        const int slots = layout_.block_slots;
        LossSums sums;
        for (int block = first_block(task); block < first_block(task + 1); ++block) {
            const int first = block * slots;
            float* features = features_ + 2 * static_cast<std::ptrdiff_t>(first);
            const Pairs grid{features, level_stride_};
            one_blob(settings_, at_, first, slots, a.blobs);
            forward(settings_, shape, weights, grid, slots, a);
            float* value = a.row;
            float* slope = a.row + a.capacity;
            sdf_to_weight(a.s, slots, value, slope);
            const int first_ray = block * layout_.rays_per_block;
            int slot = 0;
            for (int ray = first_ray; ray < smaller(first_ray + layout_.rays_per_block, rays_.count); ++ray) {
                ray_loss(settings_, scale_, a, slot, z_ + first + slot, value, slope, rays_.depth[ray],
                         rays_.rgb + 3 * ray, sums);
                slot += layout_.samples;
            }
            for (; slot < slots; ++slot) {
                a.grad_sdf[slot] = 0.0F;
                std::memset(a.grad_rgb + 4 * slot, 0, 4 * sizeof(float));
            }
            backward(settings_, shape, weights, gradient, features, level_stride_, slots, a);
        }
        sums_[task] = sums;
    }

    void update_decoders() {
        for (int task = 1; task < kGradientTasks; ++task) {
            const float* part = partial_ + static_cast<std::ptrdiff_t>(task) * settings_.gradient_size();
            for (int i = 0; i < settings_.gradient_size(); ++i) partial_[i] += part[i];
        }
        const AdamScale adam(settings_, settings_.decoder_rate, model_.iteration);
        const float decay = static_cast<float>(settings_.decoder_decay);
        const int size = settings_.decoder_size();
        float* canonical = packed_;  // the packed weights have served
        const PackedDecoders gradient(settings_, partial_);
        fold_ends(gradient.sdf_blob, settings_.bins, settings_.hidden_pad());
        fold_ends(gradient.color_blob, settings_.bins, settings_.hidden_pad());
        for_each_weight(settings_, gradient, [&](int index, const float* g, const float*) { canonical[index] = *g; });
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
        float* grad_table = floats(arena_, kWorkerTable, worker, 0);
        const float* table = level_table(model_.table, level);
        scatter(model_.level[level], at_, layout_.padded_slots(), features_ + level * level_stride_, grad_table);
        smoothness_[level] = 0.0;
        if (corner_ != nullptr) {
            const int k = settings_.smoothness_points;
            float* lattice = floats(arena_, kWorkerLattice, worker, 0);
            smoothness_[level] = smoothness(model_.level[level], table, corner_, settings_.smoothness_spacing, k,
                                            static_cast<float>(settings_.weight_smoothness * smoothness_mean()),
                                            lattice, lattice + 2 * k * k * k, grad_table);
        }
        const int entries = settings_.entries();
        if (gradients_ != nullptr) {
            const std::size_t bytes = 2 * sizeof(float) * static_cast<std::size_t>(entries);
            std::memcpy(level_table(gradients_->table, level), grad_table, bytes);
            std::memset(grad_table, 0, bytes);
            return;
        }
        adam_level(AdamScale(settings_, settings_.table_rate, model_.iteration), entries,
                   level_table(model_.table, level),
                   level_table(model_.table_m, level), level_table(model_.table_v, level),
                   model_.touched + static_cast<std::ptrdiff_t>(level) * (entries / 8), grad_table);
    }

    double smoothness_mean() const {
        const double edge = settings_.smoothness_points + 1.0;
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
        for (int level = 0; level < settings_.levels; ++level) smooth += smoothness_[level];
        out.rgb = all.rgb * mean_.rgb;
        out.depth = all.depth * mean_.depth;
        out.sdf = all.sdf * mean_.sdf;
        out.free_space = all.free * mean_.free;
        out.smoothness = corner_ != nullptr ? smooth * smoothness_mean() : 0.0;
        out.total = settings_.weight_rgb * out.rgb + settings_.weight_depth * out.depth +
                    settings_.weight_sdf * out.sdf + settings_.weight_free * out.free_space +
                    settings_.weight_smoothness * out.smoothness;
    }

    Model& model_;
    const Settings& settings_;
    const Gradients* gradients_;
    const Parallel& parallel_;
    Arena arena_;
    int side_;
    Layout layout_;
    Rays rays_;
    std::uint32_t seed_ = 0;
    const float* depths_ = nullptr;
    const float* corner_ = nullptr;
    std::ptrdiff_t level_stride_ = 0;
    Positions at_{};
    float *z_ = nullptr, *features_ = nullptr, *packed_, *partial_;
    Counts counts_[kGradientTasks], total_;
    LossSums mean_, sums_[kGradientTasks];
    LossScale scale_{};
    double smoothness_[anm::kMaxLevels] = {};
};

int step(Model& model, const Rays* rays, int count, const std::uint32_t* seeds, const float* depths,
         const float* const* corners, const Gradients* gradients, const Parallel& parallel, const Arena& arena,
         Losses* losses) {
    Step sides[2] = {Step(model, gradients, parallel, arena, 0), Step(model, gradients, parallel, arena, 1)};
    sides[0].take(rays[0], seeds[0], depths, corners[0]);
    sides[0].begin();
    for (int k = 0; k < count; ++k) {
        Step* next = nullptr;
        if (k + 1 < count) {
            next = &sides[(k + 1) % 2];
            next->take(rays[k + 1], seeds[k + 1], nullptr, corners[k + 1]);
        }
        sides[k % 2].end(next, losses[k]);
        if (!__builtin_isfinite(losses[k].total)) return k + 1;
    }
    return count;
}

void sample(const Model& model, const Rays& rays, std::uint32_t seed, float* depths) {
    const int samples = model.settings.samples();
    for (int ray = 0; ray < rays.count; ++ray) {
        sample_ray(model, rays.depth[ray], seed, static_cast<std::uint32_t>(ray),
                   depths + static_cast<std::ptrdiff_t>(ray) * samples);
    }
}

}  // namespace
