"""Plans of HouseExpo (Li et al., "HouseExpo", IROS 2020): one outline of all free floor, interior walls folded in.

It lists no rooms and no doors. Segmentation finds them (:func:`anm_mj.scene.room_segmentation.segment_floor`), and the
boxes of ``room_category`` name the rooms.
"""

from typing import Any

import numpy as np
import shapely
from jaxtyping import Float64
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from anm_mj.scene.generation.building import Building, named_rooms
from anm_mj.scene.importing.floorplans.cells import CellPlan, cells_within, grid_axes, take_passages, whole_rooms
from anm_mj.scene.importing.floorplans.room_types import room_type_of_word
from anm_mj.scene.room_segmentation import segment_floor

_CELL_M = 0.05
_PASSAGE_M = 0.1
"""Length of passages [m]: inner walls are thin here."""


def is_houseexpo(plan: Any) -> bool:
    """Whether a JSON document is a plan of HouseExpo."""
    return isinstance(plan, dict) and {"verts", "room_category"} <= plan.keys()


def read_houseexpo(plan: Any) -> Building:
    """The building of a plan. Raises KeyError, TypeError or ValueError if the plan lacks or misstates something."""
    outline = shapely.Polygon(np.asarray(plan["verts"], dtype=np.float64))
    floor = outline if outline.is_valid else shapely.make_valid(outline)
    if floor.is_empty:
        raise ValueError("verts enclose no floor")
    origin, xs, ys = grid_axes(np.array(floor.bounds), _CELL_M)
    labels = whole_rooms(segment_floor(cells_within(floor, xs, ys), _CELL_M)[0] - 1)
    plan_cells = CellPlan(labels, origin, _CELL_M)
    cells, passages = take_passages(plan_cells, _borders(plan_cells), _PASSAGE_M)
    outlines = cells.outlines()
    room_types = [_room_type(outline, plan["room_category"]) for outline in outlines]
    return Building(named_rooms(outlines, room_types), tuple(passages))


def _borders(plan: CellPlan) -> Float64[np.ndarray, "n 2 2"]:
    labels, found = plan.labels, []
    for axis in (0, 1):
        a, b = (labels[:-1], labels[1:]) if axis == 0 else (labels[:, :-1], labels[:, 1:])
        rows, cols = np.nonzero((a != b) & (a >= 0) & (b >= 0))
        if len(rows):
            pairs = np.sort(np.stack([a[rows, cols], b[rows, cols]], axis=1), axis=1)
            edge = np.stack([cols + (1.0 if axis else 0.5), rows + (0.5 if axis else 1.0)], axis=1)
            found.append(np.concatenate([pairs, edge], axis=1))
    if not found:
        return np.zeros((0, 2, 2))
    edges = np.concatenate(found)
    segments = []
    for pair in np.unique(edges[:, :2], axis=0):
        points = edges[(edges[:, :2] == pair).all(axis=1), 2:]
        # Points within two cells of one another belong together.
        tree = KDTree(points)
        num, near = connected_components(tree.sparse_distance_matrix(tree, 2.5))
        for k in range(num):
            middle, spread = points[near == k].mean(axis=0), points[near == k] - points[near == k].mean(axis=0)
            # A door runs along x or along y, whichever its border extends along more.
            direction = np.array([1.0, 0.0]) if np.ptp(spread[:, 0]) >= np.ptp(spread[:, 1]) else np.array([0.0, 1.0])
            reach = np.abs(spread @ direction).max() + 0.5
            segments.append([middle - reach * direction, middle + reach * direction])
    return plan.origin_m + np.array(segments) * plan.cell_m


def _room_type(outline: shapely.Polygon, categories: dict[str, list[list[float]]]) -> str:
    """The room type whose box covers most of the room; corridor if no box does."""
    best, most = "corridor", 0.15 * float(outline.area)
    for word, boxes in categories.items():
        for x0, y0, x1, y1 in boxes:
            covered = float(outline.intersection(shapely.box(x0, y0, x1, y1)).area)
            room_type = room_type_of_word(word)
            if room_type is not None and covered > most:
                best, most = room_type, covered
    return best
