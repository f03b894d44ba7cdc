"""Casts rays through the pooled occupancy, and what those into the unknown are expected to show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int8, Int32, Int64, UInt8

from anm_mj import _native


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
    _native.cast_rays(cells, offset, start, rows, rays.hit, rays.state, rays.sample, rays.depth)


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
    gain_m2 = np.empty(rays.hit.shape, np.float32)
    of = rays.hit, rays.state, rays.sample, rays.depth
    _native.ray_gains(*of, distance_m, layer_share, tried_from_m, np.array(rule, np.float32), gain_m2)
    return gain_m2
