// Rendering of views: many rays, no gradients.
#pragma once

#include "query.h"
#include "rendering.h"

namespace {

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
            sdf_to_weight(a.s, layout.block_slots, a.row, a.row + a.capacity);
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

}  // namespace
