"""Views, and the azimuth sectors that they cover: as many as a full rotation has turns, each as wide as one turn."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from anm_mj.types import TURN_STEP_RAD

NUM_AZIMUTHS = round(math.tau / TURN_STEP_RAD)
HALF_TURN = NUM_AZIMUTHS // 2

SectorT = TypeVar("SectorT", int, Int[np.ndarray, "..."])


@dataclass(frozen=True)
class Viewpoint:
    """A place to look from, and the azimuth sector to look along."""

    xy_m: Float[np.ndarray, "2"]
    heading: int


def view_sectors(side: int) -> Int[np.ndarray, " sectors"]:
    """Sectors that a view covers, relative to its heading: the middle one and ``side`` on either side."""
    return np.arange(-side, side + 1)


def sector_of(yaw_rad: float) -> int:
    """The sector that a yaw points along."""
    return math.floor(yaw_rad / TURN_STEP_RAD + 0.5) % NUM_AZIMUTHS


def signed_turns(to: SectorT, start: SectorT) -> SectorT:
    """Turns from sectors to others the shorter way, positive to the left; half a turn is negative."""
    return (to - start + HALF_TURN) % NUM_AZIMUTHS - HALF_TURN
