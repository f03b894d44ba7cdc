"""Measures whether a map keeps its pace, and its detail, as the scene grows.

    python scripts/bench_growth.py --json-file growth.json
    python scripts/bench_growth.py runs/hospital --seeds 3

Without a run, maps learn from buildings in closed form, of furnished rooms of 20 m2 each: one of 80 m2, the largest of
2,000 m2, with 12 views from each room. Printed is what taking in one more observation costs each (CPU time of one
thread, the maps by turns), and its ratio to the cost in the smallest.

With the folder of a finished run in a large building, its pictures are taken again where its camera stood, and three
maps learn from them with every seed: one until it knows a room, one until it knows a flat, and one from all of them;
what a map knows is the floor area under free space. Printed is the accuracy of each too (mean distance of the
reconstruction to the true surface), with the ratios that matter: accuracy of the whole against the room, cost of the
whole against the flat.
"""

import gc
import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from jaxtyping import Float

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.rerender import explored_scene, observations_of
from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.frames import pixel_directions
from anm_mj.ground_truth.ground_truth import NUM_SAMPLES, GroundTruth, sample_triangles
from anm_mj.io.read_run import read_run
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import FREE, Intrinsics, Observation, Pose2

ROOM_M2, FLAT_M2 = 30.0, 80.0
"""Floor that the smaller maps know [m2]."""
AREA_EVERY = 10
"""The floor is measured after every so many observations."""
NUM_TIMED = 40
"""Observations that the cost is the median of."""
ROOM_M = np.array([5.0, 4.0, 2.6])
"""Of the building in closed form."""
CUPBOARD_M = (np.array([3.6, 0.0, 0.0]), np.array([5.0, 0.6, 1.9]))
"""Lowest and highest corner of what stands in each of its rooms."""
PLACES_M = ((1.2, 1.3), (2.6, 2.8), (3.9, 1.6))
"""Where the camera stands in a room, 1.2 m high; it looks to four sides."""


@dataclass(frozen=True)
class Row:
    """One map."""

    map: str
    """"room", "flat" or "whole" of a run, or the size of the building."""
    seed: int
    observations: int
    floor_m2: float
    log2_table_size: int
    accuracy_cm: float
    """NaN for buildings in closed form."""
    step_ms: float
    """CPU time of one observation."""


def main(
    run: Annotated[Path | None, tyro.conf.Positional] = None,
    preset: str = "default",
    seeds: int = 1,
    areas_m2: tuple[float, ...] = (80.0, 500.0, 2000.0),
    image_px: int = 256,
    json_file: Path | None = None,
) -> None:
    """Print the table, and write it as JSON.

    Args:
        run: Folder of a finished run in a large building; buildings in closed form if not given.
        preset: Mapping preset.
        seeds: How often all is done.
        areas_m2: Sizes of the buildings in closed form, ascending [m2].
        image_px: Edge of the pictures taken in them [px].
        json_file: Where to write the rows; nowhere if not given.
    """
    torch.set_num_threads(1)
    rows: list[Row] = []
    record = read_run(run) if run else None
    observations = list(observations_of(record, explored_scene(record))) if record else []
    truth = GroundTruth.load(record.folder.ground_truth) if record else None
    for seed in range(seeds):
        found = (
            measure(observations, truth, preset, seed) if truth else measure_buildings(areas_m2, image_px, preset, seed)
        )
        rows += found
        for row in found:
            print(row, flush=True)
    small, large = ("flat", "whole") if truth else (rows[0].map, rows[-1].map)
    result: dict[str, object] = {"rows": [vars(row) for row in rows]}
    cost = result["cost_large_by_small"] = ratio(rows, "step_ms", large, small)
    print(f"cost of a step, {large} / {small}: {cost:.3f} (means over {seeds} seeds)")
    if truth:
        accuracy = result["accuracy_whole_by_room"] = ratio(rows, "accuracy_cm", "whole", "room")
        print(f"accuracy, whole / room: {accuracy:.3f}")
    if json_file:
        json_file.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def measure_buildings(areas_m2: Sequence[float], image_px: int, preset: str, seed: int) -> list[Row]:
    """A map of each building; all of them are timed in the building's last rooms, by turns."""
    maps, last, counts = {}, {}, {}
    for area_m2 in areas_m2:
        name = f"{area_m2:g} m2"
        maps[name] = NeuralMap(MAPPING_PRESETS[preset](), seed=seed, device="cpu")
        last[name] = []
        counts[name] = 0
        for observation in building_views(math.ceil(area_m2 / (ROOM_M[0] * ROOM_M[1])), image_px):
            maps[name].integrate(observation)
            last[name] = [*last[name], observation][-NUM_TIMED:]
            counts[name] += 1
    costs = timed(maps, last)
    return [
        Row(name, seed, counts[name], floor_m2(m), m.config.field.log2_table_size, math.nan, costs[name])
        for name, m in maps.items()
    ]


