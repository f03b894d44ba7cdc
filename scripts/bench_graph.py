"""Measures what the graph of a building costs, stage by stage, and how well its rooms are found.

    python scripts/bench_graph.py
    python scripts/bench_graph.py --areas-m2 80 500 2000 --kind office --seeds 3

Buildings come from the scene generator, furnished and seen as a whole, on a grid of 5 cm; for a large area several of
them stand in a row with a passage from each to the next. The robot stands in the middle. Printed are Markdown tables:
the size of the graph and the CPU time of each stage (one core, medians), without and with a coarse far field; then the
number of rooms found, the share of each found room that lies in one true room, and the share of each true room that
lies in one found room (weighted by the squared clearance of the vertices).
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from anm_mj.cli.command_line import run_script
from anm_mj.frames import world_to_cell
from anm_mj.planning.borders import borders_unknown
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.paths import shortest_paths
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.anm_s.decision_vertices import decision_vertices, prune_spurs
from anm_mj.planning.policies.anm_s.graph_rooms import segment_rooms
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import border_sites, voronoi_graph
from anm_mj.scene.generation.building_map import generated_map
from anm_mj.scene.generation.layout import BuildingKind
from anm_mj.types import DEFAULT_FOOTPRINT, FREE, OCCUPIED, OccupancyGrid, Pose2, TopDownMap

CELL_M = 0.05
MOST_ROOMS = 60
"""Of one generated building."""
ROOM_M2 = 14.0
"""About the size of a room of the generator."""
PASSAGE_CELLS = 20
"""Width of the passages between buildings [cells]."""
LEAST_CLEARANCE_M = 0.4
"""The robot stands this far from everything [m]."""
CONFIG = PlanningConfig()
CAMERA = FieldOfView(tan_left=1.0, tan_right=1.0, tan_up=1.0, tan_down=1.0, pitch_rad=0.0, height_m=1.25)
TRUNCATION_M = 0.1
SAFE_M = DEFAULT_FOOTPRINT.radius_m + CONFIG.margin_m


@dataclass(frozen=True)
class Plan:
    """A building seen from above."""

    obstacles: Bool[np.ndarray, "rows cols"]
    room: Int[np.ndarray, "rows cols"]
    """The room of each cell; -1 for none."""


@dataclass(frozen=True)
class Row:
    """One building."""

    floor_m2: float
    graph: str
    sites: int
    vertices: int
    edges: int
    ms: dict[str, float]
    """CPU time of each stage."""
    rooms: int
    found: int
    pure: float
    """Share of each found room that lies in one true room."""
    whole: float
    """Share of each true room that lies in one found room."""


def main(
    areas_m2: tuple[float, ...] = (80.0, 2000.0), kind: BuildingKind = "apartment", seeds: int = 1, repeats: int = 15
) -> None:
    """Print the tables.

    Args:
        areas_m2: Floors of the buildings, furniture included.
        kind: "apartment" or "office".
        seeds: Buildings of each size.
        repeats: Each stage is run so often.
    """
    rows = [
        measure(plan, coarse_far_field, repeats)
        for area_m2 in areas_m2
        for plan in (building(area_m2, kind, seed) for seed in range(seeds))
        for coarse_far_field in (False, True)
    ]
    stages = list(rows[0].ms)
    table("floor", "graph", "sites", "vertices", "edges", *stages, "all")
    for row in rows:
        times = [f"{ms:.1f}" for ms in [*row.ms.values(), sum(row.ms.values())]]
        table(f"{row.floor_m2:.0f} m2", row.graph, row.sites, row.vertices, row.edges, *times)
    print()
    table("floor", "graph", "rooms", "found", "of one found in one room", "of one room found as one")
    for row in rows:
        shares = (f"{100.0 * share:.0f} %" for share in (row.pure, row.whole))
        table(f"{row.floor_m2:.0f} m2", row.graph, row.rooms, row.found, *shares)


def table(*cells: object) -> None:
    """Print a line of a table, with the line below the headings where the first cell is one."""
    print("| " + " | ".join(map(str, cells)) + " |")
    if cells[0] == "floor":
        print("|" + "---|" * len(cells))


def building(area_m2: float, kind: BuildingKind, seed: int) -> Plan:
    """Generated buildings in a row, so many that their rooms have the area."""
    obstacles, room = np.ones((1, 0), bool), np.full((1, 0), -1)
    while (missing := area_m2 - np.count_nonzero(room >= 0) * CELL_M**2) > ROOM_M2 / 2:
        # No two of one kind.
        part = generated_map(min(MOST_ROOMS, math.ceil(missing / ROOM_M2)), 100 * seed + obstacles.shape[1], kind)
        labels = np.where(part.rooms >= 0, part.rooms + int(room.max(initial=-1)) + 1, -1)
        rows, seam = max(len(obstacles), len(labels)), obstacles.shape[1]
        obstacles = np.hstack([_as_high(a, rows, True) for a in (obstacles, part.obstacles)])
        room = np.hstack([_as_high(a, rows, -1) for a in (room, labels)])
        if seam:
            _open(obstacles, seam)
    return Plan(obstacles, room)


def _as_high(plan: np.ndarray, rows: int, outside: int) -> np.ndarray:
    """A plan with more rows of outside, about as many above as below."""
    more = rows - len(plan)
    return np.pad(plan, ((more // 2, more - more // 2), (0, 0)), constant_values=outside)


def _open(obstacles: Bool[np.ndarray, "rows cols"], seam: int) -> None:
    """Open the shortest straight passage from the floor to the left of a column to that to the right of it."""
    free = np.asarray(ndimage.minimum_filter1d(~obstacles, PASSAGE_CELLS, axis=0))
    left = np.where(free[:, :seam].any(axis=1), np.argmax(free[:, :seam][:, ::-1], axis=1), seam)
    right = np.where(free[:, seam:].any(axis=1), np.argmax(free[:, seam:], axis=1), obstacles.shape[1])
    row = int(np.argmin(left + right))
    low = row - PASSAGE_CELLS // 2
    obstacles[low : low + PASSAGE_CELLS, seam - left[row] : seam + right[row]] = False


def measure(plan: Plan, coarse_far_field: bool, repeats: int) -> Row:
    """All stages from the top-down map on."""
    pose = _middle(plan)
    topdown = _topdown(plan, pose)
    ms: dict[str, float] = {}

    def timed(stage: str, work: Callable[[], Any]) -> Any:
        times = []
        for _ in range(repeats):
            begin = time.process_time()
            work()
            times.append(1e3 * (time.process_time() - begin))
        ms[stage] = float(np.median(times))
        return work()

    graph = timed(
        "Voronoi", lambda: voronoi_graph(topdown, pose.xy_m, CONFIG, SAFE_M, coarse_far_field=coarse_far_field)
    )
    kept = timed("spurs", lambda: prune_spurs(graph, borders_unknown(graph, topdown.frontier_xy_m)))
    timed("decisions", lambda: decision_vertices(graph, kept))
    rooms = timed("rooms", lambda: segment_rooms(graph, topdown, pose.xy_m))
    timed("paths", lambda: shortest_paths(graph, topdown, pose, SAFE_M))
    cell = world_to_cell(graph.vertex_xy_m, topdown.origin_xy_m, CELL_M)
    return Row(
        np.count_nonzero(plan.room >= 0) * CELL_M**2,
        "coarse far field" if coarse_far_field else "fine",
        len(border_sites(topdown, pose.xy_m, CONFIG, coarse_far_field=coarse_far_field)),
        len(graph.vertex_xy_m),
        len(graph.edges),
        ms,
        int(plan.room.max()) + 1,
        int(rooms.max(initial=-1)) + 1,
        *agreement(rooms, plan.room[cell[:, 0], cell[:, 1]], graph.clearance_m**2),
    )


def agreement(
    found: Int[np.ndarray, " n"], true: Int[np.ndarray, " n"], weight: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Which share of what was found as one room is one, and which share of each room was found as one."""
    known = (found >= 0) & (true >= 0)
    shared = np.zeros((found.max() + 1, true.max() + 1))
    np.add.at(shared, (found[known], true[known]), weight[known])
    return float(shared.max(axis=1).sum() / shared.sum()), float(shared.max(axis=0).sum() / shared.sum())


