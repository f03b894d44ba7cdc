"""Counts what the map's obstacles lose and invent under a noisy depth camera, for raw depth and for the neural field.

    python scripts/bench_geometry.py home aws_small_house --sensor d435i --noise 0 0.5 1 2

Each scene is explored once with exact depth. The same images are then mapped again with the sensor's errors. The truth
is the occupancy grid of the exact images: a column of it is an obstacle where it is occupied at a height of the body.
"lost": obstacles that the map calls free or unknown though it observed the column; "holes": those of them with no
obstacle in the eight columns around, into which a robot could drive; "false": columns more than one beside any
obstacle, seen free at the body's heights with exact depth, that the map calls obstacles.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Bool, Int
from scipy import ndimage

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.events import Observed, On
from anm_mj.explore import explore
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.planning.steps_ahead import lookahead_radius_m
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.camera_sensor import Sensor
from anm_mj.sim.sensors.sensor_config import sensor_config
from anm_mj.types import FREE, OCCUPIED, Footprint, Observation, OccupancyGrid

_AROUND = np.ones((3, 3), bool)
LOOK_EVERY = 8
"""The whole map is read after every so many frames, about as often as a policy decides, else the look-ahead's part."""


@dataclass(frozen=True)
class Row:
    """One map against the truth."""

    scene: str
    sensor: str
    noise: float
    geometry: str
    obstacles: int
    """Columns that are obstacles in truth."""
    lost: int
    holes: int
    false: int
    learnt_noise_per_m: float
    """What the images said of the sensor: sigma_z = this times z^2."""


def walk(scene: str, steps: int, seed: int) -> tuple[list[Observation], Footprint]:
    """What a robot with exact depth sees in a scene, and its body."""
    config = make_config("default", [], scene=scene, policy="gvg", steps=steps, seed=seed)
    seen: list[Observation] = []
    with make_robot(load_scene(scene)) as robot:
        policy = make_policy("gvg", PolicyContext(robot.footprint, config.policy_settings, config.planning, seed))
        mapper = NeuralMap(config.mapping, seed=seed)
        keep = On(Observed, lambda event: seen.append(event.observation))
        explore(robot, mapper, policy, num_steps=steps, observers=(keep,))
        return seen, robot.footprint


def columns(
    grid: OccupancyGrid, body: Footprint
) -> tuple[Bool[np.ndarray, "rows cols"], Bool[np.ndarray, "rows cols"]]:
    """Which columns are obstacles to a body, and which were seen free over at least half its heights."""
    state = grid.state[grid.layers_between(body.z_min_m, body.z_max_m)]
    occupied = (state == OCCUPIED).any(axis=0)
    return occupied, ~occupied & (2 * (state == FREE).sum(axis=0) >= len(state))


def moved(mask: Bool[np.ndarray, "r c"], by: Int[np.ndarray, "2"], shape: tuple[int, int]) -> Bool[np.ndarray, "R C"]:
    """A mask of one grid in the frame of another."""
    out = np.zeros(shape, bool)
    rows, cols = (slice(max(b, 0), min(b + n, m)) for b, n, m in zip(by, mask.shape, shape, strict=True))
    out[rows, cols] = mask[rows.start - by[0] : rows.stop - by[0], cols.start - by[1] : cols.stop - by[1]]
    return out


def compare(
    truth: OccupancyGrid, grid: OccupancyGrid, raw: OccupancyGrid, body: Footprint
) -> tuple[int, int, int, int]:
    """Obstacles in truth, and of a map of the same images: lost ones, holes, false ones."""
    by = np.rint((truth.origin_m - grid.origin_m)[1::-1] / grid.resolution_m).astype(int)
    shape = grid.state.shape[1:]
    obstacle, free = (moved(mask, by, shape) for mask in columns(truth, body))
    found, _ = columns(grid, body)
    observed, _ = columns(raw, body)
    lost = obstacle & observed & ~found
    holes = lost & ~np.asarray(ndimage.binary_dilation(found, _AROUND), bool)
    false = found & free & ~np.asarray(ndimage.binary_dilation(obstacle, _AROUND), bool)
    return int(obstacle.sum()), int(lost.sum()), int(holes.sum()), int(false.sum())


def measure(scene: str, sensor: str, noise: float, seen: list[Observation], body: Footprint) -> list[Row]:
    """Map the images of a walk again with a sensor's errors."""
    config = make_config("default", [], scene=scene).mapping
    mapper = NeuralMap(config, seed=0)
    camera = Sensor(replace(sensor_config(sensor), noise_scale=noise), seed=0)
    truth = DepthOccupancy(config.occupancy)
    for frame, exact in enumerate(seen):
        truth.integrate(exact.depth_m, exact.intrinsics, exact.T_world_camera)
        rgb, depth_m = camera.measure(exact.rgb, exact.depth_m, exact.intrinsics, frame)
        mapper.integrate(replace(exact, rgb=rgb, depth_m=depth_m))
        if frame % LOOK_EVERY == 0:
            _ = mapper.occupancy_grid()
        else:
            mapper.occupancy_grid(exact.pose.xy_m, lookahead_radius_m(body))
    raw = mapper.occupancy.by_depth
    return [
        Row(scene, sensor, noise, name, *compare(truth.grid, grid, raw.grid, body), raw.noise.value)
        for name, grid in (("occupancy", raw.grid), ("field", mapper.occupancy_grid()))
    ]


def main(
    scenes: Annotated[list[str], tyro.conf.Positional],
    sensor: str = "d435i",
    noise: tuple[float, ...] = (1.0,),
    steps: int = 400,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Measure and print.

    Args:
        scenes: names or folders of scenes.
        sensor: as of anm-mj explore.
        noise: values of sensor.noise_scale.
        steps: length of the walk.
        json_file: where the figures go too.
    """
    rows = []
    print("scene\tsensor\tnoise\tgeometry\tobstacles\tlost\tholes\tfalse\tlearnt noise [1/m]")
    for scene in scenes:
        seen, body = walk(scene, steps, seed=0)
        for scale in noise:
            for row in measure(scene, sensor, scale, seen, body):
                rows.append(row)
                print(*asdict(row).values(), sep="\t", flush=True)
    if json_file is not None:
        json_file.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n")


if __name__ == "__main__":
    run_script(main)
