"""Colours of a top-down map: free space by its clearance, obstacles, drops, the unknown."""

import numpy as np
from jaxtyping import Float, UInt8

from anm_mj.types import FREE, OCCUPIED, TopDownMap
from anm_mj.viz import palette

FULL_CLEARANCE_M = 1.5
"""Clearance from which free space has the brightest tint [m]."""


def rgb_of(colour: str) -> tuple[int, int, int]:
    """A colour of the palette as bytes."""
    number = palette.number(colour)
    return number >> 16, number >> 8 & 255, number & 255


def free_tint(share: Float[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape 3"]:
    """Colour of free space at shares of the full clearance, 0 beside an obstacle to 1."""
    near, clear = (np.array(rgb_of(colour), float) for colour in (palette.NEAR, palette.CLEAR))
    return np.rint(near + (clear - near) * np.clip(share, 0.0, 1.0)[..., None]).astype(np.uint8)


def tint(topdown: TopDownMap) -> UInt8[np.ndarray, "rows cols 3"]:
    """Colours of the cells."""
    image = np.empty((*topdown.state.shape, 3), np.uint8)
    image[:] = rgb_of(palette.UNKNOWN)
    free = topdown.state == FREE
    image[free] = free_tint(topdown.clearance_m[free] / FULL_CLEARANCE_M)
    occupied = topdown.state == OCCUPIED
    image[occupied] = rgb_of(palette.WALL)
    if topdown.no_floor is not None:
        image[occupied & topdown.no_floor] = rgb_of(palette.NO_FLOOR)
    return image
