"""Samples along rays (:mod:`anm_mj.mapping.sampling`), and which of them say free and which near the surface."""

from typing import no_type_check

import triton
import triton.language as tl


@triton.jit
@no_type_check
def _mix(x):
    """The 32-bit mixer of :func:`anm_mj.mapping.sampling.counter_uniform`."""
    x = (x ^ (x >> 16)) * tl.full((), 0x7FEB352D, tl.uint32)
    x = (x ^ (x >> 15)) * tl.full((), 0x846CA68B, tl.uint32)
    return x ^ (x >> 16)


@triton.jit
@no_type_check
def _guided(k, depth, hit, jitter, TRUNCATION: tl.constexpr, FREE: tl.constexpr, NEAR: tl.constexpr, NONE_STEP):
    """One sample in each of equal bins over the free part and over the band, or over all where there is no depth."""
    start = tl.maximum(depth - TRUNCATION, 0.0)
    width = depth + TRUNCATION - start
    free = (k.to(tl.float32) + jitter) * tl.div_rn(start, tl.full((), FREE, tl.float32))
    near = start + ((k - FREE).to(tl.float32) + jitter) * tl.div_rn(width, tl.full((), NEAR, tl.float32))
    none = (k.to(tl.float32) + jitter) * NONE_STEP
    return tl.where(hit, tl.where(k < FREE, free, near), none)


@triton.jit
@no_type_check
def _uniform(k, depth, hit, jitter, spaced, FREE: tl.constexpr, NEAR: tl.constexpr):
    """Even samples and such about the surface, sorted together and moved between their neighbours' middles."""
    count: tl.constexpr = FREE + NEAR
    is_near = (k >= FREE) & (k < count)
    # The first FREE values, then offsets in the band, then what replaces them on rays without depth.
    even = tl.load(spaced + k, mask=k < FREE, other=0.0)
    band = tl.load(spaced + k, mask=is_near, other=0.0)
    spare = tl.load(spaced + k + NEAR, mask=is_near, other=0.0)
    z = tl.where(is_near, tl.maximum(tl.where(hit, depth + band, spare), 0.0), even)
    z = tl.where(k < count, z, float("inf"))
    # Sorting by counting what comes before: rays are short.
    mine, other = z[:, :, None], z[:, None, :]
    earlier = (other < mine) | ((other == mine) & (k[:, None, :] < k[:, :, None]))
    rank = tl.sum(earlier.to(tl.int32), axis=2)[:, :, None]
    place = k[:, None, :]
    here = tl.sum(tl.where(rank == place, mine, 0.0), axis=1)
    before = tl.sum(tl.where(rank == place - 1, mine, 0.0), axis=1)
    after = tl.sum(tl.where(rank == place + 1, mine, 0.0), axis=1)
    lower = tl.where(k == 0, here, 0.5 * (here + before))
    upper = tl.where(k == count - 1, here, 0.5 * (after + here))
    moved = lower + (tl.where(k < count, upper, 0.0) - tl.where(k < count, lower, 0.0)) * jitter
    return tl.where(k < count, moved, 0.0)


@triton.jit
@no_type_check
def supervision(z, depth, hit, used, TRUNCATION: tl.constexpr, NO_DEPTH_IS_FREE: tl.constexpr):
    """Which samples ("RAYS SAMPLES_PAD") are to be free, and which lie in the band about the surface.

    ``depth``, zero without a surface, and ``hit`` are "RAYS 1".
    """
    in_front = z < depth - TRUNCATION
    in_band = used & hit & (in_front == 0) & (z <= depth + TRUNCATION)
    free = used & (in_front | (hit == 0)) if NO_DEPTH_IS_FREE else used & in_front & hit
    return free, in_band


@triton.jit
@no_type_check
def sample_kernel(
    header,
    rays,
    capacity,
    spaced,
    z_out,
    points_out,
    counts,
    none_step,
    max_depth,
    GUIDED: tl.constexpr,
    FREE: tl.constexpr,
    NEAR: tl.constexpr,
    SAMPLES_PAD: tl.constexpr,
    TRUNCATION: tl.constexpr,
    NO_DEPTH_IS_FREE: tl.constexpr,
    RAYS: tl.constexpr,
):
    """Depths and world points of all samples, and how many are free, in the band, and how many rays have depth.

    ``header`` holds the number of rays and the seed; ``rays`` ("10 capacity") origin, direction, colour, depth;
    ``spaced`` ("FREE+2*NEAR") what the uniform scheme is made of. ``z_out`` is "capacity samples", ``points_out`` "3
    capacity*samples" [m], both written for the rays there are; ``counts`` ("3") must be zero. To be launched without
    fused multiply-adds, so that points are those of the other engines bit for bit.
    """
    samples: tl.constexpr = FREE + NEAR
    num_rays = tl.load(header)
    seed = tl.load(header + 1).to(tl.uint32, bitcast=True)
    ray = tl.program_id(0) * RAYS + tl.arange(0, RAYS)[:, None]
    k = tl.zeros((RAYS, 1), tl.int32) + tl.arange(0, SAMPLES_PAD)[None, :]
    inside = ray < num_rays
    depth = tl.load(rays + 9 * capacity + ray, mask=inside, other=0.0)
    hit = (depth > 0.0) & (depth <= max_depth)
    depth = tl.where(hit, depth, 0.0)
    bits = _mix(_mix((ray * samples + k).to(tl.uint32)) ^ _mix(seed))
    jitter = (bits >> 8).to(tl.float32) * 5.9604644775390625e-08
    if GUIDED:
        z = _guided(k, depth, hit, jitter, TRUNCATION, FREE, NEAR, none_step)
    else:
        z = _uniform(k, depth, hit, jitter, spaced, FREE, NEAR)
    used = inside & (k < samples)
    free, in_band = supervision(z, depth, hit, used, TRUNCATION, NO_DEPTH_IS_FREE)
    tl.atomic_add(counts, tl.sum(tl.sum(free.to(tl.int32), axis=1), axis=0))
    tl.atomic_add(counts + 1, tl.sum(tl.sum(in_band.to(tl.int32), axis=1), axis=0))
    tl.atomic_add(counts + 2, tl.sum(tl.sum((hit & inside).to(tl.int32), axis=1), axis=0))
    slot = ray * samples + k
    tl.store(z_out + slot, z, mask=used)
    for axis in tl.static_range(3):
        origin = tl.load(rays + axis * capacity + ray, mask=inside, other=0.0)
        direction = tl.load(rays + (3 + axis) * capacity + ray, mask=inside, other=0.0)
        tl.store(points_out + axis * capacity * samples + slot, origin + direction * z, mask=used)
