"""Shortest safe paths: Dijkstra on the sparse graph, connected to the robot, with detours cut off.

One search reaches all vertices (paper, section III-C). The graph stays in the middle of rooms, which costs steps that a
room does not ask for: paths are therefore shortened by straight segments that keep the same clearance.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree
from skimage.graph import MCP_Geometric

from anm_mj.frames import cell_to_world, world_to_cell, wrap_angle
from anm_mj.geometry.polyline import NUM_HEADINGS, divided, heading_legs, shortcut
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD, Pose2, TopDownMap, VoronoiGraph

COARSE_STRIDE = 8
"""A first test of segments takes every eighth of their samples."""
MAX_CONNECTIONS = 16
"""Vertices near the robot that are tested for a straight connection."""
SHORT_LEG_M = 0.6
"""Shorter legs need one heading correction at most [m]."""
MIN_LEG_M = 0.1
"""Legs are split in two only where both parts are longer than this [m]."""
JOIN_M = 0.15
"""Without a margin, paths begin at places of the graph's edges that lie so far apart [m]."""
NEAR_ROBOT_M = 0.3
"""Within this distance of a robot in a tight spot, paths need no more clearance than the robot has [m]."""
GAP_M = 2.0
"""The parts of the graph on both sides of a narrow passage lie at most this far apart [m]."""
NUM_BEYOND = 8
"""So many vertices beyond a passage are looked at from each before it."""


@dataclass(frozen=True)
class ShortestPathTree:
    """Shortest paths from the robot to all vertices of a graph."""

    distance_m: Float[np.ndarray, " n"]
    """Length of the path to each vertex [m]; +inf where there is none."""
    predecessor: list[int]
    """The node before each vertex; node ``n`` is the robot itself; negative where there is no path."""
    connection_xy_m: dict[int, Float[np.ndarray, "k 2"]]
    """Path from the robot to each vertex that it is connected to, both ends included [m]."""
    graph: VoronoiGraph
    """The graph that the paths lead along."""
    topdown: TopDownMap
    """The map that they are cleared with."""
    safe_m: float
    """Least clearance of paths [m]."""
    pose: Pose2
    """Where the robot stands, and all paths begin."""
    joins_edges: bool = False
    """Whether detours are cut off to any place of an edge, not to vertices alone: in front of a passage that leaves a
    few centimetres, the next vertex may lie behind the robot."""

    def path_to(self, vertex: int) -> Float[np.ndarray, "k 2"]:
        """Polyline from the robot to a vertex, with detours cut off; empty when there is no path [m]."""
        if not np.isfinite(self.distance_m[vertex]):
            return np.zeros((0, 2))
        vertices = self.vertices_to(vertex)
        along = self.graph.vertex_xy_m[vertices[::-1]]
        points = np.concatenate([self.connection_xy_m[vertices[-1]], along[1:]])
        points = divided(points, JOIN_M) if self.joins_edges else points
        return shortcut_path(points, self.topdown, self.safe_m, self.pose)

    def vertices_to(self, vertex: int) -> list[int]:
        """The vertices of the path to a reachable vertex, from the vertex back to the robot."""
        predecessor, robot = self.predecessor, len(self.distance_m)
        vertices = [vertex]
        while (vertex := predecessor[vertex]) != robot:
            vertices.append(vertex)
        return vertices


def shortest_paths(
    graph: VoronoiGraph, topdown: TopDownMap, pose: Pose2, safe_m: float, *, joins_edges: bool = False
) -> ShortestPathTree:
    """Shortest paths from the robot to all vertices, by one search of a sparse graph.

    The map decides which connections from the robot to the graph keep ``safe_m`` clearance [m]; ``joins_edges`` is as
    of :class:`ShortestPathTree`.
    """
    n = len(graph.vertex_xy_m)
    connections = _connect(graph, topdown, pose, safe_m)
    if len(connections) > 1:
        # All are straight.
        ends_m = np.stack([path[1] for path in connections.values()])
        lengths = np.linalg.norm(ends_m - pose.xy_m, axis=1)
    else:
        lengths = [float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in connections.values()]
    ends = np.fromiter(connections.keys(), np.int64, len(connections))
    rows = np.concatenate([graph.edges[:, 0], np.full(len(ends), n)])
    cols = np.concatenate([graph.edges[:, 1], ends])
    # A sparse matrix takes a weight of zero for a missing edge.
    weights = np.maximum(np.concatenate([graph.edge_length_m, lengths]), 1e-6)
    links = coo_matrix((weights, (rows, cols)), shape=(n + 1, n + 1)).tocsr()
    distance, predecessor = dijkstra(links, directed=False, indices=n, return_predecessors=True)
    return ShortestPathTree(distance[:n], predecessor.tolist(), connections, graph, topdown, safe_m, pose, joins_edges)


