"""Rooms: the parts of the graph between doors, which are bottlenecks.

Every vertex begins as a part of its own; parts merge across the edges (:mod:`anm_mj.geometry.room_merging`).

Only a bottleneck between two walls can be a door. One beside a table or a chair is a passage through a room: a
free-standing obstacle is furniture unless it is long, or thin as a wall. A bottleneck beside the unknown may be wider
than it looks, because the view ends there.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from anm_mj.frames import world_to_cell
from anm_mj.geometry.room_merging import merge_into_rooms
from anm_mj.types import FREE, OCCUPIED, TopDownMap, VoronoiGraph

DOOR_HALF_WIDTH_M = 0.8
"""Half the width of the widest door; wider bottlenecks are openings within a room [m]."""
NARROWING = 0.75
"""A door is narrower than this share of the widest place on either side."""
MIN_ROOM_M2 = 3.0
"""Smaller parts are niches of their neighbour [m2]."""
LONG_OBSTACLE_M = 4.0
"""Longer obstacles are walls, however thick [m]."""
WALL_THICKNESS_M, MIN_WALL_M = 0.3, 1.5
"""Thinner obstacles are walls from this length on [m]."""
SHORTEST_M = 1e-6
"""Shorter edges have no direction: their ends are the same but for rounding [m]."""
_CELL_AND_NEIGHBOURS = np.array([(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)])
"""Row and column steps."""


def segment_rooms(
    graph: VoronoiGraph, topdown: TopDownMap, start_xy_m: Float[np.ndarray, "2"]
) -> Int[np.ndarray, " n"]:
    """The room of each vertex, those on spurs too; -1 in disconnected parts that are too small for a room.

    The map tells walls from furniture and from the unknown. The room nearest to the start is room 0, and so on, so that
    most rooms keep their numbers while the robot finds others.
    """
    clearance_m, border_xy_m, floor_m2 = edge_bottlenecks(graph)
    may_be_door = clearance_m <= DOOR_HALF_WIDTH_M
    may_be_door[may_be_door] = _between_walls(border_xy_m[may_be_door], topdown)
    # Without an edge NumPy counts in integers.
    of_vertex_m2 = np.bincount(graph.edges[:, 0], floor_m2, len(graph.vertex_xy_m)).astype(float)
    part = merge_into_rooms(
        graph.edges, clearance_m, may_be_door, graph.clearance_m, of_vertex_m2, NARROWING, MIN_ROOM_M2
    )
    num = int(part.max(initial=-1)) + 1
    by_distance = np.argsort(np.linalg.norm(graph.vertex_xy_m - start_xy_m, axis=1), kind="stable")
    _, first = np.unique(part[by_distance], return_index=True)
    order = np.argsort(first)
    order = order[np.bincount(part, of_vertex_m2, num)[order] >= MIN_ROOM_M2]
    number = np.full(num, -1)
    number[order] = np.arange(len(order))
    return number[part]


def edge_bottlenecks(
    graph: VoronoiGraph,
) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, "e 2 2"], Float[np.ndarray, " e"]]:
    """The narrowest place of every edge, exact to rounding.

    Each end of an edge is equally far from both generating points (paper, Eq. 3). The clearances of the ends and the
    length of the edge therefore determine these points: at the same place along the edge, one on each side.

    Returns:
        The least clearance along each edge [m]; the points of the border that it is equidistant to, to its left and to
        its right [m]; and the area between it and the borders on both sides [m2], exact between straight borders, up to
        twice as much at a corner or a pole.
    """
    start, end = graph.vertex_xy_m[graph.edges[:, 0]], graph.vertex_xy_m[graph.edges[:, 1]]
    at_start, at_end = graph.clearance_m[graph.edges[:, 0]], graph.clearance_m[graph.edges[:, 1]]
    length = graph.edge_length_m
    some = np.maximum(length, SHORTEST_M)
    ahead = (end - start) / some[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    # Distances of the generating points along the line through both ends, and from it.
    along = np.where(length > SHORTEST_M, (length**2 + at_start**2 - at_end**2) / (2.0 * some), 0.0)
    off = np.sqrt(np.maximum(at_start**2 - along**2, 0.0))
    abreast = start + along[:, None] * ahead
    aside = off[:, None] * left
    border = np.stack([abreast + aside, abreast - aside], axis=1)
    return np.hypot(off, along - np.clip(along, 0.0, length)), border, 2.0 * length * off


def _between_walls(border_xy_m: Float[np.ndarray, "e 2 2"], topdown: TopDownMap) -> Bool[np.ndarray, " e"]:
    """Which pairs of border points both lie on walls; the unknown behind an obstacle belongs to it."""
    rows, cols = topdown.state.shape
    solid = np.pad(topdown.state != FREE, ((0, rows % 2), (0, cols % 2)), constant_values=True).view(np.uint8)
    # In squares of four cells: obstacles less than two cells apart count as one.
    squares = solid[::2, ::2] + solid[1::2, ::2] + solid[::2, 1::2] + solid[1::2, 1::2]
    obstacle = np.empty(squares.shape, np.int32)
    ndimage.label(squares, np.ones((3, 3)), output=obstacle)  # pyright: ignore[reportArgumentType]
    sides = [[side.stop - side.start for side in box] for box in ndimage.find_objects(obstacle)]
    length_m = np.linalg.norm(np.array(sides).reshape(-1, 2), axis=1) * 2.0 * topdown.resolution_m
    area_m2 = np.bincount(obstacle.ravel(), squares.ravel(), 1)[1:] * topdown.resolution_m**2
    wall = np.append(
        False, (length_m > LONG_OBSTACLE_M) | ((length_m > MIN_WALL_M) & (area_m2 < WALL_THICKNESS_M * length_m))
    )
    # A border point lies on the edge between two cells and does not tell which of them is the wall.
    cell = world_to_cell(border_xy_m.reshape(-1, 2), topdown.origin_xy_m, topdown.resolution_m)
    row, col = np.moveaxis(np.clip(cell[:, None] + _CELL_AND_NEIGHBOURS, 0, [rows - 1, cols - 1]), -1, 0)
    on_wall = wall[obstacle[row // 2, col // 2]] & (topdown.state[row, col] == OCCUPIED)
    return np.all(on_wall.any(axis=1).reshape(-1, 2), axis=1)