def _middle(plan: Plan) -> Pose2:
    """The place nearest to the middle at which the robot has room."""
    roomy = np.argwhere(np.asarray(ndimage.distance_transform_edt(~plan.obstacles)) * CELL_M > LEAST_CLEARANCE_M)
    row, col = roomy[np.argmin(np.linalg.norm(roomy - np.array(plan.obstacles.shape) / 2, axis=1))]
    return Pose2((col + 0.5) * CELL_M, (row + 0.5) * CELL_M, 0.0)


def _topdown(plan: Plan, pose: Pose2) -> TopDownMap:
    """The map of a robot that has seen the whole building."""
    layers = math.ceil(DEFAULT_FOOTPRINT.z_max_m / CELL_M) + 1
    state = np.broadcast_to(np.where(plan.obstacles, np.int8(OCCUPIED), np.int8(FREE)), (layers, *plan.obstacles.shape))
    seen = np.broadcast_to(np.float32(1.0), state.shape)

    def sdf(points_m: Float[np.ndarray, "n 3"]) -> np.ndarray:
        row, col = world_to_cell(points_m[:, :2], np.zeros(2), CELL_M).T
        return np.where(plan.obstacles[row, col], np.float32(-TRUNCATION_M / 2), np.float32(TRUNCATION_M))

    grid = OccupancyGrid(state, seen, np.zeros(3), CELL_M)
    return TopDownMapper(CONFIG, DEFAULT_FOOTPRINT).update(grid, sdf, TRUNCATION_M, pose, CAMERA)[0]


if __name__ == "__main__":
    run_script(main)
