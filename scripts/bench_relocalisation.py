"""How often a robot that does not know where it stands is found in its map.

    python scripts/bench_relocalisation.py /tmp/relocalisation
    python scripts/bench_relocalisation.py /tmp/relocalisation --scenes home --trials 20 --steps 300

In each scene one run with localisation makes a map; a run that the folder holds already is taken as it is. Then the
robot is put, again and again, at a place that the map knows: at an unknown start, or while it is tracked, 2 m from
where it was and turned by 90 degrees either way. It turns on the spot until it is found. Nothing is mapped meanwhile.
A believed pose that is off by 0.25 m or 10 degrees is a wrong place. Prints a Markdown table.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.frames import pose_matrix, relative_pose, wrap_angle
from anm_mj.localisation.field_localiser import FieldLocaliser
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.localiser import PoseEstimate
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.run import run
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.importing.import_on_demand import folder_of
from anm_mj.scene.navigable import is_clear, sample_start
from anm_mj.sensing.pose_check import moved
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import FREE, UNKNOWN, Action, Pose2
from anm_mj.utils.arrays import values_at

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot

WITHIN_STEPS = 40
TRACKED_STEPS = 6
"""Before a robot is moved."""
AFTER_STEPS = 5
"""A robot that was found is tracked so much longer, to see whether the place was right."""
MOVED_M, MOVED_RAD = 2.0, math.pi / 2
WRONG_M, WRONG_RAD = 0.25, math.radians(10.0)
_ATTEMPTS = 1000


@dataclass(frozen=True)
class Trial:
    """How one search went."""

    steps: int | None
    """Until the robot was found; None = it was not."""
    error_m: float
    """When it was found [m]."""
    error_rad: float
    is_wrong: bool
    """Whether a wrong place was believed, or a frame was to be mapped from one."""


def main(
    out: Annotated[Path, tyro.conf.Positional],
    scenes: tuple[str, ...] = ("home", "office", "residence"),
    trials: int = 20,
    steps: int = 500,
    preset: str = "default",
    seed: int = 0,
) -> None:
    """Make the maps and search.

    Args:
        out: folder of the runs.
        scenes: names or folders.
        trials: of each kind in each scene.
        steps: of the run that makes a map.
        preset: of that map.
        seed: of runs, places and noise.
    """
    print("| scene | robot | found | wrong places | steps, median and most | error, median and most |")
    print("|---|---|---|---|---|---|")
    for name in scenes:
        scene = folder_of(name)
        folder = out / Path(scene).name
        config = make_config(
            preset, ["model.wheel_noise=0.02"], scene=scene, pose="slam", steps=steps, seed=seed, device="cpu"
        )
        if not (folder / "metrics.json").is_file():
            run(config, out=folder)
        loaded = load_scene(scene)
        for kind, knows_start in (("starts somewhere", False), ("is moved", True)):
            neural_map = NeuralMap.load(folder / "map.safetensors", device="cpu")
            found = []
            with make_robot(loaded, config, knows_start=knows_start) as robot:
                for number in range(trials):
                    random = np.random.default_rng([seed, 41, knows_start, number])
                    search = is_moved if knows_start else starts_somewhere
                    found.append(search(neural_map, robot, loaded, random))
            print(f"| `{Path(scene).name}` | {kind} | {summary(found)} |", flush=True)


def starts_somewhere(
    neural_map: NeuralMap, robot: SimRobot, scene: Scene, random: np.random.Generator, within: int = WITHIN_STEPS
) -> Trial:
    """Search for a robot that was never told where it is."""
    robot.restart(known_place(neural_map, robot, scene, random), seed=int(random.integers(2**31)))
    localiser = FieldLocaliser(neural_map, LocalisationConfig(), seed=0, planar=True, odometry=True, lost=True)
    return searched(robot, (localiser.localise(robot.observe()) for _ in turning(robot, within)))


def is_moved(
    neural_map: NeuralMap, robot: SimRobot, scene: Scene, random: np.random.Generator, within: int = WITHIN_STEPS
) -> Trial:
    """Search for a robot that somebody carried away, which its odometry does not tell."""
    for _ in range(_ATTEMPTS):
        start = known_place(neural_map, robot, scene, random)
        way, turn = random.uniform(0.0, math.tau), random.choice([-1.0, 1.0]) * MOVED_RAD
        there = Pose2(start.x_m + MOVED_M * math.cos(way), start.y_m + MOVED_M * math.sin(way), 0.0)
        if is_clear(scene, there, robot.footprint) and is_known(neural_map, there):
            break
    else:
        raise SystemExit(f"In scene {scene.name} no two known places are {MOVED_M:g} m apart; map it longer.")
    robot.restart(start, seed=int(random.integers(2**31)))
    localiser = FieldLocaliser(neural_map, LocalisationConfig(), seed=0, planar=True, odometry=True)
    for _ in turning(robot, TRACKED_STEPS):
        localiser.localise(robot.observe())
    before = robot.odometry
    robot.place(replace(there, yaw_rad=wrap_angle(robot.pose.yaw_rad + turn)))
    # The odometry does not tell that the robot was carried.
    T_before_now = pose_matrix(before) @ np.linalg.inv(pose_matrix(robot.odometry))
    return searched(robot, (localiser.localise(moved(robot.observe(), T_before_now)) for _ in turning(robot, within)))


def turning(robot: SimRobot, count: int) -> Iterator[int]:
    """Turn the robot on the spot between so many steps."""
    for step in range(count):
        yield step
        robot.act(Action.TURN_LEFT)


def searched(robot: SimRobot, estimates: Iterator[PoseEstimate]) -> Trial:
    """Judge a search, up to some steps after the robot was found."""
    steps, first, is_wrong, left = None, (math.nan, math.nan), False, AFTER_STEPS
    for number, estimate in enumerate(estimates):
        apart = relative_pose(robot.pose, estimate.observation.pose)
        error = math.hypot(apart.x_m, apart.y_m), abs(apart.yaw_rad)
        believed = estimate.usable or estimate.relocalised
        is_wrong |= believed and (error[0] > WRONG_M or error[1] > WRONG_RAD)
        if estimate.relocalised and steps is None:
            steps, first = number, error
        left -= steps is not None
        if left < 0:
            break
    return Trial(steps, *first, is_wrong)


def known_place(neural_map: NeuralMap, robot: SimRobot, scene: Scene, random: np.random.Generator) -> Pose2:
    """A clear place with any heading that the map knows."""
    for _ in range(_ATTEMPTS):
        pose = sample_start(scene, robot.footprint, random)
        if is_known(neural_map, pose):
            return pose
    raise SystemExit(f"The map of scene {scene.name} knows no clear place; map it longer.")


def is_known(neural_map: NeuralMap, pose: Pose2) -> bool:
    """Whether the map has seen that there is nothing at the height of 0.3 m."""
    grid = neural_map.occupancy_grid()
    at = np.array([pose.x_m, pose.y_m, 0.3]) - grid.origin_m
    return bool(values_at(grid.state, np.floor(at / grid.resolution_m).astype(int)[::-1], UNKNOWN) == FREE)


def summary(trials: list[Trial]) -> str:
    """The cells of a row of the table."""
    found = [trial for trial in trials if trial.steps is not None]
    cells = [f"{len(found)} of {len(trials)}", str(sum(trial.is_wrong for trial in trials))]
    if not found:
        return " | ".join([*cells, "", ""])
    steps = [trial.steps for trial in found if trial.steps is not None]
    errors_cm = [100.0 * trial.error_m for trial in found]
    cells.append(f"{np.median(steps):g}, {max(steps)}")
    cells.append(f"{np.median(errors_cm):.1f} cm, {max(errors_cm):.1f} cm")
    return " | ".join(cells)


if __name__ == "__main__":
    run_script(main)