def narrow_gaps(paths: ShortestPathTree) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Vertices that a path leads to, and for each the nearest vertex that none leads to, in plain sight [m].

    No obstacle and nothing unknown lies between them, but a passage that is too narrow. Seen from afar, and with a
    depth camera's noise, obstacles are thicker than they are: from beside it, it may turn out to be wide enough.
    """
    xy_m, reached = paths.graph.vertex_xy_m, np.isfinite(paths.distance_m)
    if reached.all() or not reached.any():
        return np.zeros(0, np.int64), np.zeros((0, 2))
    vertex, beyond = np.flatnonzero(reached), xy_m[~reached]
    near = min(NUM_BEYOND, len(beyond))
    apart_m, nearest = (np.reshape(each, (-1, near)) for each in KDTree(beyond).query(xy_m[vertex], k=near))
    # A wall may stand before the nearest one.
    which, place = np.nonzero(apart_m <= GAP_M)
    ends = beyond[nearest[which, place]]
    clear = segments_clear(paths.topdown, xy_m[vertex[which]], ends, 0.0, paths.pose)
    found, first = np.unique(which[clear], return_index=True)
    return vertex[found], ends[clear][first]


def segments_clear(
    topdown: TopDownMap,
    start_xy_m: Float[np.ndarray, "n 2"],
    end_xy_m: Float[np.ndarray, "n 2"],
    safe_m: float,
    pose: Pose2 | None = None,
) -> Bool[np.ndarray, " n"]:
    """Whether whole segments keep ``safe_m`` clearance [m], sampled twice per cell.

    Within ``NEAR_ROBOT_M`` of the robot's pose, the clearance that it has now is enough.
    """
    longest = float(np.linalg.norm(end_xy_m - start_xy_m, axis=1).max(initial=0.0))
    share = np.linspace(0.0, 1.0, max(math.ceil(longest / topdown.resolution_m * 2), 1) + 1)
    clear = np.ones(len(start_xy_m), bool)
    # A few samples find most segments that are not clear.
    for samples in (share[::COARSE_STRIDE], share):
        x_m, y_m = (start_xy_m[clear, :, None] + (end_xy_m - start_xy_m)[clear, :, None] * samples).swapaxes(0, 1)
        clearance = _clearance(topdown, x_m, y_m)
        enough = clearance >= safe_m
        if pose is not None:
            here_m = float(clearance_at(topdown, pose.xy_m[None])[0]) - topdown.resolution_m
            tight = np.nonzero(~enough)
            near = np.sqrt((x_m[tight] - pose.x_m) ** 2 + (y_m[tight] - pose.y_m) ** 2) < NEAR_ROBOT_M
            enough[tight] = near & (clearance[tight] >= min(safe_m, here_m))
        clear[clear] = enough.all(axis=1)
    return clear


def clearance_at(topdown: TopDownMap, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Signed clearance of places, -inf outside of the map [m]."""
    return _clearance(topdown, xy_m[:, 0], xy_m[:, 1])


def _clearance(
    topdown: TopDownMap, x_m: Float[np.ndarray, "*n"], y_m: Float[np.ndarray, "*n"]
) -> Float[np.ndarray, "*n"]:
    rows, cols = topdown.clearance_m.shape
    origin_x, origin_y = topdown.origin_xy_m.tolist()
    col, row = np.floor((x_m - origin_x) / topdown.resolution_m), np.floor((y_m - origin_y) / topdown.resolution_m)
    inside = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
    cell = np.where(inside, row * cols + col, 0).astype(np.int64)
    return np.where(inside, topdown.clearance_m.ravel()[cell].astype(float), -np.inf)


def shortcut_path(
    points: Float[np.ndarray, "k 2"], topdown: TopDownMap, safe_m: float, pose: Pose2
) -> Float[np.ndarray, "j 2"]:
    """A path from the robot on, without the detours that a straight segment with enough clearance can cut off [m]."""
    return shortcut(points, lambda start, end: segments_clear(topdown, start, end, safe_m, pose))


