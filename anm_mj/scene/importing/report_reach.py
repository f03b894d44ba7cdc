"""Says why most of a scene's floor cannot be reached, and which option helps."""

import logging

import numpy as np
from jaxtyping import Float64, Int

from anm_mj.scene.importing.doors import Doors
from anm_mj.scene.importing.placing import Placed
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.navigable import NavigableArea
from anm_mj.scene.submesh import triangles_of

_logger = logging.getLogger(__name__)

_MOST = 0.6
"""The robot should reach this share of the floor."""
_MIN_PIECE_M2, _MAX_PIECES, _MAX_TRIANGLES = 1.0, 20, 200_000
"""Which pieces of floor are looked at to see whether they lie within a solid."""
_EYE_M = 0.61
_DIRECTIONS = np.array([[0.97, 0.21, 0.1], [-0.93, 0.31, 0.2], [0.19, -0.95, 0.15], [0.1, 0.23, 0.97]])


def report_reach(area: NavigableArea, placed: Placed, doors: Doors) -> None:
    """Log why the robot reaches little of a scene: shut doors, other storeys."""
    cells = np.bincount(area.component.ravel())[1:]
    # Ground around a building is no floor that a door shuts off.
    rest = (area.component > 1) & area.indoors
    all_m2 = float(cells[0] + np.count_nonzero(rest)) * area.grid.resolution_m**2
    if area.area_m2 < _MOST * all_m2:
        all_m2 -= sum(_solid_pieces_m2(area, np.bincount(area.component[rest | (area.component == 1)])[1:], placed))
    if len(placed.floors_m) > 1:
        floors = ", ".join(f"{number} at {floor_m:.2f} m" for number, floor_m in enumerate(placed.floors_m, 1))
        _logger.warning(
            "The source has %d storeys (%s), all of which were imported; the robot drives on the one at %.2f m. Take "
            "one alone with --storey.",
            len(placed.floors_m),
            floors,
            placed.info.floor_removed_m,
        )
    if area.area_m2 >= _MOST * all_m2:
        return
    reached = f"The robot reaches {area.area_m2:.0f} of {all_m2:.0f} m2 of the floor"
    shut = [leaf.part for leaf in placed.leaves if leaf.is_shut]
    if shut and doors != "open":
        leaves = "1 door leaf" if len(shut) == 1 else f"{len(shut)} door leaves"
        _logger.warning("%s; %s may be in its way: %s. Open them with --doors open.", reached, leaves, some(shut, 8))
    else:
        _logger.warning(
            "%s, and no part looks like a shut door: `anm-mj scene check` shows where the pieces lie; name parts in "
            "the way with --leave-out.",
            reached,
        )


def _solid_pieces_m2(area: NavigableArea, cells: Int[np.ndarray, " n"], placed: Placed) -> list[float]:
    """Areas of the larger pieces of floor that lie within solids, such as walls of thick boxes [m2]."""
    triangles = triangles_of(placed.world.obstacles or placed.world.submeshes).astype(np.float64)
    if len(triangles) > _MAX_TRIANGLES:
        return []
    areas_m2 = cells * area.grid.resolution_m**2
    pieces = [piece for piece in range(2, min(len(cells), _MAX_PIECES) + 1) if areas_m2[piece - 1] > _MIN_PIECE_M2]
    return [float(areas_m2[piece - 1]) for piece in pieces if _is_within_solid(area, piece, triangles)]


def _is_within_solid(area: NavigableArea, piece: int, triangles: Float64[np.ndarray, "f 3 3"]) -> bool:
    """Whether only the backs of triangles are seen from a piece of floor: from within a solid."""
    rows, cols = np.nonzero(area.component == piece)
    roomiest = int(np.argmax(area.clearance_m[rows, cols]))
    eye = np.append(area.grid.centres_m(rows[roomiest], cols[roomiest]), _EYE_M)
    return not any(_faces_front(triangles, eye, direction) for direction in _DIRECTIONS)


def _faces_front(
    triangles: Float64[np.ndarray, "f 3 3"], eye: Float64[np.ndarray, "3"], direction: Float64[np.ndarray, "3"]
) -> bool:
    """Whether a ray from a point first meets the front of a triangle, or nothing (Moeller and Trumbore, 1997)."""
    a, edge_b, edge_c = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(direction, edge_c)
    determinant = (edge_b * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_eye = eye - a
        u = (to_eye * across).sum(axis=1) / determinant
        up = np.cross(to_eye, edge_b)
        v = (up @ direction) / determinant
        length = (edge_c * up).sum(axis=1) / determinant
        hit = (np.abs(determinant) > 1e-12) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (length > 0.0)
    if not hit.any():
        return True
    return bool(determinant[hit][np.argmin(length[hit])] > 0.0)
