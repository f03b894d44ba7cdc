"""Measures whether a map keeps its detail and its pace as the scene grows.

    python scripts/bench_growth.py runs/hospital --seeds 3 --json-file growth.json

The folder is one of a finished run in a large building. Its pictures are taken again where its camera stood, and three
maps learn from them with every seed: one until it knows a room, one until it knows a flat, and one from all of them;
what a map knows is the floor area under free space. Printed are the accuracy of each (mean distance of the
reconstruction to the true surface) and what taking in one more observation costs (CPU time of one thread, the three
maps by turns), with the ratios that matter: accuracy of the whole against the room, cost of the whole against the flat.
"""

import gc
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro

from anm_mj.evaluation.ground_truth import NUM_SAMPLES, GroundTruth, sample_triangles
from anm_mj.evaluation.mesh import surface_distance
from anm_mj.io.read_run import read_run
from anm_mj.mapping.config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.revisit import explored_scene, observations_of
from anm_mj.types import FREE, Observation

ROOM_M2, FLAT_M2 = 30.0, 80.0
"""Floor that the smaller maps know [m2]."""
AREA_EVERY = 10
"""The floor is measured after every so many observations."""
NUM_TIMED = 40
"""Observations that the cost is the median of."""


@dataclass(frozen=True)
class Row:
    """One map."""

    map: str
    """"room", "flat" or "whole"."""
    seed: int
    observations: int
    floor_m2: float
    log2_table_size: int
    accuracy_cm: float
    step_ms: float
    """CPU time of one observation."""


def main(
    run: Annotated[Path, tyro.conf.Positional],
    preset: str = "default",
    seeds: int = 3,
    json_file: Path | None = None,
) -> None:
    """Print the table, and write it as JSON.

    Args:
        run: Folder of a finished run in a large building.
        preset: Mapping preset.
        seeds: How often all is done.
        json_file: Where to write the rows; nowhere if not given.
    """
    torch.set_num_threads(1)
    record = read_run(run)
    observations = list(observations_of(record, explored_scene(record)))
    truth = GroundTruth.load(record.folder.ground_truth)
    rows: list[Row] = []
    for seed in range(seeds):
        rows += measure(observations, truth, preset, seed)
        for row in rows[-3:]:
            print(row, flush=True)
    accuracy = ratio(rows, "accuracy_cm", "room")
    cost = ratio(rows, "step_ms", "flat")
    print(
        f"accuracy, whole / room: {accuracy:.3f}; cost of a step, whole / flat: {cost:.3f} (means over {seeds} seeds)"
    )
    if json_file:
        result = {"rows": [vars(row) for row in rows], "accuracy_whole_by_room": accuracy, "cost_whole_by_flat": cost}
        json_file.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def measure(observations: Sequence[Observation], truth: GroundTruth, preset: str, seed: int) -> list[Row]:
    """The three maps of one seed."""
    limits_m2 = {"room": ROOM_M2, "flat": FLAT_M2, "whole": np.inf}
    maps, used, accuracies_cm, floors_m2 = {}, {}, {}, {}
    for name, limit_m2 in limits_m2.items():
        maps[name], used[name] = learnt(observations, limit_m2, preset, seed)
        accuracies_cm[name] = accuracy_cm(maps[name], truth)
        floors_m2[name] = floor_m2(maps[name])
    step_ms: dict[str, list[float]] = {name: [] for name in maps}
    gc.collect()
    for k in range(NUM_TIMED):
        # By turns, so that what else runs on the machine meets all of them alike.
        for name, neural_map in maps.items():
            timed = min(NUM_TIMED, used[name])
            observation = observations[used[name] - timed + k % timed]
            begin = time.process_time()
            neural_map.integrate(observation)
            step_ms[name].append(1e3 * (time.process_time() - begin))
    return [
        Row(
            name,
            seed,
            used[name],
            floors_m2[name],
            neural_map.config.field.log2_table_size,
            accuracies_cm[name],
            float(np.median(step_ms[name])),
        )
        for name, neural_map in maps.items()
    ]


def learnt(observations: Sequence[Observation], limit_m2: float, preset: str, seed: int) -> tuple[NeuralMap, int]:
    """A map of as many observations as it takes to know so much floor, and their number."""
    neural_map = NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device="cpu")
    for count, observation in enumerate(observations, 1):
        neural_map.integrate(observation)
        if np.isfinite(limit_m2) and count % AREA_EVERY == 0 and floor_m2(neural_map) >= limit_m2:
            return neural_map, count
    return neural_map, len(observations)


def floor_m2(neural_map: NeuralMap) -> float:
    """Floor area below anything known to be free [m2]."""
    grid = neural_map.occupancy
    return float((grid.state == FREE).any(axis=0).sum()) * grid.resolution_m**2


def accuracy_cm(neural_map: NeuralMap, truth: GroundTruth) -> float:
    """Mean distance of the reconstruction to the true surface [cm]."""
    mesh = neural_map.mesh()
    samples, _ = sample_triangles(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), NUM_SAMPLES, seed=0)
    return 100.0 * float(np.mean(surface_distance(samples, truth.vertices.astype(float), truth.faces)))


def ratio(rows: Sequence[Row], column: str, base: str) -> float:
    """Mean of a column over the maps of the whole, as a share of that over another kind of map."""
    return mean_of(rows, column, "whole") / mean_of(rows, column, base)


def mean_of(rows: Sequence[Row], column: str, kind: str) -> float:
    """Mean of a column over all seeds of one kind of map."""
    return float(np.mean([getattr(row, column) for row in rows if row.map == kind]))


if __name__ == "__main__":
    tyro.cli(main)
