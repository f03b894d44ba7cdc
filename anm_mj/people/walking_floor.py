"""The floor that people walk on: where they can stand, how far the walls are, and paths from place to place."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from skimage.graph import MCP_Geometric

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import pooled, scene_area
from anm_mj.scene.room_segmentation import DOOR_MAX_M, segment_rooms
from anm_mj.types import Footprint

BODY = Footprint(radius_m=0.25, z_min_m=0.05, z_max_m=1.9)
"""The space about a person."""
_ROUTE_CELLS = 4
"""Paths are looked for on cells of this many of the floor's along each edge."""
_COMFORT_M = 0.3
"""Paths prefer to keep this much clearance beyond the body's radius [m]."""
_PLACE_CLEARANCE_M = 0.4
"""Places that people walk to are so far from obstacles, where the floor has such [m]."""
_DOOR_ANGLE_RAD = math.radians(7.5)
"""Directions in which a doorway's jambs are looked for lie so far apart."""
_IN_DOORWAY_M = 0.7
"""So near to the middle of one, somebody stands in it [m]."""
_AT_DOORWAY_M = 1.0
"""Whoever is nearer to the middle of one is at it [m]."""


class Doorway(NamedTuple):
    """A narrow place between two rooms."""

    middle_m: Float[np.ndarray, "2"]
    left_m: Float[np.ndarray, "2"]
    """Where one jamb stands, or what is as near [m]; the other one stands at ``right_m``."""
    right_m: Float[np.ndarray, "2"]


class WalkingFloor:
    """The largest connected floor of a scene for people."""

    def __init__(self, scene: Scene) -> None:
        """Find it. Raises SceneError if there is hardly any."""
        try:
            area = scene_area(scene, BODY)
        except SceneError as err:
            raise SceneError(
                f"Scene {scene.name} has no floor for people to walk on, who are {BODY.z_max_m:g} m tall and "
                f"{2 * BODY.radius_m:g} m wide: leave out --people, or give another scene."
            ) from err
        self._area = area
        by_row, by_col = np.gradient(area.clearance_m)
        length = np.maximum(np.hypot(by_row, by_col), 1e-6)
        self._slope = np.stack([by_col / length, by_row / length]).astype(np.float32)
        """Unit vectors (x, y) away from the nearest obstacle, of each cell."""
        routes = pooled(area, _ROUTE_CELLS)
        crowding = np.clip((BODY.radius_m + _COMFORT_M - routes.clearance_m) / _COMFORT_M, 0.0, 1.0)
        self._routes = routes
        self._cost = np.where(routes.component == 1, 1.0 + 2.0 * crowding, -1.0)
        self.doorways = self._find_doorways(scene)
        """Those between two rooms."""
        self._doorways_m = np.array([door.middle_m for door in self.doorways]).reshape(-1, 2)
        roomy = (routes.component == 1) & (routes.clearance_m >= _PLACE_CLEARANCE_M)
        places, doorways = routes.grid.centres_m(*np.nonzero(roomy)), self._doorways_m
        apart_m = KDTree(doorways).query(places)[0] if len(doorways) else np.full(len(places), math.inf)
        places = places[apart_m > _IN_DOORWAY_M] if (apart_m > _IN_DOORWAY_M).any() else places
        self.places_m: Float[np.ndarray, "n 2"] = places if len(places) else routes.places(1)
        """Places to walk to, and to stand at: not in doorways, where there are others [m]."""

    def clearance(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Distance to the nearest obstacle [m] and the direction (x, y) away from it; zeros outside of the floor."""
        grid = self._area.grid
        col = math.floor((x_m - grid.origin_xy_m[0]) / grid.resolution_m)
        row = math.floor((y_m - grid.origin_xy_m[1]) / grid.resolution_m)
        if not (0 <= row < grid.rows and 0 <= col < grid.cols):
            return 0.0, 0.0, 0.0
        slope = self._slope[:, row, col]
        return float(self._area.clearance_m[row, col]), float(slope[0]), float(slope[1])

    def path(self, start_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
        """Places from one on to another, a tenth of a metre apart; the end alone where nothing leads there [m]."""
        return self.ways(start_m, end_m)(end_m)

    def ways(
        self, start_m: Float[np.ndarray, "2"], only_m: Float[np.ndarray, "2"] | None = None
    ) -> Callable[[Float[np.ndarray, "2"]], Float[np.ndarray, "k 2"]]:
        """:meth:`path` from a place, by its end: one search for all ends, or for ``only_m`` [m]."""
        search = MCP_Geometric(self._cost)
        cost, _ = search.find_costs([self._cell(start_m)], None if only_m is None else [self._cell(only_m)])

        def to(end_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
            end = self._cell(end_m)
            if not np.isfinite(cost[end]):
                return end_m[None]
            return self._routes.grid.centres_m(*np.array(search.traceback(end)).T)

        return to

    def doorway(self, near_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The middle of the doorway nearest to a place, but not at it [m]. Raises SceneError if the floor has none, or
        none away from it.
        """
        xy = self._doorways_m
        if not len(xy):
            raise SceneError("The floor has no doorway for somebody to stand in: set people.blocked_s=0.")
        away_m = np.linalg.norm(xy - near_m, axis=1)
        away_m[away_m < _AT_DOORWAY_M] = math.inf
        nearest = int(np.argmin(away_m))
        if math.isinf(away_m[nearest]):
            raise SceneError(
                f"All doorways of the floor, {len(xy)}, lie less than {_AT_DOORWAY_M:g} m from the robot at "
                f"({near_m[0]:.2f}, {near_m[1]:.2f}), too near for somebody to stand there: start elsewhere, or set "
                "people.blocked_s=0."
            )
        return xy[nearest]

    def _find_doorways(self, scene: Scene) -> list[Doorway]:
        """Those between two rooms that people fit through."""
        vertices, faces = scene.triangles()
        found = []
        for door in segment_rooms(vertices[faces], self._area).doors:
            ends = self._jambs(door.xy_m)
            if door.fits and math.dist(*ends) <= DOOR_MAX_M:
                found.append(Doorway((ends[0] + ends[1]) / 2, *ends))
        return found

    def _jambs(self, xy_m: Float[np.ndarray, "2"]) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """Where the shortest line through a place ends at obstacles [m]."""
        step_m = self._area.grid.resolution_m / 2
        best: list[Float[np.ndarray, "2"]] = []
        for angle in np.arange(0.0, math.pi, _DOOR_ANGLE_RAD).tolist():
            along, ends = np.array([math.cos(angle), math.sin(angle)]), []
            for sign in (-step_m, step_m):
                end = xy_m
                while self.clearance(*end.tolist())[0] > 0.0:
                    end = end + sign * along
                ends.append(end)
            if not best or math.dist(*ends) < math.dist(*best) - step_m:
                best = ends
        return best[0], best[1]

    def _cell(self, xy_m: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """The walkable cell nearest to a place."""
        grid = self._routes.grid
        cells: Int[np.ndarray, "n 2"] = np.argwhere(self._routes.component == 1)
        place = (xy_m - grid.origin_xy_m)[::-1] / grid.resolution_m - 0.5
        row, col = cells[np.argmin(((cells - place) ** 2).sum(axis=1))].tolist()
        return row, col
