// How strongly the decoders' weights act on the outputs at points.
#pragma once

#include "query.h"

namespace {

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

}  // namespace
