"""What a tour has left: few samples, each to be seen from a few spots only, which are looked for here.

They hide under boards and behind edges, and a place every quarter of a metre misses most of the spots that show them.
So places are tried at a finer spacing, near a sample all of them and far from it ever fewer, with no more tolerance
than the protocol has, and as few are chosen as show each sample several times (greedy set cover): a robot that moves
and turns by whole steps does not come to stand exactly where it was to.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt64
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from anm_mj.evaluation.coverage import COVERED_M
from anm_mj.evaluation.observable import ReachableArea
from anm_mj.evaluation.oracle.roadmap import spread_places
from anm_mj.evaluation.oracle.visibility import ASIDE_M, FAR_M, WORD, aimed, pack
from anm_mj.evaluation.pixel_rays import NUM_YAWS, PixelRays

FINE_M = 0.1
"""Spacing of the places tried for what is left [m]."""
RING_M = 0.8
"""All of them are tried so near to a sample, a quarter in the ring out to twice as far, and so on [m]."""
TIMES = 3
"""A sample is to be shown by so many places."""
MOST_PLACES = 400
"""So many are chosen at most."""
CHUNK = 1 << 16
"""Pairs of a place and a sample looked at together."""
SEED = 0


def finer_places(samples: Float32[np.ndarray, "n 3"], area: ReachableArea, rays: PixelRays) -> Float[np.ndarray, "k 2"]:
    """Places that show samples, few of them, those that show the most first [m].

    Args:
        samples: On the surface, world [m].
        area: Where the robot can get to.
        rays: Its camera.
    """
    edge_m = np.asarray(distance_transform_edt(np.pad(area.reachable, 1)))[1:-1, 1:-1]
    cells = spread_places(area.reachable, max(1, round(FINE_M / area.resolution_m)), edge_m)
    places_m = area.origin_xy_m + (cells[:, ::-1] + 0.5) * area.resolution_m
    place, sample = _pairs(samples, places_m)
    shown = _shown(samples, places_m.astype(np.float32), place, sample, rays)
    shows = csr_array(
        (np.ones(np.count_nonzero(shown), np.int32), (place[shown], sample[shown])), shape=(len(cells), len(samples))
    )
    wanted = np.full(len(samples), TIMES, np.int32)
    chosen = list[int]()
    while len(chosen) < MOST_PLACES:
        gains = shows @ (wanted > 0).astype(np.int32)
        gains[chosen] = 0
        best = int(np.argmax(gains))
        if gains[best] == 0:
            break
        chosen.append(best)
        wanted -= shows[[best]].toarray()[0]
    return places_m[chosen]


def exact_bits(
    samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"], rays: PixelRays
) -> UInt64[np.ndarray, "p yaws words"]:
    """The samples that a frame covers by the protocol, for every place and yaw, a bit for each, padded to words.

    Unlike :func:`~anm_mj.evaluation.oracle.visibility.frame_bits` every yaw is looked at by itself, with no tolerance.

    Args:
        samples: On the surface, world [m].
        places_m: Where the robot's axis stands.
        rays: The camera.
    """
    words = -(-len(samples) // WORD)
    bits = np.zeros((len(places_m), NUM_YAWS, words), np.uint64)
    places = places_m.astype(np.float32)
    most = max(1, CHUNK // max(len(samples), 1))
    for begin in range(0, len(places), most):
        some = places[begin : begin + most]
        shown = np.zeros((len(some), NUM_YAWS, words * WORD), bool)
        far_m = np.linalg.norm(some[:, None] - samples[None, :, :2], axis=2)
        place, sample = np.nonzero(far_m < FAR_M)
        hit = _shown(samples, some, place, sample, rays)
        place, sample = place[hit], sample[hit]
        towards = rays.yaw_towards(samples[sample, :2] - some[place])
        for turn in rays.yaws_aside:
            yaw = (towards + turn) % NUM_YAWS
            open_ = np.flatnonzero(rays.in_picture(samples[sample], some[place], yaw))
            for aside_m in ASIDE_M[: len(ASIDE_M) // 2]:
                targets = samples[sample[open_]]
                hits = rays.hits(targets + aside_m, some[place[open_]], yaw[open_])
                covered = np.linalg.norm(hits - targets, axis=1) < COVERED_M
                at = open_[covered]
                shown[place[at], yaw[at], sample[at]] = True
                open_ = open_[~covered]
        bits[begin : begin + most] = pack(shown.reshape(-1, words * WORD)).reshape(len(some), NUM_YAWS, words)
    return bits


def _pairs(
    samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Places worth a try for samples, ring by ring: the numbers of both."""
    order = np.random.default_rng(SEED).permutation(len(places_m))
    place, sample = list[Int[np.ndarray, " j"]](), list[Int[np.ndarray, " j"]]()
    for ring in range(math.ceil(math.log2(FAR_M / RING_M)) + 1):
        # Those of a farther ring are among those of a nearer one, so that neighbours try the same.
        some = np.sort(order[: -(-len(order) // 4**ring)])
        outer_m = min(RING_M * 2**ring, FAR_M)
        near = KDTree(samples[:, :2]).sparse_distance_matrix(KDTree(places_m[some]), outer_m, output_type="ndarray")
        near = near[near["v"] >= (RING_M * 2 ** (ring - 1) if ring else 0.0)]
        sample.append(near["i"])
        place.append(some[near["j"]])
    return np.concatenate(place), np.concatenate(sample)


def _shown(
    samples: Float32[np.ndarray, "n 3"],
    places_m: Float32[np.ndarray, "p 2"],
    place: Int[np.ndarray, " k"],
    sample: Int[np.ndarray, " k"],
    rays: PixelRays,
) -> Bool[np.ndarray, " k"]:
    """Which samples are shown from which places, the camera turned towards them."""
    shown = np.zeros(len(place), bool)
    for begin in range(0, len(place), CHUNK):
        part = slice(begin, begin + CHUNK)
        targets, at = samples[sample[part]], places_m[place[part]]
        towards = rays.yaw_towards(targets[:, :2] - at)
        inside = np.flatnonzero(rays.in_picture(targets, at, towards))
        hit = aimed(targets[inside], at[inside], towards[inside], rays, COVERED_M)
        shown[begin + inside[hit]] = True
    return shown
