// What the bindings and the kernel share. The kernel is one translation unit, compiled once per instruction set; to
// keep code of a newer set out of what an older processor runs, it defines nothing that the linker could merge with
// another unit's copy: it uses no templates of the standard library, and its own things live in an unnamed namespace.
#pragma once

#include <cstddef>
#include <cstdint>

namespace anm {

constexpr int kMaxLevels = 32;
constexpr int kMaxSamples = 1024;  // of a ray
constexpr int kGroup = 16;          // slots whose features lie together: 16 pairs of floats are two cache lines
constexpr int kBlockAlign = 8;      // a block of rays starts at a multiple of so many slots
constexpr int kWidthAlign = 16;     // rows of activations are padded to so many floats
constexpr int kGradientTasks = 32;  // fixed, so that sums do not depend on the number of threads

constexpr int round_up(int value, int multiple) { return (value + multiple - 1) / multiple * multiple; }

struct Level {
    float cells_per_m;
    std::uint32_t factor[3];
    std::uint32_t mask[3];
};

// Shape of the field, settings of training; see anm_mj/mapping/mapping_config.py for what each means.
struct Settings {
    int levels = 0, log2_table_size = 0, bins = 0, hidden = 0, geometry = 0;
    float bins_per_m[3] = {0.0F, 0.0F, 0.0F};
    float truncation = 0.0F;
    bool guided = true;
    int free_samples = 0, near_samples = 0;
    float max_depth = 0.0F, none_step = 0.0F;
    float weight_rgb = 0.0F, weight_depth = 0.0F, weight_sdf = 0.0F, weight_free = 0.0F, weight_smoothness = 0.0F;
    int smoothness_points = 0;
    float smoothness_spacing = 0.0F;
    float no_depth_rgb = 0.0F;
    bool no_depth_is_free = true;
    double table_rate = 0.0, decoder_rate = 0.0, beta1 = 0.0, beta2 = 0.0, epsilon = 0.0, decoder_decay = 0.0;

