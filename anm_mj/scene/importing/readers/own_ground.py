"""Finds out whether what a world holds stands on a ground that it leaves out, as a model does without its world."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from anm_mj.scene.importing.canonical_axes import find_floor
from anm_mj.scene.raster import areas, level_mask

_ON_GROUND_M = 0.1
"""What reaches down to z = 0 within this stands on it [m]."""
_FLOOR_M = 0.2
"""A floor lower than this is one on the ground [m]; what is called floor above it may be the tops of walls."""


def lacks_ground(triangles_m: Float[np.ndarray, "f 3 3"]) -> bool:
    """Whether triangles with z up stand on z = 0 with no floor below them.

    That is so where their largest level surface lies above most of what is upright, as the tops of walls do.
    """
    z_m = triangles_m[:, :, 2]
    if abs(float(z_m.min())) > _ON_GROUND_M:
        return False
    floor = find_floor(triangles_m)
    if floor is None:
        return True
    if floor.z_m < _FLOOR_M:
        return False
    area, middle_m = np.where(level_mask(triangles_m), 0.0, areas(triangles_m)), z_m.mean(axis=1)
    return bool(area[middle_m < floor.z_m].sum() > area[middle_m > floor.z_m].sum())
