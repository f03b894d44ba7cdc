// Answers at points: SDF, colours, hidden features, under the model's decoders or others.
#pragma once

#include "decoder.h"
#include "tasks.h"

namespace {

// Points are answered in chunks, so that a chunk's features stay in the cache, each by one task in blocks.
constexpr int kChunk = 8192;
constexpr int kQueryBlock = 64;

constexpr int kGroupsAhead = 3;  // groups of slots whose lines of the table are asked for before they are read

// As encode(), with more lines asked for ahead: training has mostly driven what a query reads out of the near caches.
ANM_INLINE void encode_far(const Level& level, const float* table, const Positions& at, std::ptrdiff_t end,
                           float* features) {
    Corners corners[kGroupsAhead + 1];
    std::ptrdiff_t asked = 0;
    int next = 0, now = 0;
    for (std::ptrdiff_t slot = 0; slot < end; slot += kGroup) {
        for (; asked < end && asked <= slot + kGroupsAhead * kGroup; asked += kGroup) {
            find_corners(level, at, asked, corners[next]);
            prefetch(corners[next], table);
            next = next == kGroupsAhead ? 0 : next + 1;
        }
        interpolate(corners[now], table, features + 2 * slot);
        now = now == kGroupsAhead ? 0 : now + 1;
    }
}

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
        const int end = round_up(slots, kGroup);
        for (int level = 0; level < c.levels; ++level) {
            const float* table = model.table + 2 * static_cast<std::ptrdiff_t>(level) * c.entries();
            float* out = features + level * level_stride;
            // encode() reads small tables in order before.
            if (16 * end >= c.entries()) {
                encode(model.level[level], table, c.entries(), at, 0, end, out);
            } else {
                encode_far(model.level[level], table, at, end, out);
            }
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

template <class Shape>
void hidden_as(const Shape& shape, const Model& model, const float* points, std::int64_t count, const float* packed,
               float* out, const Parallel& parallel, const Arena& arena) {
    const Settings& c = model.settings;
    const PackedDecoders w(c, const_cast<float*>(packed));
    for_each_block(model, points, count, parallel, arena,
                   [&](const ChunkScratch& scratch, const Pairs& grid, std::int64_t first, int size) {
                       const Activations& a = scratch.activations;
                       forward_hidden(c, shape, w, grid, kQueryBlock, a);
                       for (int i = 0; i < size; ++i) {
                           std::memcpy(out + (first + i) * c.hidden, a.hidden + i * shape.hidden(),
                                       sizeof(float) * static_cast<std::size_t>(c.hidden));
                       }
                   });
}

void hidden(const Model& model, const float* points, std::int64_t count, float* out, const Parallel& parallel,
            const Arena& arena) {
    const Settings& c = model.settings;
    float* packed = floats(arena, kPacked, 0, c.packed_size());
    pack(c, model.decoders, packed);
    if (Widths<32, 16>::fits(c)) {
        hidden_as(Widths<32, 16>(c), model, points, count, packed, out, parallel, arena);
    } else {
        hidden_as(Widths<0, 0>(c), model, points, count, packed, out, parallel, arena);
    }
}

}  // namespace
