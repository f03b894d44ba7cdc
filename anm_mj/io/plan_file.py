"""What a decision was read from, as a compressed NumPy archive: top-down map, Voronoi graph, regions and path.

The keys are those of the values in :mod:`anm_mj.types`; a key is absent where the plan had no such part. Lengths in the
graph and the path are float32, which is 1 micrometre at 10 m.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.io.write import reading, writing
from anm_mj.types import Plan, Region, TopDownMap, VoronoiGraph
from anm_mj.utils.file_limits import MAX_CELLS
from anm_mj.utils.files import atomic_write
from anm_mj.utils.read_file import array_of, read_npz

_FINEST_M, _COARSEST_M = 1e-4, 100.0
"""Cells have edges between these [m]."""
_FARTHEST_M = 1e6
"""A map begins nowhere beyond this [m]."""


def write_plan(path: Path, plan: Plan) -> None:
    """Write what a decision was read from, whole or not at all. Raises RunFolderError if the file cannot be written."""
    arrays: dict[str, Any] = {"path_xy_m": np.asarray(plan.path_xy_m, np.float32).reshape(-1, 2)}
    if plan.topdown is not None:
        # Half precision: 2 mm at 4 m, and half the bytes.
        arrays |= {
            "state": plan.topdown.state,
            "clearance_m": plan.topdown.clearance_m.astype(np.float16),
            "resolution_m": np.float64(plan.topdown.resolution_m),
            "origin_xy_m": plan.topdown.origin_xy_m,
        }
        if plan.topdown.no_floor is not None and plan.topdown.no_floor.any():
            arrays["no_floor"] = plan.topdown.no_floor
    if plan.graph is not None:
        arrays |= {
            "vertex_xy_m": plan.graph.vertex_xy_m.astype(np.float32),
            "vertex_clearance_m": plan.graph.clearance_m.astype(np.float32),
            "edges": plan.graph.edges.reshape(-1, 2).astype(np.int32),
            "edge_length_m": plan.graph.edge_length_m.astype(np.float32),
        }
    if plan.regions:
        arrays |= {
            "region_centre_m": np.array([region.centre_m for region in plan.regions], np.float32),
            "region_normal": np.array([region.normal for region in plan.regions], np.float32),
            "region_members": np.array([region.num_members for region in plan.regions], np.int32),
            "region_score": np.array([region.score for region in plan.regions], np.float32),
            "region_vertex": np.array([region.vertex for region in plan.regions], np.int32),
        }
    with writing(path), atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_plan(path: Path) -> Plan:
    """Read what :func:`write_plan` wrote: a plan without its reason, and all else that is not in the file. Raises
    RunFolderError if the file is missing or holds something else.
    """
    with reading(path, "a decision", "copy the run again"):
        arrays = read_npz(path)
        path_xy_m = array_of(arrays, "path_xy_m", "f", (None, 2)).astype(np.float64)
        graph = _graph(arrays)
        return Plan("", path_xy_m, topdown=_topdown(arrays), graph=graph, regions=tuple(_regions(arrays, graph)))


def _topdown(arrays: dict[str, np.ndarray]) -> TopDownMap | None:
    if "state" not in arrays:
        return None
    state = array_of(arrays, "state", "iu", (None, None))
    clearance_m = arrays.get("clearance_m")
    if not state.size:
        raise ValueError(f"its map has {state.shape[0]} x {state.shape[1]} cells")
    if state.size > MAX_CELLS:
        raise ValueError(
            f"its map has {state.size} cells, but they end at {MAX_CELLS}: set ANM_MJ_MAX_CELLS if there should be so "
            "many"
        )
    # Infinite where no obstacle is.
    if clearance_m is None or clearance_m.dtype.kind != "f" or clearance_m.shape != state.shape:
        raise ValueError("clearance_m does not fit state")
    resolution_m = float(array_of(arrays, "resolution_m", "f", ()))
    if not _FINEST_M <= resolution_m <= _COARSEST_M:
        raise ValueError(f"resolution_m is {resolution_m:g}")
    origin_xy_m = array_of(arrays, "origin_xy_m", "f", (2,))
    if np.abs(origin_xy_m).max() > _FARTHEST_M:
        raise ValueError(f"origin_xy_m is {origin_xy_m}")
    no_floor = array_of(arrays, "no_floor", "b", state.shape) if "no_floor" in arrays else None
    return TopDownMap(clearance_m.astype(np.float32), state, resolution_m, origin_xy_m, no_floor=no_floor)


def _graph(arrays: dict[str, np.ndarray]) -> VoronoiGraph | None:
    if "vertex_xy_m" not in arrays:
        return None
    vertices = array_of(arrays, "vertex_xy_m", "f", (None, 2)).astype(np.float64)
    clearance = array_of(arrays, "vertex_clearance_m", "f", (len(vertices),)).astype(np.float64)
    edges = array_of(arrays, "edges", "iu", (None, 2)).astype(np.int64)
    if len(edges) and (edges.min() < 0 or edges.max() >= len(vertices)):
        raise ValueError("edges name vertices that are not there")
    length_m = array_of(arrays, "edge_length_m", "f", (len(edges),)).astype(np.float64)
    return VoronoiGraph(vertices, clearance, edges, length_m)


def _regions(arrays: dict[str, np.ndarray], graph: VoronoiGraph | None) -> list[Region]:
    if "region_centre_m" not in arrays:
        return []
    centres = array_of(arrays, "region_centre_m", "f", (None, 3)).astype(np.float64)
    columns = (
        centres,
        array_of(arrays, "region_normal", "f", (len(centres), 3)).astype(np.float64),
        array_of(arrays, "region_members", "iu", (len(centres),)),
        array_of(arrays, "region_score", "f", (len(centres),)),
        array_of(arrays, "region_vertex", "iu", (len(centres),)),
    )
    num_vertices = 0 if graph is None else len(graph.vertex_xy_m)
    if len(centres) and not (columns[4].min() >= 0 and columns[4].max() < num_vertices):
        raise ValueError(f"regions name vertices {columns[4].min()} to {columns[4].max()} of {num_vertices}")
    if len(centres) and columns[2].min() < 1:
        raise ValueError(f"a region has {columns[2].min()} members")
    return [
        Region(centre, normal, int(members), float(score), int(vertex))
        for centre, normal, members, score, vertex in zip(*columns, strict=True)
    ]
