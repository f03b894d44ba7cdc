"""Colours of what figures, film and pages draw, as ``#rrggbb``; each has one meaning everywhere."""

import numpy as np
from jaxtyping import Float, UInt8
from PIL.ImageColor import getrgb

from anm_mj.types import FREE, OCCUPIED, TopDownMap

UNKNOWN, WALL = "#c6c3bd", "#3a3a3f"
NO_FLOOR = "#8fb0a3"
"""A drop, and the outside beyond it."""
NEAR, CLEAR = "#d7e6f3", "#ffffff"
"""Free space beside an obstacle, and far from all; in grey brighter than the unknown."""
GRAPH, REGION, TARGET = "#3b8a5a", "#e08a1e", "#0a9fd0"
PATH, TRAJECTORY = "#c8323c", "#7a3fa0"
TRUE = "#1f1f1f"
"""The true trajectory, beside the one that the robot believes."""
ROBOT, CAMERA = "#4a5568", "#2b6ca3"
START, END = "#1f1f1f", "#2b6ca3"
RATIO, DISTANCE = "#2b6ca3", "#c8641e"
SURFACE = "#a8b3bd"
PERSON = "#b5521b"
"""People, and in pictures the pixels that moved."""
GONE, NEW = "#d6277a", "#12908c"
"""Surface that is no more, and surface that was not there, since a prior run."""
LEGEND = (
    ("surface", "surface of the map", SURFACE),
    ("robot", "robot", ROBOT),
    ("camera", "camera", CAMERA),
    ("trajectory", "trajectory", TRAJECTORY),
    ("graph", "Voronoi graph", GRAPH),
    ("regions", "regions of interest", REGION),
    ("path", "planned path", PATH),
    ("target", "target", TARGET),
)
"""Legend of the pages: name of the object, words, colour."""
TRUTH_LEGEND = (
    ("truth", "true trajectory", TRUE),
    ("covariance", "2 sigma of the position", PATH),
    ("people", "people", PERSON),
)
"""What a replay adds for a robot that may be wrong about where it is, and among people."""
FULL_CLEARANCE_M = 1.5
"""Clearance from which free space has the brightest tint [m]."""


def number(colour: str) -> int:
    """A colour as 0xRRGGBB, as three.js takes it."""
    return int(colour.removeprefix("#"), 16)


def free_tint(share: Float[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape 3"]:
    """Colour of free space at shares of the full clearance, 0 beside an obstacle to 1."""
    near, clear = (np.array(getrgb(colour), float) for colour in (NEAR, CLEAR))
    return np.rint(near + (clear - near) * np.clip(share, 0.0, 1.0)[..., None]).astype(np.uint8)


def tint(topdown: TopDownMap) -> UInt8[np.ndarray, "rows cols 3"]:
    """Colours of the cells."""
    image = np.empty((*topdown.state.shape, 3), np.uint8)
    image[:] = getrgb(UNKNOWN)
    free = topdown.state == FREE
    image[free] = free_tint(topdown.clearance_m[free] / FULL_CLEARANCE_M)
    occupied = topdown.state == OCCUPIED
    image[occupied] = getrgb(WALL)
    if topdown.no_floor is not None:
        image[occupied & topdown.no_floor] = getrgb(NO_FLOOR)
    return image
