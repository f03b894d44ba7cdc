"""Measures how good a map each preset learns from the same observations, and at what cost.

    python scripts/map_quality.py runs/a runs/b --seeds 3 --json-file quality.json

Each folder is one of a finished run. Its pictures are taken again where its camera stood, and every preset learns
from them with every seed. Per map:

* "mesh < 5 cm": share of the reconstruction within 5 cm of the true surface, and "accuracy", its mean distance;
* "seen < 5 cm": share of what the depth images show within 5 cm of the reconstruction, and the mean distance. One point
  is taken per 3 cm of surface seen within the sensor's range; every one lies on the true surface;
* "observed < 5 cm": the same share of the samples of the true surface that lie within 5 cm of what the depth images
  show, as the evaluation of a run counts them. Among them is surface that no camera saw: the far sides of boards and
  cushions, and what lies behind the rim of things.

Seconds are CPU time of one thread: of training alone, and of all that the map does with the observations.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from jaxtyping import Float
from rich.console import Console
from rich.table import Table

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.rerender import explored_scene, observations_of
from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.frames import back_project
from anm_mj.ground_truth.ground_truth import COVERED_M, NUM_SAMPLES, GroundTruth, sample_triangles
from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M, back_project_reduced
from anm_mj.io.read_run import Run, read_run
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import MAPPING_PRESETS, MappingConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import Observation

SEEN_SPACING_M = 0.03
"""Edge of the cells that one seen point each is kept of [m]."""
NUM_SEEN = 60_000
"""Seen points that are compared with the reconstruction at most."""
POINTS_PER_FRAME = 4096
"""Pixels of a frame that seen points are taken from."""


@dataclass(frozen=True)
class Row:
    """One map."""

    run: str
    preset: str
    seed: int
    mesh_within_percent: float
    accuracy_cm: float
    seen_within_percent: float
    seen_cm: float
    observed_within_percent: float
    training_s: float
    mapping_s: float
    """With occupancy."""


COLUMNS = {
    "mesh_within_percent": "mesh < 5 cm %",
    "accuracy_cm": "accuracy cm",
    "seen_within_percent": "seen < 5 cm %",
    "seen_cm": "seen cm",
    "observed_within_percent": "observed < 5 cm %",
    "training_s": "training s",
    "mapping_s": "mapping s",
}
"""Columns of the table by the row's field."""


@dataclass(frozen=True)
class Target:
    """What a map of a run is compared with."""

    truth: GroundTruth
    seen: Float[np.ndarray, "n 3"]
    """Points that the depth images show [m]."""
    observed: Float[np.ndarray, "m 3"]
    """Samples of the true surface near such points [m]."""


def main(
    runs: Annotated[tuple[Path, ...], tyro.conf.Positional],
    presets: tuple[str, ...] = ("default", "paper"),
    seeds: int = 3,
    json_file: Path | None = None,
) -> None:
    """Print the table, and write it as JSON.

    Args:
        runs: Folders of finished runs.
        presets: Presets to compare.
        seeds: Maps per preset and run.
        json_file: Where to write the rows; nowhere if not given.
    """
    torch.set_num_threads(1)
    rows: list[Row] = []
    for path in runs:
        record = read_run(path)
        observations = list(observations_of(record, explored_scene(record)))
        target = target_of(record, observations)
        for preset in presets:
            for seed in range(seeds):
                rows.append(measure(path.name, preset, seed, observations, target))
                print(rows[-1], flush=True)
    print_table(rows)
    if json_file:
        json_file.write_text(json.dumps([vars(row) for row in rows], indent=2) + "\n", encoding="utf-8")


def measure(run: str, preset: str, seed: int, observations: list[Observation], target: Target) -> Row:
    """Learn one map and compare it."""
    config = MAPPING_PRESETS[preset]()
    neural_map, mapping_s = learnt(config, seed, observations)
    mesh = neural_map.mesh()
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    samples, _ = sample_triangles(vertices, faces, NUM_SAMPLES, seed=0)
    accuracy_m = surface_distance(samples, target.truth.vertices.astype(float), target.truth.faces)
    seen_m = surface_distance(target.seen, vertices, faces)
    observed_m = surface_distance(target.observed, vertices, faces)
    return Row(
        run,
        preset,
        seed,
        mesh_within_percent=100.0 * float(np.mean(accuracy_m < COVERED_M)),
        accuracy_cm=100.0 * float(np.mean(accuracy_m)),
        seen_within_percent=100.0 * float(np.mean(seen_m < COVERED_M)),
        seen_cm=100.0 * float(np.mean(seen_m)),
        observed_within_percent=100.0 * float(np.mean(observed_m < COVERED_M)),
        training_s=mapping_s - fusing_s(config, observations),
        mapping_s=mapping_s,
    )


def learnt(config: MappingConfig, seed: int, observations: list[Observation]) -> tuple[NeuralMap, float]:
    """A map of the observations, and the CPU seconds that it took."""
    neural_map = NeuralMap(config, seed=seed, device="cpu")
    begin = time.process_time()
    for observation in observations:
        neural_map.integrate(observation)
    return neural_map, time.process_time() - begin


def fusing_s(config: MappingConfig, observations: list[Observation]) -> float:
    """CPU seconds that the occupancy grid alone takes for the observations."""
    occupancy = DepthOccupancy(config.occupancy)
    begin = time.process_time()
    for observation in observations:
        occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    return time.process_time() - begin


def target_of(record: Run, observations: list[Observation]) -> Target:
    """The true surface of a run's scene, and what of it the run's depth images show."""
    truth = GroundTruth.load(record.folder.ground_truth)
    coverage = Coverage(truth.samples)
    for frame in record.frames:
        depth_mm = record.depth_mm(frame)
        coverage.add_points(back_project_reduced(depth_mm, record.intrinsics, frame.T_world_camera))
    observed = truth.samples[coverage.distance_m < COVERED_M].astype(float)
    rng = np.random.default_rng(0)
    cells: dict[tuple[int, int, int], np.ndarray] = {}
    for observation in observations:
        points = seen_points(observation, rng)
        keys = np.floor(points / SEEN_SPACING_M).astype(np.int64)
        for key, point in zip(map(tuple, keys.tolist()), points, strict=True):
            cells.setdefault(key, point)
    seen = np.array(list(cells.values()))
    return Target(truth, seen[rng.permutation(len(seen))[:NUM_SEEN]], observed)


def seen_points(observation: Observation, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """World points of some pixels of a frame, those within the sensor's range [m]."""
    near = np.where(observation.depth_m <= MAX_DEPTH_M, observation.depth_m, np.nan).astype(np.float32)
    points = back_project(near, observation.intrinsics, observation.T_world_camera)
    return points[rng.permutation(len(points))[:POINTS_PER_FRAME]]


def print_table(rows: list[Row]) -> None:
    """Means over the seeds, with the smallest and the largest value."""
    table = Table("run", "preset", "maps", *COLUMNS.values())
    for run, preset in dict.fromkeys((row.run, row.preset) for row in rows):
        mine = [row for row in rows if (row.run, row.preset) == (run, preset)]
        cells = []
        for name in COLUMNS:
            values = [getattr(row, name) for row in mine]
            cells.append(f"{np.mean(values):.2f} ({min(values):.2f} - {max(values):.2f})")
        table.add_row(run, preset, str(len(mine)), *cells)
    Console(width=190).print(table)


if __name__ == "__main__":
    run_script(main)
