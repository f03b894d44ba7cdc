"""Views, and the azimuth sectors that they cover: 36 directions of 10 degrees each, as wide as one turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from anm_mj.types import TURN_STEP_RAD

NUM_AZIMUTHS = 36
HALF_TURN = NUM_AZIMUTHS // 2
VIEW_SIDE = 4
"""A view of 90 degrees covers its middle sector and this many on either side."""
VIEW_SECTORS = np.arange(-VIEW_SIDE, VIEW_SIDE + 1)
"""Sectors that a view covers, relative to its heading."""

SectorT = TypeVar("SectorT", int, Int[np.ndarray, "..."])


@dataclass(frozen=True)
class Viewpoint:
    """A place to look from, and the azimuth sector to look along."""

    xy_m: Float[np.ndarray, "2"]
    heading: int


def sector_of(yaw_rad: float) -> int:
    """The sector that a yaw points along."""
    return math.floor(yaw_rad / TURN_STEP_RAD + 0.5) % NUM_AZIMUTHS


def signed_turns(to: SectorT, start: SectorT) -> SectorT:
    """Turns from sectors to others the shorter way, positive to the left; half a turn is negative."""
    return (to - start + HALF_TURN) % NUM_AZIMUTHS - HALF_TURN
