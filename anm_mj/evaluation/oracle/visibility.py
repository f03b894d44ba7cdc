"""Visibility in a known scene: the samples that each view covers, as bits."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, UInt64

from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.pixel_rays import PixelRays

TOLERANCE_M = 0.06
"""A sample counts as covered if one ray misses it by less [m]: other frames on the way look from between the places,
and one of them comes within 5 cm."""
NEAR_MISS_M = 0.4
"""If a ray misses a sample by less, another ray may cover it [m]."""
_OUT = 0.8 * COVERED_M
OFFSETS_M = np.array(
    [(0, 0, 0), (0, 0, _OUT), (0, 0, -_OUT), (_OUT, 0, 0), (-_OUT, 0, 0), (0, _OUT, 0), (0, -_OUT, 0)] * 2, np.float32
)
"""Offsets from a sample that rays are aimed at, one after the other [m]."""
FAR_M = 10.5
"""Samples farther than this in the plane are skipped [m]; few pixels come near them."""
WORD = 64
"""Bits of a word."""


def frame_bits(
    samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"], rays: PixelRays
) -> UInt64[np.ndarray, "p yaws words"]:
    """The samples that a frame covers, for every place and yaw: a bit for each sample.

    A sample counts for a yaw if it lies in the image and the pixel nearest to it covers it when the camera looks
    towards it. So one ray serves a place and a sample, not one for each yaw. ``samples`` lie on the surface, world [m],
    a multiple of 64; ``places_m`` are places of the robot's axis.
    """
    bits = np.zeros((len(places_m), NUM_HEADINGS, len(samples) // WORD), np.uint64)
    for place, xy_m in enumerate(places_m.astype(np.float32)):
        delta = samples[:, :2] - xy_m
        which = np.flatnonzero(np.hypot(delta[:, 0], delta[:, 1]) < FAR_M).astype(np.int32)
        towards = rays.yaw_towards(delta[which])
        inside = rays.in_image(samples[which], xy_m, towards)
        which, towards = which[inside], towards[inside]
        hit = covered_by_rays(samples[which], np.broadcast_to(xy_m, (len(which), 2)), towards, rays, TOLERANCE_M)
        which, towards = which[hit], towards[hit]
        shown = np.zeros((NUM_HEADINGS, len(samples)), bool)
        for aside in rays.yaws_aside:
            yaw = (towards + aside) % NUM_HEADINGS
            inside = rays.in_image(samples[which], xy_m, yaw)
            shown[yaw[inside], which[inside]] = True
        bits[place] = pack(shown)
    return bits


def pack(flags: Bool[np.ndarray, "k n"]) -> UInt64[np.ndarray, "k words"]:
    """Flags as bits; n is a multiple of 64."""
    return np.packbits(flags, axis=1, bitorder="little").view(np.uint64)


def unpack(bits: UInt64[np.ndarray, " words"]) -> Bool[np.ndarray, " n"]:
    """Bits as flags."""
    return np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), bitorder="little").astype(bool)


def count(bits: UInt64[np.ndarray, "*k words"]) -> Int[np.ndarray, "*k"]:
    """Number of set bits."""
    return np.asarray(np.bitwise_count(bits).sum(axis=-1, dtype=np.int64))


def covered_by_rays(
    samples: Float32[np.ndarray, "n 3"],
    places_m: Float32[np.ndarray, "n 2"],
    towards: Int32[np.ndarray, " n"],
    rays: PixelRays,
    within_m: float,
) -> Bool[np.ndarray, " n"]:
    """Whether one of several rays about each sample hits within a distance of it. ``places_m`` is the place of the
    robot's axis for each sample, world [m], ``towards`` the yaw towards it.
    """
    order = np.argsort(np.abs(rays.yaws_aside), kind="stable")
    hit = np.zeros(len(samples), bool)
    again = np.arange(len(samples))
    # What is seen beside an edge or a thin board covers what hides just behind it, and the pixels of one yaw hit what
    # those of the next just miss: a robot turns and moves while it looks.
    for offset_m, aside in zip(OFFSETS_M, np.resize(rays.yaws_aside[order], len(OFFSETS_M)), strict=True):
        targets = samples[again]
        hits = rays.hits(targets + offset_m, places_m[again], (towards[again] + aside) % NUM_HEADINGS)
        miss_m = np.linalg.norm(hits - targets, axis=1)
        hit[again[miss_m < within_m]] = True
        again = again[(miss_m >= within_m) & (miss_m < NEAR_MISS_M)]
    return hit
