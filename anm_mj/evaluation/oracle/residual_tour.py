"""Places and views for the samples that tours have left: few samples, each visible from a few spots only.

They hide under boards and behind edges, and places every quarter of a metre miss most of the spots that show them. So
candidates lie denser: all of them near a sample, ever fewer farther away, without more tolerance than the protocol has.
Greedy set cover selects as few as show each sample several times, because a robot that moves and turns by whole steps
does not stop exactly at a place.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt64
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from anm_mj.evaluation.oracle.roadmap import spread_places
from anm_mj.evaluation.oracle.visibility import FAR_M, OFFSETS_M, WORD, covered_by_rays, pack
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.ground_truth.pixel_rays import PixelRays

SPACING_M = 0.1
"""Spacing of candidate places [m]."""
RING_M = 0.8
"""All candidates are tried within this distance of a sample, a quarter in the ring out to twice that, and so on [m]."""
TIMES = 3
"""Places that should show each sample."""
MAX_PLACES = 400
CHUNK = 1 << 16
"""Pairs of a place and a sample processed together; bounds the memory."""
SEED = 0
_Pairs = tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]
"""Indices of places, and of the samples to look at from them."""


def select_places(
    samples: Float32[np.ndarray, "n 3"], area: ReachableArea, rays: PixelRays
) -> Float[np.ndarray, "k 2"]:
    """Few places that show samples, those that show the most first [m]. ``samples`` lie on the surface, world [m]."""
    places_m = area.cell_centres(spread_places(area, SPACING_M))
    place, sample = _pairs(samples, places_m)
    visible = _visible(samples, places_m.astype(np.float32), (place, sample), rays)
    shows = csr_array(
        (np.ones(np.count_nonzero(visible), np.int32), (place[visible], sample[visible])),
        shape=(len(places_m), len(samples)),
    )
    wanted = np.full(len(samples), TIMES, np.int32)
    chosen = list[int]()
    while len(chosen) < MAX_PLACES:
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
    """The samples that a frame covers by the protocol, for every place and yaw: a bit for each, padded to words.

    Unlike :func:`~anm_mj.evaluation.oracle.visibility.frame_bits` it tests every yaw by itself, without tolerance.
    ``samples`` lie on the surface, world [m]; ``places_m`` are places of the robot's axis.
    """
    words = -(-len(samples) // WORD)
    bits = np.zeros((len(places_m), NUM_HEADINGS, words), np.uint64)
    places = places_m.astype(np.float32)
    most = max(1, CHUNK // max(len(samples), 1))
    for begin in range(0, len(places), most):
        some = places[begin : begin + most]
        shown = np.zeros((len(some), NUM_HEADINGS, words * WORD), bool)
        far_m = np.linalg.norm(some[:, None] - samples[None, :, :2], axis=2)
        place, sample = np.nonzero(far_m < FAR_M)
        visible = _visible(samples, some, (place, sample), rays)
        place, sample = place[visible], sample[visible]
        towards = rays.yaw_towards(samples[sample, :2] - some[place])
        for aside in rays.yaws_aside:
            yaw = (towards + aside) % NUM_HEADINGS
            open_ = np.flatnonzero(rays.in_image(samples[sample], some[place], yaw))
            for offset_m in OFFSETS_M[: len(OFFSETS_M) // 2]:
                targets = samples[sample[open_]]
                hits = rays.hits(targets + offset_m, some[place[open_]], yaw[open_])
                covered = np.linalg.norm(hits - targets, axis=1) < COVERED_M
                at = open_[covered]
                shown[place[at], yaw[at], sample[at]] = True
                open_ = open_[~covered]
        bits[begin : begin + most] = pack(shown.reshape(-1, words * WORD)).reshape(len(some), NUM_HEADINGS, words)
    return bits


def _pairs(samples: Float32[np.ndarray, "n 3"], places_m: Float[np.ndarray, "p 2"]) -> _Pairs:
    """Pairs to try, ring by ring."""
    order = np.random.default_rng(SEED).permutation(len(places_m))
    place, sample = list[Int[np.ndarray, " j"]](), list[Int[np.ndarray, " j"]]()
    for ring in range(math.ceil(math.log2(FAR_M / RING_M)) + 1):
        # Candidates of a farther ring are among those of a nearer one, so that neighbouring samples try the same.
        some = np.sort(order[: -(-len(order) // 4**ring)])
        outer_m = min(RING_M * 2**ring, FAR_M)
        near = KDTree(samples[:, :2]).sparse_distance_matrix(KDTree(places_m[some]), outer_m, output_type="ndarray")
        near = near[near["v"] >= (RING_M * 2 ** (ring - 1) if ring else 0.0)]
        sample.append(near["i"])
        place.append(some[near["j"]])
    return np.concatenate(place), np.concatenate(sample)


def _visible(
    samples: Float32[np.ndarray, "n 3"], places_m: Float32[np.ndarray, "p 2"], pairs: _Pairs, rays: PixelRays
) -> Bool[np.ndarray, " k"]:
    """Whether each sample is visible from its place, the camera turned towards it."""
    place, sample = pairs
    visible = np.zeros(len(place), bool)
    for begin in range(0, len(place), CHUNK):
        part = slice(begin, begin + CHUNK)
        targets, at = samples[sample[part]], places_m[place[part]]
        towards = rays.yaw_towards(targets[:, :2] - at)
        inside = np.flatnonzero(rays.in_image(targets, at, towards))
        hit = covered_by_rays(targets[inside], at[inside], towards[inside], rays, COVERED_M)
        visible[begin + inside[hit]] = True
    return visible
