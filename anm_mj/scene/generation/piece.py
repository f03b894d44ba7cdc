"""Pieces of furniture: an outline on the floor, and geometry that is built on demand.

Top-down maps, made by the thousand for training, need outlines only.
"""

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from jaxtyping import Float64

from anm_mj.scene.generation.quads import Quads, join

GAP_M = 0.015
"""Between the back of a piece and the wall: the skirting [m]."""

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max in the piece's own frame [m]."""
Placement = Literal["wall", "corner", "middle", "rug", "hang", "window"]
"""How a piece is put: back to a wall, in a corner, free in the room, on the floor below others, on a wall above what
stands there, about a window."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece, or a few that belong together.

    Its own frame has the back along y = 0 and looks towards -y; pieces for the middle lie about the origin.
    """

    name: str
    placement: Placement
    solids_m: tuple[Box, ...]
    """What the robot cannot pass, seen from above; the first box counts for all when there is only one."""
    front_m: float = 0.6
    """Floor that stays clear before it."""
    height_m: float = 1.0
    """Pieces higher than a window's sill do not stand before one."""
    gap_m: float = 0.0
    """Distance of the parts from the wall, beside that which they keep themselves [m]."""
    parts: Iterable[Quads] = ()
    """What it is made of; consumed by :attr:`quads`."""

    @functools.cached_property
    def quads(self) -> Quads:
        """Its geometry, built at the first use."""
        return join(*self.parts).placed(0.0, -self.gap_m)

    @property
    def outline_m(self) -> Box:
        """The box about all its solids."""
        boxes = np.array(self.solids_m)
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


Design = Iterator[Piece | Quads]
"""A generator that draws sizes by chance and yields the outline of a piece, then its parts."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece and where it stands."""

    piece: Piece
    x_m: float
    y_m: float
    yaw_deg: float

    def quads(self) -> Quads:
        """The piece in the world."""
        return self.piece.quads.placed(self.x_m, self.y_m, self.yaw_deg)

    def corners_m(self) -> Float64[np.ndarray, "n 4 2"]:
        """Corners of its solids in the world, counter-clockwise."""
        return np.stack([box_corners(box, self.x_m, self.y_m, self.yaw_deg) for box in self.piece.solids_m])


def drawn(design: Design) -> Piece:
    """The piece that a design makes: its sizes are drawn now, its parts when they are needed."""
    outline = cast(Piece, next(design))
    return replace(outline, parts=cast(Iterator[Quads], design))


def box_corners(box: Box, x_m: float, y_m: float, yaw_deg: float) -> Float64[np.ndarray, "4 2"]:
    """Corners of a box that is turned counter-clockwise and then moved."""
    x0, y0, x1, y1 = box
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    local = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return local @ np.array([[c, s], [-s, c]]) + (x_m, y_m)


def against_wall(name: str, width_m: float, depth_m: float, height_m: float, front_m: float = 0.6) -> Piece:
    """The outline of a piece that fills a box before a wall, moved off the wall by the skirting."""
    solid = (-width_m / 2, -depth_m - GAP_M, width_m / 2, -GAP_M)
    return Piece(name, "wall", (solid,), front_m, height_m, GAP_M)


def in_corner(name: str, half_m: float, depth_m: tuple[float, float], height_m: float, front_m: float = 0.0) -> Piece:
    """The outline of a piece for corners: half its width, and how near to and far from the wall it reaches."""
    return Piece(name, "corner", ((-half_m, -depth_m[1], half_m, -depth_m[0]),), front_m, height_m)


def on_wall(name: str, half_m: float, depth_m: float, height_m: float) -> Piece:
    """The outline of a piece that hangs on a wall: half its width, how far it stands out, and its top."""
    return Piece(name, "hang", ((-half_m, -depth_m, half_m, 0.0),), 0.0, height_m)
