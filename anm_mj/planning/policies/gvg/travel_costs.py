"""Costs of the paths between places: steps, and the azimuth sectors along which they leave and arrive."""

import math

import numpy as np
from jaxtyping import Float, Int

from anm_mj.planning.paths import ShortestPathTree, segments_clear
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

MAX_SEGMENT_M = 5.0
"""Places farther apart than this are connected along the graph only [m]."""
BEARING_LENGTH_M = 0.8
"""The bearing of a path's end is that of its last piece of this length [m]."""

_Path = tuple[Int[np.ndarray, " n"], float, float]
"""The vertices of a shortest path, from its end back to the robot, and its bearings at the end and at the robot
[rad]."""


class TravelCosts:
    """Paths between places: straight where each sees the other, else along the tree of shortest paths."""

    def __init__(self, tree: ShortestPathTree) -> None:
        self._tree = tree
        self._paths: dict[int, _Path] = {-1: (np.zeros(0, np.int64), 0.0, 0.0)}

    def between(
        self, xy_m: Float[np.ndarray, "k 2"], vertex: Int[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k k"], Int[np.ndarray, "k k"], Int[np.ndarray, "k k"]]:
        """Steps of the paths between places, and the azimuth sectors along which they leave and arrive.

        The first place is where the robot stands, with the vertex -1. Along the tree, a path leads back to the last
        vertex that both places share and on from there.
        """
        tree = self._tree
        vertices, arrivals, departures = zip(*(self._path(int(v)) for v in vertex), strict=True)
        difference = xy_m[None, :] - xy_m[:, None]
        straight = np.sqrt(difference[..., 0] ** 2 + difference[..., 1] ** 2)
        near = np.argwhere(np.triu(straight < MAX_SEGMENT_M, 1))
        clear = segments_clear(tree.topdown, xy_m[near[:, 0]], xy_m[near[:, 1]], tree.safe_m, tree.pose)
        direct = np.zeros(straight.shape, bool)
        direct[near[clear, 0], near[clear, 1]] = True
        direct |= direct.T
        length = np.where(direct, straight, np.maximum(self._along_tree(vertex, list(vertices)), straight))

        bearing = np.arctan2(difference[..., 1], difference[..., 0])
        arrival, first = np.array(arrivals), np.array(departures)
        leave = np.where(direct, bearing, (arrival + math.pi)[:, None])
        leave[0] = np.where(direct[0], bearing[0], first)
        arrive = np.where(direct, bearing, arrival[None, :])
        arrive[:, 0] = np.where(direct[:, 0], bearing[:, 0], first + math.pi)
        turning = np.abs(np.remainder(arrive - leave + math.pi, math.tau) - math.pi) / TURN_STEP_RAD
        return length / FORWARD_STEP_M + turning, _sector(leave), _sector(arrive)

    def _path(self, vertex: int) -> _Path:
        if vertex not in self._paths:
            vertices = np.array(self._tree.vertices_to(vertex))
            xy_m, robot_xy_m = self._tree.graph.vertex_xy_m[vertices], self._tree.pose.xy_m
            arrival = _bearing(xy_m[0] - np.concatenate([xy_m, robot_xy_m[None]]))
            self._paths[vertex] = vertices, arrival, _bearing(xy_m[::-1] - robot_xy_m)
        return self._paths[vertex]

    def _along_tree(
        self, vertex: Int[np.ndarray, " k"], vertices: list[Int[np.ndarray, " _"]]
    ) -> Float[np.ndarray, "k k"]:
        """Length of the paths along the tree, given the vertices of the path from the robot to each end [m]."""
        distance_m = self._tree.distance_m
        used, column = np.unique(np.concatenate(vertices), return_inverse=True)
        depth = np.zeros((len(vertices), len(used)), np.float32)
        depth[np.repeat(np.arange(len(vertices)), [len(v) for v in vertices]), column] = distance_m[used][column]
        parting = np.minimum(depth[:, None], depth[None]).max(axis=2, initial=0.0)
        from_root = np.array([0.0 if v < 0 else distance_m[v] for v in vertex])
        return np.maximum(from_root[:, None] + from_root[None, :] - 2.0 * parting, 0.0)


def _bearing(difference_m: Float[np.ndarray, "n 2"]) -> float:
    """Direction of the first difference that is long enough, else of the last [rad]."""
    long = np.hypot(*difference_m.T) > BEARING_LENGTH_M
    long[-1] = True
    x, y = difference_m[long.argmax()]
    return math.atan2(y, x)


def _sector(angle_rad: Float[np.ndarray, "k k"]) -> Int[np.ndarray, "k k"]:
    return np.rint(angle_rad / TURN_STEP_RAD).astype(np.int64) % NUM_AZIMUTHS
