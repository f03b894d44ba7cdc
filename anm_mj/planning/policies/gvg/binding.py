"""How well a view binds the robot's position: by the known surface that its rays end in.

A distance to a surface tells the position along the surface's normal, and nothing along the surface. A view of one
wall, or of two that are parallel, leaves a direction free; one of the unknown leaves both. Rays that end next to each
other span the surface, as far as no depth edge lies between them. Walls and furniture count; floor and ceiling bind no
direction in the plane. Colour is not known here: a view of a picture on a wall binds more than this says.
"""

import numpy as np
from jaxtyping import Float

from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.planning.policies.gvg.ray_cache import Rays
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.types import OCCUPIED

_EDGE = 1.0
"""Ends of rays on either side of another one that are farther apart than this share of its length are two surfaces'."""


def unbound_shares(
    rays: Rays, distance_m: Float[np.ndarray, "n rays"], occupancy: PooledOccupancy, *, side: int, bound_share: float
) -> Float[np.ndarray, "n azimuths"]:
    """Share that views lack of what it takes to bind the position, for each place and each sector to look along: from
    0, it is bound in all directions, to 1, in one of them not at all.

    The rays of the places are ``distance_m`` long [m] and end in the occupancy. A view covers ``side`` sectors on both
    sides of the middle one; it binds the position where its weakest direction is held by ``bound_share`` of its rays.
    """
    count = len(rays.hit)
    end = occupancy.centres(rays.hit.reshape(-1)).reshape(count, NUM_AZIMUTHS, -1, 3)
    solid = (rays.state == OCCUPIED).reshape(end.shape[:3])
    before, after = np.roll(end, 1, axis=1), np.roll(end, -1, axis=1)
    solid = solid & np.roll(solid, 1, axis=1) & np.roll(solid, -1, axis=1)
    # A single elevation tells nothing of a surface's direction: nothing is bound.
    across, up = after - before, np.gradient(end, axis=2) if end.shape[2] > 1 else np.zeros_like(end)
    normal = np.cross(across, up)
    length = np.linalg.norm(normal, axis=3)
    solid &= (np.linalg.norm(across, axis=3) < _EDGE * distance_m.reshape(solid.shape)) & (length > 0.0)
    x, y = (np.where(solid, normal[..., axis] / np.maximum(length, 1e-9), 0.0) for axis in (0, 1))
    sums = [_over_views(part.sum(axis=2), side) for part in (x * x, x * y, y * y)]
    xx, xy, yy = (part / ((2 * side + 1) * end.shape[2]) for part in sums)
    weakest = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    return 1.0 - np.clip(weakest / bound_share, 0.0, 1.0)


def _over_views(sector: Float[np.ndarray, "n azimuths"], side: int) -> Float[np.ndarray, "n azimuths"]:
    """Sums over the sectors of the view along each sector."""
    return np.sum([np.roll(sector, shift, axis=1) for shift in range(-side, side + 1)], axis=0)