def building_views(num_rooms: int, image_px: int) -> Iterator[Observation]:
    """What a camera sees of so many closed rooms, which lie in rows with 0.2 m between them."""
    columns = math.ceil(math.sqrt(num_rooms))
    step = 0
    for room in range(num_rooms):
        corner = np.array([*(np.array(divmod(room, columns))[::-1] * (ROOM_M[:2] + 0.2)), 0.0])
        for place in PLACES_M:
            for turn in range(4):
                yield room_view(
                    corner, np.array([*place, 1.2]), math.pi / 2 * (turn + 0.1 * (room % 5)), image_px, step
                )
                step += 1


def room_view(
    corner_m: Float[np.ndarray, "3"], place_m: Float[np.ndarray, "3"], yaw_rad: float, image_px: int, step: int
) -> Observation:
    """One picture of a room whose lowest corner is given, from a place in it [m]."""
    intrinsics = Intrinsics.from_fov(image_px, image_px, math.pi / 2)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.array([[s, 0.0, c], [-c, 0.0, s], [0.0, -1.0, 0.0]])
    T_world_camera[:3, 3] = corner_m + place_m
    direction = pixel_directions(intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T
    direction = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    depth = np.maximum(-place_m / direction, (ROOM_M - place_m) / direction).min(axis=1)
    ends = [(bound - place_m) / direction for bound in CUPBOARD_M]
    enter, leave = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
    depth = np.where((enter < leave) & (enter > 0.0), np.minimum(depth, enter), depth)
    colour = 0.5 + 0.3 * np.sin(2.0 * (T_world_camera[:3, 3] + direction * depth[:, None]) + np.arange(3.0))
    return Observation(
        step,
        0.1 * step,
        np.rint(255.0 * colour).astype(np.uint8).reshape(image_px, image_px, 3),
        depth.astype(np.float32).reshape(image_px, image_px),
        intrinsics,
        T_world_camera,
        Pose2(float(T_world_camera[0, 3]), float(T_world_camera[1, 3]), math.remainder(yaw_rad, math.tau)),
    )


def timed(maps: Mapping[str, NeuralMap], observations: Mapping[str, Sequence[Observation]]) -> dict[str, float]:
    """Medians of what one more observation costs each map [ms]."""
    step_ms: dict[str, list[float]] = {name: [] for name in maps}
    gc.collect()
    for k in range(NUM_TIMED):
        # By turns, so that what else runs on the machine meets all of them alike.
        for name, neural_map in maps.items():
            observation = observations[name][k % len(observations[name])]
            begin = time.process_time()
            neural_map.integrate(observation)
            step_ms[name].append(1e3 * (time.process_time() - begin))
    return {name: float(np.median(times)) for name, times in step_ms.items()}


def measure(observations: Sequence[Observation], truth: GroundTruth, preset: str, seed: int) -> list[Row]:
    """The three maps of one seed."""
    limits_m2 = {"room": ROOM_M2, "flat": FLAT_M2, "whole": np.inf}
    maps, used, accuracies_cm, floors_m2 = {}, {}, {}, {}
    for name, limit_m2 in limits_m2.items():
        maps[name], used[name] = learnt(observations, limit_m2, preset, seed)
        accuracies_cm[name] = accuracy_cm(maps[name], truth)
        floors_m2[name] = floor_m2(maps[name])
    costs_ms = timed(maps, {name: observations[max(0, used[name] - NUM_TIMED) : used[name]] for name in maps})
    return [
        Row(
            name,
            seed,
            used[name],
            floors_m2[name],
            neural_map.config.field.log2_table_size,
            accuracies_cm[name],
            costs_ms[name],
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
    grid = neural_map.occupancy_grid()
    return float((grid.state == FREE).any(axis=0).sum()) * grid.resolution_m**2


def accuracy_cm(neural_map: NeuralMap, truth: GroundTruth) -> float:
    """Mean distance of the reconstruction to the true surface [cm]."""
    mesh = neural_map.mesh()
    samples, _ = sample_triangles(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), NUM_SAMPLES, seed=0)
    return 100.0 * float(np.mean(surface_distance(samples, truth.vertices.astype(float), truth.faces)))


def ratio(rows: Sequence[Row], column: str, kind: str, base: str) -> float:
    """Mean of a column over one kind of map, as a share of that over another."""
    return mean_of(rows, column, kind) / mean_of(rows, column, base)


def mean_of(rows: Sequence[Row], column: str, kind: str) -> float:
    """Mean of a column over all seeds of one kind of map."""
    return float(np.mean([getattr(row, column) for row in rows if row.map == kind]))


if __name__ == "__main__":
    run_script(main)