def quantize_headings(
    points: Float[np.ndarray, "k 2"], topdown: TopDownMap, safe_m: float, pose: Pose2
) -> Float[np.ndarray, "j 2"]:
    """A path from the robot on, with legs along headings that the robot can have, where these are as safe.

    A robot that turns by 10 degrees follows most legs only with a correction every few steps, and each costs a step.
    Two legs along the headings to either side lead to the same place with one turn, and are at most 0.4 % longer.
    """
    kept = [points[0]]
    heading = 0.0  # In turns from the robot's own.
    for start, end in itertools.pairwise(points):
        if float(np.hypot(*(end - start))) > SHORT_LEG_M:
            sides, _, lengths_m = heading_legs(end - start, pose.yaw_rad)
            off = [abs((side - heading + NUM_HEADINGS / 2) % NUM_HEADINGS - NUM_HEADINGS / 2) for side in sides]
            # The heading nearer to the present one comes first.
            first = int(off[1] < off[0])
            for k in (first, 1 - first) if min(lengths_m) > MIN_LEG_M else ():
                yaw = pose.yaw_rad + sides[k] * TURN_STEP_RAD
                corner = start + lengths_m[k] * np.array([math.cos(yaw), math.sin(yaw)])
                if segments_clear(topdown, np.stack([start, corner]), np.stack([corner, end]), safe_m, pose).all():
                    kept.append(corner)
                    break
            heading = float(sides[1 - first])
        kept.append(end)
    return np.array(kept)


def remaining_path(path_xy_m: Float[np.ndarray, "k 2"], pose: Pose2) -> Float[np.ndarray, "j 2"]:
    """The rest of a path, from the robot on [m]."""
    start, along = path_xy_m[:-1], np.diff(path_xy_m, axis=0)
    t = ((pose.xy_m - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    off = np.linalg.norm(start + np.clip(t, 0.0, 1.0)[:, None] * along - pose.xy_m, axis=1)
    # At a corner both legs are equally near: the later one counts.
    leg = len(off) - 1 - int(np.argmin(off[::-1]))
    return np.concatenate([pose.xy_m[None], path_xy_m[leg + 1 :]])


def path_steps(path_xy_m: Float[np.ndarray, "k 2"], yaw_rad: float, final_yaw_rad: float | None = None) -> float:
    """Steps of the action budget that a path costs: its length in forward steps and its turns in 10-degree steps.

    The robot's heading at its start is ``yaw_rad``; at its end any, unless ``final_yaw_rad`` says [rad].
    """
    steps = 0.0
    for leg in np.diff(path_xy_m, axis=0):
        length = float(np.hypot(*leg))
        if length < 1e-6:
            continue
        heading = math.atan2(leg[1], leg[0])
        steps += length / FORWARD_STEP_M + abs(wrap_angle(heading - yaw_rad)) / TURN_STEP_RAD
        yaw_rad = heading
    if final_yaw_rad is not None:
        steps += abs(wrap_angle(final_yaw_rad - yaw_rad)) / TURN_STEP_RAD
    return steps


def _connect(
    graph: VoronoiGraph, topdown: TopDownMap, pose: Pose2, safe_m: float
) -> dict[int, Float[np.ndarray, "k 2"]]:
    """Paths from the robot to vertices near it: straight where that is safe, else one along the grid."""
    if not len(graph.vertex_xy_m):
        return {}
    distance = np.linalg.norm(graph.vertex_xy_m - pose.xy_m, axis=1)
    near = np.argsort(distance, kind="stable")[:MAX_CONNECTIONS]
    start = np.repeat(pose.xy_m[None], len(near), axis=0)
    clear = segments_clear(topdown, start, graph.vertex_xy_m[near], safe_m, pose)
    if clear.any():
        return {int(v): np.stack([pose.xy_m, graph.vertex_xy_m[v]]) for v in near[clear]}
    return _connect_along_grid(graph, topdown, pose)


def _connect_along_grid(graph: VoronoiGraph, topdown: TopDownMap, pose: Pose2) -> dict[int, Float[np.ndarray, "k 2"]]:
    """The cheapest path over free cells to any vertex, preferring clearance: for a robot in a tight spot."""
    cost = np.where(topdown.clearance_m > 0, 1.0 / np.maximum(topdown.clearance_m, 0.02), -1.0)
    start = world_to_cell(pose.xy_m[None], topdown.origin_xy_m, topdown.resolution_m)[0]
    if not ((start >= 0) & (start < cost.shape)).all():
        return {}
    cost[tuple(start)] = max(float(cost[tuple(start)]), 1.0)
    search = MCP_Geometric(cost)
    cells = world_to_cell(graph.vertex_xy_m, topdown.origin_xy_m, topdown.resolution_m)
    costs, _ = search.find_costs([tuple(start)])
    reached = costs[cells[:, 0], cells[:, 1]]
    best = int(np.argmin(reached))
    if not np.isfinite(reached[best]):
        return {}
    path = cell_to_world(np.array(search.traceback(tuple(cells[best]))), topdown.origin_xy_m, topdown.resolution_m)
    return {best: np.concatenate([pose.xy_m[None], path[1:-1], graph.vertex_xy_m[best][None]])}
