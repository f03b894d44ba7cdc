"""Casts rays through the pooled occupancy, and what those into the unknown are expected to show.

In C++ (``native/gain_rays.h``) where the engine was built, else in NumPy, which gives the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int8, Int32, Int64, UInt8

from anm_mj.types import FREE, UNKNOWN
from anm_mj.utils.native_functions import native_function

RAYS_PER_BATCH = 16_384
"""Rays that NumPy casts at once: the cells of one batch fit into the processor's cache."""


@dataclass(frozen=True)
class Rays:
    """The rays of ``n`` places, ordered by azimuth, then by elevation."""

    hit: Int32[np.ndarray, "n rays"]
    """First cell that is not free, as a flat index into the occupancy."""
    state: Int8[np.ndarray, "n rays"]
    """State of that cell."""
    sample: UInt8[np.ndarray, "n rays"]
    """Number of the sample that lies in it."""
    depth: UInt8[np.ndarray, "n rays"]
    """Where that cell is unknown, the number of unknown cells from there on."""


class GainRule(NamedTuple):
    """What the gain of a ray into the unknown depends on, besides the ray."""

    cell_m: float
    """Edge of a cell [m]."""
    max_depth_m: float
    """Surface is expected no deeper in the unknown than this [m]."""
    range_m: float
    """Nor farther away [m]."""
    suppressed_share: float
    """A cell that was tried has gain from nearer than this share of the distance then."""
    solid_angle: float
    """Area that each ray stands for at a distance of 1 m."""


def cast_again(
    cells: Int8[np.ndarray, "layers rows cols"],
    offset: Int64[np.ndarray, "rays samples"],
    start: Int64[np.ndarray, " p"],
    rows: Int32[np.ndarray, " n"],
    rays: Rays,
) -> None:
    """Cast the rays of some rows again where the cells that they hit have another state now.

    Args:
        cells: the pooled occupancy.
        offset: of each sample of each ray from the cell that it starts in, as flat indices.
        start: the cell that the rays of each row start in, as a flat index.
        rows: which rows.
        rays: of all rows; changed in place.
    """
    native = native_function("cast_rays")
    if native is None:
        numpy_cast_again(cells, offset, start, rows, rays)
    else:
        native(cells, offset, start, rows, rays.hit, rays.state, rays.sample, rays.depth)


def numpy_cast_again(
    cells: Int8[np.ndarray, "layers rows cols"],
    offset: Int64[np.ndarray, "rays samples"],
    start: Int64[np.ndarray, " p"],
    rows: Int32[np.ndarray, " n"],
    rays: Rays,
) -> None:
    """The reference of :func:`cast_again`."""
    places, rays_of = np.nonzero(cells.reshape(-1)[rays.hit[rows]] != rays.state[rows])
    for begin in range(0, len(places), RAYS_PER_BATCH):
        batch = slice(begin, begin + RAYS_PER_BATCH)
        row, ray = rows[places[batch]], rays_of[batch]
        along = offset.take(ray, axis=0)
        along += start[row, None]
        states = cells.reshape(-1).take(along)
        each = np.arange(len(row))
        first = (states != FREE).argmax(axis=1)
        state = states[each, first]
        rays.hit[row, ray], rays.sample[row, ray], rays.state[row, ray] = along[each, first], first, state
        # The extent of the unknown behind the hit tells a room from the back of a chair.
        unknown = np.flatnonzero(state == UNKNOWN)
        first = first[unknown]
        behind = np.arange(states.shape[1], dtype=np.uint8) > first.astype(np.uint8)[:, None]
        ends = (states[unknown] != UNKNOWN) & behind
        ends[:, -1] = True
        rays.depth[row[unknown], ray[unknown]] = ends.argmax(axis=1) - first


def unknown_gains(
    rays: Rays,
    distance_m: Float32[np.ndarray, " samples"],
    layer_share: Float32[np.ndarray, " layers"],
    tried_from_m: Float32[np.ndarray, "layers rows cols"],
    rule: GainRule,
) -> Float32[np.ndarray, "n rays"]:
    """Expected new surface of each ray [m2]; 0 where it does not end in the unknown.

    Args:
        rays: what they hit.
        distance_m: of each sample [m].
        layer_share: how likely it is that what is unknown in a layer holds surface.
        tried_from_m: nearest distance from which a view left each cell unknown; +inf where none did [m].
        rule: what else it depends on.
    """
    native = native_function("ray_gains")
    if native is None:
        return numpy_unknown_gains(rays, distance_m, layer_share, tried_from_m, rule)
    gain_m2 = np.empty(rays.hit.shape, np.float32)
    numbers = np.array(rule, np.float32)
    native(rays.hit, rays.state, rays.sample, rays.depth, distance_m, layer_share, tried_from_m, numbers, gain_m2)
    return gain_m2


def numpy_unknown_gains(
    rays: Rays,
    distance_m: Float32[np.ndarray, " samples"],
    layer_share: Float32[np.ndarray, " layers"],
    tried_from_m: Float32[np.ndarray, "layers rows cols"],
    rule: GainRule,
) -> Float32[np.ndarray, "n rays"]:
    """The reference of :func:`unknown_gains`."""
    cell_m, max_depth_m, range_m, suppressed_share, solid_angle = (np.float32(number) for number in rule)
    gain_m2 = np.zeros(rays.hit.shape, np.float32)
    at = np.nonzero(rays.state == UNKNOWN)
    hit, here_m = rays.hit[at], distance_m[rays.sample[at]]
    # The surface may lie anywhere in the unknown behind the hit.
    behind_m = np.minimum(rays.depth[at] * cell_m, max_depth_m)
    squared = np.minimum(here_m + behind_m, range_m) ** 2
    _, rows, cols = tried_from_m.shape
    squared *= layer_share[hit // (rows * cols)]
    squared[here_m >= suppressed_share * tried_from_m.ravel()[hit]] = 0.0
    gain_m2[at] = squared * solid_angle
    return gain_m2
