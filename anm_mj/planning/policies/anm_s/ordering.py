"""In which order candidates are tried: by tier and room, or as the paper's ablations ask."""

import numpy as np
from jaxtyping import Float, Int

from anm_mj.planning.policies.anm_s.candidate_vertices import Candidates
from anm_mj.planning.policies.anm_s.region_stages import RegionState
from anm_mj.planning.policies.anm_s.targets import Targets


def best_first(
    now: RegionState, candidates: Candidates, targets: Targets, target: str, rng: np.random.Generator
) -> Int[np.ndarray, " n"]:
    """The candidates from best to worst, the present target before all others.

    ``target`` is how to choose, one of ``TARGETS``; ``rng`` draws the random order.
    """
    xy, distance = now.graph.vertex_xy_m[candidates.vertex], now.paths.distance_m[candidates.vertex]
    other = np.ones(len(xy), bool)
    other[targets.match(xy)] = False
    if target == "hierarchical":
        return np.lexsort((distance, room_distance(now, candidates.vertex), -candidates.tier, other))
    failures = targets.num_failures(xy)
    if target == "random":
        return np.lexsort((rng.random(len(xy)), failures, other))
    most = np.zeros(len(now.graph.vertex_xy_m))
    for region in now.regions:
        most[region.vertex] = max(most[region.vertex], region.score)
    return np.lexsort((distance, ~candidates.unvisited, -most[candidates.vertex], failures, other))


def own_room(now: RegionState) -> int:
    """The robot's room: that of the vertex that it reaches first; -1 for none."""
    distance_m = now.paths.distance_m
    return int(now.room[np.argmin(distance_m)]) if np.isfinite(distance_m).any() else -1


def room_name(now: RegionState, vertex: int) -> str:
    """What to call the room of a vertex."""
    room = int(now.room[vertex])
    if room < 0:
        return "a nook"
    return "the rest of the room" if room == own_room(now) else f"room {room}"


def room_distance(now: RegionState, vertices: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How far the room of each vertex is: 0 for the robot's own, else to the nearest of these vertices in it [m]."""
    room, distance_m = now.room[vertices], now.paths.distance_m[vertices]
    nearest = np.full(len(now.room) + 1, np.inf)
    np.minimum.at(nearest, room, distance_m)
    nearest[own_room(now)] = 0.0
    # Nooks share a number, and nothing else.
    return np.where(room < 0, distance_m, nearest[room])
