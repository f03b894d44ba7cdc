// Work buffers and tasks, as the bindings provide them, and how rays are laid out in memory.
#pragma once

#include "encoding.h"

namespace {

using anm::Arena;
using anm::kBlockAlign;
using anm::Parallel;
using anm::round_up;

// Keys of the arena's buffers; those of workers follow, kWorkerStride apart.
enum Key {
    kSlots,
    kFeatures,
    kOtherSlots,
    kOtherFeatures,
    kPacked,
    kPartial,
    kSmall,
    kWorkerScratch,
    kWorkerTable,
    kWorkerLattice,
    kNumKeys
};

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

}  // namespace
