"""Measures which uncertainty predicts the map's true error best.

    python scripts/bench_uncertainty.py runs/a runs/b --json uncertainty.json

Each folder is one of a finished run. Its map's zero-crossings are taken twice: "surface", near occupied voxels, where
the planner asks, and "everywhere" in the scene's bounding box, with what the field has made up where nothing was seen.
The error of a point is its distance to the true surface. Points are removed from the most uncertain on; the mean error
of those that remain is the sparsification curve. A number is the area between it and the curve of a perfect ranking, as
a share of what chance leaves (AUSE; Ilg et al., Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow,
ECCV 2018, section 4): 0 is a perfect ranking, 1 is no better than chance. The time is that of one call for all points
of the row.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float
from scipy.stats import rankdata

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.run_folder import RunFolder
from anm_mj.mapping.last_layer import PRIOR_OBSERVATIONS, last_layer_variance, leverage, observation_density
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.surface import crossings
from anm_mj.mapping.uncertainty import closed_form_variance, perturbed_variance

LATTICE_M = 0.1
"""Spacing of the lattice on which zero-crossings are looked for [m]."""
NUM_POINTS = 20_000
"""Points that each number is computed on; fewer where there are fewer crossings."""


@dataclass(frozen=True)
class Row:
    """One method on one run's points."""

    run: str
    points: str
    method: str
    area: float
    """Relative to chance."""
    rank_correlation: float
    """With the error."""
    ms: float


def main(runs: Annotated[tuple[Path, ...], tyro.conf.Positional], json_file: Path | None = None) -> None:
    """Print the table, and write it as JSON.

    Args:
        runs: Folders of finished runs.
        json_file: Where to write the rows; nowhere if not given.
    """
    rows: list[Row] = []
    for path in runs:
        folder = RunFolder.open(path)
        rows += measure(path.name, NeuralMap.load(folder.map), GroundTruth.load(folder.ground_truth))
    print(table(rows))
    if json_file:
        json_file.write_text(json.dumps([vars(row) for row in rows], indent=2) + "\n", encoding="utf-8")


def measure(name: str, neural_map: NeuralMap, truth: GroundTruth) -> list[Row]:
    """All methods on both kinds of points of one map."""
    rng = np.random.default_rng(0)
    vertices = truth.vertices.astype(float)
    rows = []
    for kind, points in {"surface": surface(neural_map), "everywhere": everywhere(neural_map, vertices)}.items():
        points = points[rng.permutation(len(points))[:NUM_POINTS]]
        error = surface_distance(points, vertices, truth.faces)
        for method, uncertainty in methods(neural_map).items():
            begin = time.perf_counter()
            values = uncertainty(points).astype(float)
            ms = 1000.0 * (time.perf_counter() - begin)
            rows.append(Row(name, kind, method, relative_area(error, values), rank_correlation(error, values), ms))
    return rows


def methods(neural_map: NeuralMap) -> dict[str, Callable[[Float[np.ndarray, "n 3"]], np.ndarray]]:
    """What is compared: the three methods that can be configured, more passes, and the two factors of the first."""
    backend, occupancy, config = neural_map.backend, neural_map.occupancy.by_depth, neural_map.config.uncertainty
    many, density_exponent = replace(config, num_passes=400), neural_map.config.schedule.density_exponent
    return {
        "perturbation, 20 passes": lambda p: perturbed_variance(backend, p, replace(config, num_passes=20), 0),
        "perturbation, 400 passes": lambda p: perturbed_variance(backend, p, many, 0),
        "closed form": lambda p: closed_form_variance(backend, p, config),
        "leverage alone": lambda p: leverage(backend, occupancy, p, density_exponent),
        "observation count alone": lambda p: 1.0 / (PRIOR_OBSERVATIONS + observation_density(occupancy, p)),
        "last_layer_variance": lambda p: last_layer_variance(backend, occupancy, p, density_exponent),
    }


def surface(neural_map: NeuralMap) -> Float[np.ndarray, "n 3"]:
    """Zero-crossings near occupied voxels, world [m]."""
    grid = neural_map.occupancy_grid()
    size = np.array(grid.state.shape[::-1]) * grid.resolution_m
    middle = grid.origin_m + 0.5 * size
    return neural_map.surface(middle[:2], float(np.linalg.norm(size))).xyz_m.astype(float)


def everywhere(neural_map: NeuralMap, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "n 3"]:
    """Zero-crossings in the bounding box of the true surface, seen or not, world [m]."""
    first = np.ceil(vertices.min(axis=0) / LATTICE_M).astype(np.int64)
    last = np.floor(vertices.max(axis=0) / LATTICE_M).astype(np.int64)
    cells = np.ones(last - first, bool)
    return crossings(neural_map.backend.query_sdf, cells, first, LATTICE_M).astype(float)


def sparsification_curve(
    error: Float[np.ndarray, " n"], removed_first: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Mean error of what remains after removing 0, 1, ..., n - 1 points.

    Args:
        error: Error of each point, in any unit.
        removed_first: The larger, the earlier a point goes. Equal ones are each given their group's mean error, so that
            the curve is the mean over all orders within the group.
    """
    order = np.argsort(removed_first, kind="stable")
    _, group = np.unique(removed_first[order], return_inverse=True)
    group_mean = np.bincount(group, error[order]) / np.bincount(group)
    remaining = np.cumsum(group_mean[group]) / np.arange(1, len(error) + 1)
    return remaining[::-1]


def relative_area(error: Float[np.ndarray, " n"], uncertainty: Float[np.ndarray, " n"]) -> float:
    """Area between the sparsification curves of an uncertainty and of the error itself, relative to chance (AUSE).

    0 for a perfect ranking and where all errors are equal, 1 for a random one, above 1 for a worse one.
    """
    best = sparsification_curve(error, error)
    by_chance = float(np.mean(error) - np.mean(best))
    area = float(np.mean(sparsification_curve(error, uncertainty) - best))
    return area / by_chance if by_chance > 0.0 else 0.0


def rank_correlation(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    """Spearman's rank correlation, in [-1, 1]; NaN where either is constant."""
    ranks = np.stack([rankdata(a), rankdata(b)])
    if (np.ptp(ranks, axis=1) == 0.0).any():
        return float("nan")
    return float(np.corrcoef(ranks)[0, 1])


def table(rows: list[Row]) -> str:
    """Areas, a line per method, with their mean over the runs."""
    runs = list(dict.fromkeys(row.run for row in rows))
    lines = []
    for kind in dict.fromkeys(row.points for row in rows):
        lines.append(f"{kind:<26}" + "".join(f"{run[:15]:>16}" for run in (*runs, "mean", "ms")))
        for method in dict.fromkeys(row.method for row in rows):
            mine = {row.run: row for row in rows if row.points == kind and row.method == method}
            areas = [mine[run].area for run in runs]
            ms = float(np.mean([row.ms for row in mine.values()]))
            lines.append(
                f"  {method:<24}" + "".join(f"{area:>16.3f}" for area in (*areas, np.mean(areas))) + f"{ms:>16.1f}"
            )
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    run_script(main)
