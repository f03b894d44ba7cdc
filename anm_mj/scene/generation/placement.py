"""Places furniture in a room: against walls, with clear floor in front, and off the doors."""

import numpy as np
import shapely
from jaxtyping import Float64
from shapely.geometry.base import BaseGeometry

from anm_mj.scene.generation.building import RoomWall
from anm_mj.scene.generation.piece import Box, Piece, Placed, box_corners
from anm_mj.scene.generation.wall import Wall, WallArea

_DOOR_CLEAR_M = 0.75
"""Floor that stays clear before a door, on top of its width [m]."""
_STEP_M = 0.12
"""Distance between the places tried along a wall [m]."""
_MIDDLE_TRIES = 40
_LOW_M = 1.0
"""Pictures hang above what is lower than this [m]."""
_SHRINK_M = 0.004
"""Outlines may touch: they are compared a little smaller than they are [m]."""


class RoomSpace:
    """The free floor and walls of one room."""

    def __init__(self, floor: shapely.Polygon, walls: tuple[RoomWall, ...], rng: np.random.Generator) -> None:
        """An empty room's clear floor [m] and walls; ``rng`` decides between places that are equally good."""
        self._rng = rng
        self._walls = walls
        self._stretches = [(wall, *ends) for wall in walls for ends in wall.solid(0.08) if ends[1] - ends[0] > 0.25]
        before_doors = [_before_gap(wall.wall, start, end) for wall in walls for start, end, _ in wall.gaps]
        self._standing: BaseGeometry = floor.difference(shapely.union_all(before_doors))
        """Where a piece may stand."""
        self._open: BaseGeometry = floor
        """Where nothing stands, so that a piece may have its front there."""
        self._hung: list[tuple[RoomWall, float, float]] = []
        self._main_deg = max(walls, key=lambda wall: wall.wall.length_m).wall.yaw_deg if walls else 0.0

    def put(self, piece: Piece) -> Placed | None:
        """Place a piece; None if there is no room for it."""
        if piece.placement == "hang":
            return self._hang(piece)
        places = self._middle_places() if piece.placement in ("middle", "rug") else self._wall_places(piece)
        fits = self._fits(piece, places)
        if not fits.any():
            return None
        x, y, yaw, which, along = places[int(np.argmax(fits))]
        placed = Placed(piece, float(x), float(y), float(yaw))
        if piece.placement == "rug":
            return placed
        self.occupy(placed)
        if which >= 0 and piece.height_m > _LOW_M:
            x0, _, x1, _ = piece.outline_m
            wall = self._stretches[int(which)][0]
            self._hung.append((wall, along + x0, along + x1))
        return placed

    def curtain(self, piece: Piece, wall: RoomWall, window: WallArea) -> Placed | None:
        """Hang curtains about a window unless something stands there."""
        middle = (window.start_m + window.end_m) / 2
        x0, _, x1, _ = piece.outline_m
        inside = any(a <= middle + x0 and middle + x1 <= b for a, b in wall.solid(0.08))
        if not inside or any(w is wall and a < middle + x1 and middle + x0 < b for w, a, b in self._hung):
            return None
        placed = _at_wall(piece, wall, middle)
        # Drawn in by a hair, so that it does not touch the wall.
        solids = [box_corners(_shrunk(box), placed.x_m, placed.y_m, placed.yaw_deg) for box in piece.solids_m]
        if not shapely.covers(self._open, shapely.union_all(shapely.polygons(np.stack(solids)))):
            return None
        self._hung.append((wall, middle + x0, middle + x1))
        self.occupy(placed)
        return placed

    def occupy(self, placed: Placed) -> None:
        """Take note of a piece that stands in the room already."""
        body = shapely.union_all(shapely.polygons(placed.corners_m()))
        zone = shapely.Polygon(box_corners(_with_front(placed.piece), placed.x_m, placed.y_m, placed.yaw_deg))
        self._open = self._open.difference(body)
        self._standing = self._standing.difference(zone)

    def _fits(self, piece: Piece, places: Float64[np.ndarray, "n 5"]) -> np.ndarray:
        """Which places have room for the piece and for the floor before it; a rug lies whole on open floor."""
        if piece.placement == "rug":
            shapely.prepare(self._open)
            return np.asarray(shapely.covers(self._open, shapely.polygons(_corners(piece.outline_m, places))))
        body = shapely.polygons(_corners(_shrunk(piece.outline_m), places))
        shapely.prepare(self._standing)
        fits = np.asarray(shapely.covers(self._standing, body))
        if fits.any() and piece.front_m > 0.0:
            front = shapely.polygons(_corners(_shrunk(_with_front(piece)), places[fits]))
            shapely.prepare(self._open)
            fits[fits] = shapely.covers(self._open, front)
        return fits

    def _wall_places(self, piece: Piece) -> Float64[np.ndarray, "n 5"]:
        """Places with the back to a wall (x, y, yaw, stretch, along), in the order to try them in."""
        x0, _, x1, _ = piece.outline_m
        found = []
        for which, (wall, start, end) in enumerate(self._stretches):
            low, high = start - x0 + 0.01, end - x1 - 0.01
            if high < low:
                continue
            along = np.arange(low, high + 1e-6, _STEP_M)
            # The ends first for what likes corners; anywhere for the rest.
            along = np.array([low, high]) if piece.placement == "corner" else np.append(along, high)
            for window in wall.windows:
                if piece.height_m > window.z_low_m:
                    along = along[(along + x1 < window.start_m - 0.05) | (along + x0 > window.end_m + 0.05)]
            if not len(along):
                continue
            left, right = np.array(wall.wall.left_m), np.array(wall.wall.right_m)
            rows = np.empty((len(along), 5))
            rows[:, :2] = left + along[:, None] * ((right - left) / wall.wall.length_m)
            rows[:, 2], rows[:, 3], rows[:, 4] = wall.wall.yaw_deg, which, along
            found.append(rows)
        if not found:
            return np.zeros((0, 5))
        # Whole walls in random order, so that pieces stand in rows; within a wall from one end or from the middle.
        for rows in found:
            if self._rng.random() < 0.5:
                rows[:] = rows[::-1].copy()
            elif self._rng.random() < 0.4:
                rows[:] = rows[np.argsort(np.abs(rows[:, 4] - rows[:, 4].mean()), kind="stable")]
        return np.concatenate([found[k] for k in self._rng.permutation(len(found))])

    def _middle_places(self) -> Float64[np.ndarray, "n 5"]:
        """Places away from the walls, the roomiest part of the floor first."""
        if self._standing.is_empty:
            return np.zeros((0, 5))
        x0, y0, x1, y1 = shapely.bounds(self._standing)
        points = np.column_stack([self._rng.uniform(x0, x1, _MIDDLE_TRIES), self._rng.uniform(y0, y1, _MIDDLE_TRIES)])
        inside = shapely.points(points)
        to_edge_m = shapely.distance(shapely.boundary(self._standing), inside)
        room = np.where(shapely.covers(self._standing, inside), to_edge_m, 0.0)
        points = points[np.argsort(-room, kind="stable")][: np.count_nonzero(room)]
        turns = self._main_deg + 90.0 * self._rng.integers(0, 4, len(points))
        skew = np.where(self._rng.random(len(points)) < 0.15, self._rng.uniform(-15.0, 15.0, len(points)), 0.0)
        return np.column_stack([points, turns + skew, np.full(len(points), -1), np.zeros(len(points))])

    def _hang(self, piece: Piece) -> Placed | None:
        x0, _, x1, _ = piece.outline_m
        for k in self._rng.permutation(len(self._stretches)):
            wall, start, end = self._stretches[k]
            low, high = start - x0 + 0.05, end - x1 - 0.05
            if high < low:
                continue
            for along in self._rng.uniform(low, high, 4):
                taken = [(a, b) for w, a, b in self._hung if w is wall]
                taken += [(window.start_m - 0.4, window.end_m + 0.4) for window in wall.windows]
                if not any(a < along + x1 + 0.05 and along + x0 - 0.05 < b for a, b in taken):
                    self._hung.append((wall, float(along) + x0, float(along) + x1))
                    return _at_wall(piece, wall, float(along))
        return None