    int entries() const { return 1 << log2_table_size; }
    int features() const { return 2 * levels; }
    int blob() const { return 3 * bins; }
    int blob_rows() const { return 3 * (bins + 2); }  // as the kernel stores their weights: see one_blob.h
    int outputs() const { return 1 + geometry; }
    int hidden_pad() const { return round_up(hidden, kWidthAlign); }
    int outputs_pad() const { return round_up(outputs(), kWidthAlign); }
    int features_pad() const { return round_up(features(), kWidthAlign); }
    int samples() const { return free_samples + near_samples; }
    int sdf_inputs() const { return features() + blob(); }
    int color_inputs() const { return blob() + geometry; }
    int decoder_size() const {
        return hidden * sdf_inputs() + outputs() * hidden + hidden * color_inputs() + 3 * hidden;
    }
    // Decoders as the kernel reads them, and their gradients: see PackedDecoders in decoder.h.
    int packed_size() const {
        return hidden_pad() * (2 * blob_rows() + features() + 2 * outputs_pad() + 4) +
               hidden_pad() * (features_pad() + 2 * outputs_pad() + kWidthAlign);
    }
    int gradient_size() const { return hidden_pad() * (2 * blob_rows() + features() + 2 * outputs_pad() + 4); }
};

// Parameters, optimiser and work buffers of one engine. All pointers are aligned to 64 bytes and owned by the bindings.
struct Model {
    Settings settings;
    Level level[kMaxLevels];
    const float* linspace_free = nullptr;   // uniform scheme: depths over [0, far]
    const float* linspace_band = nullptr;   // offsets about the measured depth
    const float* linspace_spare = nullptr;  // in their place on rays without depth
    float* table = nullptr;
    float* table_m = nullptr;
    float* table_v = nullptr;
    std::uint8_t* touched = nullptr;  // per line of 8 entries: whether it ever had a gradient
    float* decoders = nullptr;        // all decoder weights in checkpoint order
    float* decoders_m = nullptr;
    float* decoders_v = nullptr;
    std::int64_t iteration = 0;
};

// Runs fn(arg, task, worker) for all tasks in [0, count); workers are numbered from 0.
struct Parallel {
    void (*run)(void* pool, int count, void (*fn)(void* arg, int task, int worker), void* arg) = nullptr;
    void* pool = nullptr;
    int workers = 1;
};

struct Rays {
    const float* origin = nullptr;     // [n][3]
    const float* direction = nullptr;  // [n][3]
    const float* rgb = nullptr;        // [n][3]
    const float* depth = nullptr;      // [n]
    int count = 0;
};

// Where gradients go instead of into the optimiser, in checkpoint order.
struct Gradients {
    float* table = nullptr;
    float* decoders = nullptr;
};

struct Losses {
    double total, rgb, depth, sdf, free_space, smoothness;
};

// Points of a frame in the camera's axes, with what was measured of them.
struct FramePoints {
    const float* camera = nullptr;    // [n][3], m
    const float* rgb = nullptr;       // [n][3], in [0, 1]
    const float* variance = nullptr;  // [n], of the distance along the ray, m2
    const float* trust = nullptr;     // [n], factor on a point's weight; 0 leaves it out
    int count = 0;
};

// A pose at which a frame is compared with the field, and how; see anm_mj/localisation/registration.py.
struct Alignment {
    float rotation[9] = {};  // camera to world, row by row
    float position[3] = {};
    float saturation = 0.0F, least_slope = 0.0F, most_slope = 0.0F;
    float field_variance = 0.0F, kernel = 0.0F;
    float color_deviation = 0.0F, color_kernel = 0.0F;
};

// Sums over residuals of one kind, by the camera's displacement in the world and its rotation vector about itself.
struct NormalEquations {
    double hessian[21] = {};  // upper triangle, row by row
    double gradient[6] = {};
    double cost = 0.0, weight = 0.0, count = 0.0;
};

// Points of a frame in the camera's axes, with their grey values in [0, 1].
struct GrayPoints {
    const float* camera = nullptr;    // [n][3], m
    const float* gray = nullptr;      // [n]
    const float* variance = nullptr;  // [n], as of FramePoints
    const float* trust = nullptr;     // [n]
    int count = 0;
};

constexpr float kMeasured = 65000.0F;  // depth of 16 bits that is not finite reads as at least 65536

// An earlier frame that others are compared with, and where one of them stands to it.
struct KeyView {
    const std::uint16_t* depth = nullptr;  // of 16 bits (IEEE 754); 0 or not finite: not measured, negative: on no plane
    const std::uint8_t* gray = nullptr;    // in 255ths
    int width = 0, height = 0, gray_width = 0, gray_height = 0;
    float gray_share = 1.0F;  // pixels of the grey image to one of depth, along a side: less than 1 where it is coarser
    float fx = 0.0F, fy = 0.0F, cx = 0.0F, cy = 0.0F;  // pixel (u, v) has its centre at (u + 0.5, v + 0.5)
    float noise = 0.0F;       // deviation of its depth: this times its square, 1/m
    int stencil = 1;          // normals come from pixels so far away
    float rotation[9] = {};   // the camera of the frame to this one, row by row
    float position[3] = {};
};

// How a frame is compared with an earlier one.
struct FrameToFrame {
    float deviation = 0.0F;   // of a surface's distance beside the sensors' noise, m
    float kernel = 0.0F;      // of Geman and McClure, in deviations
    float reach = 0.0F;       // points that are farther from the surface are not the same, m
    float edge_share = 0.0F;  // depth that bends by a larger share of itself is an edge
    float gray_deviation = 0.0F, gray_kernel = 0.0F;  // 0 = without grey values
};

// What a common factor of all grey values adds: exposure changes from frame to frame.
struct Gain {
    double cross[6] = {}, square = 0.0, gradient = 0.0;
};

// Sums over points: of distances, then of grey values.
struct FrameSums {
    NormalEquations of[2];
    Gain gain;
};

// Memory that the kernel asks the bindings for; kept between calls, contents undefined unless said.
struct Arena {
    void* owner = nullptr;
    // A buffer of at least `bytes`, aligned to 64; the same key gives the same buffer. Zero-filled when it has to grow.
    void* (*get)(void* owner, int key, std::size_t bytes) = nullptr;
};

struct Roofline {
    double fma_gflops, load_ns, update_ns, stream_gb_per_s;
};

struct Kernel {
    const char* name;
    // `count` training steps, one at least; returns how many were done: the first whose loss is not finite is the last.
    // depths: given sample depths [n][samples] of the first, or null to draw them from the seed. corners: of the
    // smoothness lattices, each may be null. gradients: null to train; else of the only step.
    int (*step)(Model&, const Rays*, int count, const std::uint32_t* seeds, const float* depths,
                const float* const* corners, const Gradients*, const Parallel&, const Arena&, Losses*);
    void (*sample)(const Model&, const Rays&, std::uint32_t seed, float* depths);
    // sdf, rgb: either may be null. decoders: `sets` rows of weights in checkpoint order.
    void (*query)(const Model&, const float* points, std::int64_t count, const float* decoders, int sets, float* sdf,
                  float* rgb, const Parallel&, const Arena&);
    // What the SDF decoder's hidden layer gives, [count][hidden].
    void (*hidden)(const Model&, const float* points, std::int64_t count, float* hidden, const Parallel&, const Arena&);
    void (*sensitivity)(const Model&, const float* points, std::int64_t count, float* sdf, float* rgb, const Parallel&,
                        const Arena&);
    void (*render)(const Model&, const float* origin, const float* direction, const float* depths, int count,
                   int samples, float* rgb, float* depth, const Parallel&, const Arena&);
    // sums: of distances to the surface, then of colours.
    void (*align)(const Model&, const FramePoints&, const Alignment&, NormalEquations* sums, const Parallel&,
                  const Arena&);
    void (*frame_to_frame)(const GrayPoints&, const KeyView&, const FrameToFrame&, FrameSums&);
    void (*roofline)(std::size_t table_bytes, Roofline&);
};

#ifdef ANM_X86
const Kernel& kernel_v2();
const Kernel& kernel_v3();
const Kernel& kernel_v4();
#else
const Kernel& kernel_generic();
#endif

}  // namespace anm
