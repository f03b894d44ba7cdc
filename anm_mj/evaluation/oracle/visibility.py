"""What each view of a known scene would show: for every place and yaw the samples that it covers, as bits."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, UInt64

from anm_mj.evaluation.coverage import COVERED_M
from anm_mj.evaluation.pixel_rays import NUM_YAWS, PixelRays

PROMISED_M = 0.06
"""A sample that one ray misses by less than this counts as covered [m]: other frames on the way look from between the
places, and of several one comes within 5 cm."""
NEAR_MISS_M = 0.4
"""A sample that a ray misses by less than this may be covered by another [m]."""
_OUT = 0.8 * COVERED_M
ASIDE_M = np.array(
    [(0, 0, 0), (0, 0, _OUT), (0, 0, -_OUT), (_OUT, 0, 0), (-_OUT, 0, 0), (0, _OUT, 0), (0, -_OUT, 0)] * 2, np.float32
)
"""How far beside a sample rays are sent, one after the other [m]."""
FAR_M = 10.5
"""Samples farther than this in the plane are not looked for [m]; few pixels come near them."""
WORD = 64
"""Bits of a word."""


def frame_bits(
    samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"], rays: PixelRays
) -> UInt64[np.ndarray, "p yaws words"]:
    """The samples that a frame covers, for every place and yaw, a bit for each sample.

    A sample counts for a yaw if it lies in the picture and the pixel nearest to it hits within 5 cm of it when the
    camera looks towards it, so that one ray is cast for a place and a sample and not one for each yaw.

    Args:
        samples: On the surface, world [m]; a multiple of 64.
        places_m: Where the robot's axis stands.
        rays: The camera.
    """
    bits = np.zeros((len(places_m), NUM_YAWS, len(samples) // WORD), np.uint64)
    for place, xy_m in enumerate(places_m.astype(np.float32)):
        which, towards = _seen(samples, xy_m, rays)
        shown = np.zeros((NUM_YAWS, len(samples)), bool)
        for turn in rays.yaws_aside:
            yaw = (towards + turn) % NUM_YAWS
            inside = rays.in_picture(samples[which], xy_m, yaw)
            shown[yaw[inside], which[inside]] = True
        bits[place] = pack(shown)
    return bits


def pack(flags: Bool[np.ndarray, "k n"]) -> UInt64[np.ndarray, "k words"]:
    """Flags as bits; their number a multiple of 64."""
    return np.packbits(flags, axis=1, bitorder="little").view(np.uint64)


def unpack(bits: UInt64[np.ndarray, " words"]) -> Bool[np.ndarray, " n"]:
    """Bits as flags."""
    return np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), bitorder="little").astype(bool)


def count(bits: UInt64[np.ndarray, "*k words"]) -> Int[np.ndarray, "*k"]:
    """How many bits are set."""
    return np.asarray(np.bitwise_count(bits).sum(axis=-1, dtype=np.int64))


def _seen(
    samples: Float32[np.ndarray, "n 3"], place_m: Float32[np.ndarray, "2"], rays: PixelRays
) -> tuple[Int32[np.ndarray, " k"], Int32[np.ndarray, " k"]]:
    """Samples covered by the pixel nearest to each when the camera looks towards it, and the yaws towards them."""
    delta = samples[:, :2] - place_m
    which = np.flatnonzero(np.hypot(delta[:, 0], delta[:, 1]) < FAR_M).astype(np.int32)
    towards = rays.yaw_towards(delta[which])
    inside = rays.in_picture(samples[which], place_m, towards)
    which, towards = which[inside], towards[inside]
    places_m = np.broadcast_to(place_m, (len(which), 2))
    hit = aimed(samples[which], places_m, towards, rays, PROMISED_M)
    return which[hit], towards[hit]


def aimed(
    samples: Float32[np.ndarray, "n 3"],
    places_m: Float32[np.ndarray, "n 2"],
    towards: Int32[np.ndarray, " n"],
    rays: PixelRays,
    within_m: float,
) -> Bool[np.ndarray, " n"]:
    """Which samples are hit within a distance by one of several rays cast about each.

    Args:
        samples: World [m].
        places_m: Where the robot's axis stands for each.
        towards: The yaw towards each.
        rays: The camera.
        within_m: How near a hit is to be.
    """
    order = np.argsort(np.abs(rays.yaws_aside), kind="stable")
    hit = np.zeros(len(samples), bool)
    again = np.arange(len(samples))
    # What hides just behind an edge or below a thin board is covered by what is seen beside it, and what the pixels of
    # one yaw just miss those of the next one hit: a robot turns and moves while it looks.
    for aside_m, turn in zip(ASIDE_M, np.resize(rays.yaws_aside[order], len(ASIDE_M)), strict=True):
        targets = samples[again]
        hits = rays.hits(targets + aside_m, places_m[again], (towards[again] + turn) % NUM_YAWS)
        miss_m = np.linalg.norm(hits - targets, axis=1)
        hit[again[miss_m < within_m]] = True
        again = again[(miss_m >= within_m) & (miss_m < NEAR_MISS_M)]
    return hit