def _at_wall(piece: Piece, wall: RoomWall, along_m: float) -> Placed:
    x, y, _ = wall.wall.point(along_m, 0.0, 0.0)
    return Placed(piece, x, y, wall.wall.yaw_deg)


def _before_gap(wall: Wall, start_m: float, end_m: float) -> shapely.Polygon:
    low, high, far = start_m - 0.08, end_m + 0.08, _DOOR_CLEAR_M
    corners = ((low, -0.01), (low, far), (high, far), (high, -0.01))
    return shapely.Polygon([wall.point(along, inward, 0.0)[:2] for along, inward in corners])


def _with_front(piece: Piece) -> Box:
    """The outline and the floor to keep clear before it; on all sides for what stands free."""
    x0, y0, x1, y1 = piece.outline_m
    around_m = piece.front_m if piece.placement == "middle" else 0.0
    return x0 - around_m, y0 - piece.front_m, x1 + around_m, y1 + around_m


def _shrunk(box: Box) -> Box:
    return box[0] + _SHRINK_M, box[1] + _SHRINK_M, box[2] - _SHRINK_M, box[3] - _SHRINK_M


def _corners(box: Box, places: Float64[np.ndarray, "n 5"]) -> Float64[np.ndarray, "n 4 2"]:
    x0, y0, x1, y1 = box
    local = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    c, s = np.cos(np.radians(places[:, 2])), np.sin(np.radians(places[:, 2]))
    x = local[:, 0] * c[:, None] - local[:, 1] * s[:, None] + places[:, :1]
    y = local[:, 0] * s[:, None] + local[:, 1] * c[:, None] + places[:, 1:2]
    return np.stack([x, y], axis=-1)
