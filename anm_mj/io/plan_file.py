"""What a decision was read from, as a compressed NumPy archive: top-down map, Voronoi graph, regions and path.

The keys are those of the values in :mod:`anm_mj.types`; a key is absent where the plan had no such part. Lengths in the
graph and the path are float32, which is 1 micrometre at 10 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.io.write import writing
from anm_mj.types import Plan, Region, TopDownMap, VoronoiGraph
from anm_mj.utils.files import atomic_write


@dataclass(frozen=True)
class PlanRecord:
    """A decision as replay and exports read it."""

    path_xy_m: Float[np.ndarray, "k 2"]
    """Polyline from the robot to the target, world [m]; empty for a turn on the spot or a stop."""
    topdown: TopDownMap | None = None
    graph: VoronoiGraph | None = None
    regions: tuple[Region, ...] = ()

    @classmethod
    def of(cls, plan: Plan) -> PlanRecord:
        """The parts of a plan that are recorded."""
        return cls(plan.path_xy_m, plan.topdown, plan.graph, plan.regions)


def write_plan(path: Path, record: PlanRecord) -> None:
    """Write a decision, whole or not at all.

    Raises:
        RunFolderError: The file cannot be written.
    """
    arrays: dict[str, Any] = {"path_xy_m": np.asarray(record.path_xy_m, np.float32).reshape(-1, 2)}
    if record.topdown is not None:
        # Half precision: 2 mm at 4 m, and half the bytes.
        arrays |= {
            "state": record.topdown.state,
            "clearance_m": record.topdown.clearance_m.astype(np.float16),
            "resolution_m": np.float64(record.topdown.resolution_m),
            "origin_xy_m": record.topdown.origin_xy_m,
        }
    if record.graph is not None:
        arrays |= {
            "vertex_xy_m": record.graph.vertex_xy_m.astype(np.float32),
            "vertex_clearance_m": record.graph.clearance_m.astype(np.float32),
            "edges": record.graph.edges.reshape(-1, 2).astype(np.int32),
            "edge_length_m": record.graph.edge_length_m.astype(np.float32),
        }
    if record.regions:
        arrays |= {
            "region_centre_m": np.array([region.centre_m for region in record.regions], np.float32),
            "region_normal": np.array([region.normal for region in record.regions], np.float32),
            "region_members": np.array([region.num_members for region in record.regions], np.int32),
            "region_score": np.array([region.score for region in record.regions], np.float32),
            "region_vertex": np.array([region.vertex for region in record.regions], np.int32),
        }
    with writing(path), atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_plan(path: Path) -> PlanRecord:
    """Read what :func:`write_plan` wrote.

    Raises:
        RunFolderError: The file is missing or holds something else.
    """
    try:
        with path.open("rb") as file, np.load(file) as data:
            arrays = dict(data)
        return PlanRecord(
            arrays["path_xy_m"].astype(np.float64), _topdown(arrays), _graph(arrays), tuple(_regions(arrays))
        )
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as err:
        raise RunFolderError(f"{path} cannot be read as a decision ({err}); copy the run again.") from err


def _topdown(arrays: dict[str, np.ndarray]) -> TopDownMap | None:
    if "state" not in arrays:
        return None
    return TopDownMap(
        arrays["clearance_m"].astype(np.float32), arrays["state"], float(arrays["resolution_m"]), arrays["origin_xy_m"]
    )


def _graph(arrays: dict[str, np.ndarray]) -> VoronoiGraph | None:
    if "vertex_xy_m" not in arrays:
        return None
    vertices, clearance = arrays["vertex_xy_m"].astype(np.float64), arrays["vertex_clearance_m"].astype(np.float64)
    return VoronoiGraph(
        vertices, clearance, arrays["edges"].astype(np.int64), arrays["edge_length_m"].astype(np.float64)
    )


def _regions(arrays: dict[str, np.ndarray]) -> list[Region]:
    if "region_centre_m" not in arrays:
        return []
    columns = (arrays[f"region_{key}"] for key in ("centre_m", "normal", "members", "score", "vertex"))
    return [
        Region(centre.astype(np.float64), normal.astype(np.float64), int(members), float(score), int(vertex))
        for centre, normal, members, score, vertex in zip(*columns, strict=True)
    ]
