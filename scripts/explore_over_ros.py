"""Whole explorations over ROS 2, each beside the same one within a single process.

    python scripts/explore_over_ros.py /tmp/over_ros
    python scripts/explore_over_ros.py /tmp/over_ros --scenes home,/tmp/imported --steps 300 --starts 0,1,2 --noisy

Starts ``anm-mj simulate`` and ``anm-mj drive`` as two processes on this machine alone, and records the true pose, which
the explorer never hears. Both runs of a pair begin at one of the scene's starts and know their poses from there alone.
Coverage counts the depth points of both from true poses. Prints a Markdown table: completion ratio over the wire and in
one process after the same number of actions, turns of both, contacts, real-time factor, images that were left out, how
often the robot had to stop because something was missing, and the load of the machine.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.config import DEFAULT_PRESET, make_config
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.frames import pose_matrix
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.read_run import read_json, read_run
from anm_mj.io.ros_messages import seconds
from anm_mj.io.run_folder import RunFolder
from anm_mj.run import run_with
from anm_mj.run_parts import make_parts
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.import_on_demand import folder_of
from anm_mj.sim.sensors.sensor_config import SENSORS
from anm_mj.types import Pose2

SENSOR, WHEELS = "d435i", "model.wheel_noise=0.02"
COLUMNS = (
    "scene, start, errors, steps, over ROS 2, in one process, turns, turns in one process, contacts, real-time factor, "
    "left out, stops, load"
)
START_S = 10.0
DOMAIN = 77


def main(
    out: Annotated[Path, tyro.conf.Positional],
    scenes: str = "home",
    steps: int = 300,
    starts: str = "0",
    seed: int = 0,
    noisy: bool = False,
) -> None:
    """Explore each scene from each start, twice; runs that the folder holds already are taken as they are.

    Args:
        out: folder of the runs.
        scenes: names or folders, separated by commas.
        steps: actions of a run.
        starts: numbers of the scene's starts, separated by commas.
        seed: of training, policy and errors.
        noisy: a RealSense's depth errors, wheels that slip, and localisation.
    """
    os.environ |= {"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": str(DOMAIN)}
    columns = COLUMNS.split(", ")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|", flush=True)
    for scene in scenes.split(","):
        for start in map(int, starts.split(",")):
            print(pair(out, scene, start, steps, seed, noisy=noisy), flush=True)


def pair(out: Path, scene: str, number: int, steps: int, seed: int, *, noisy: bool) -> str:
    """A row of the table."""
    title = Path(scene).name
    name = f"{title}_{steps}_{number}_{seed}{'_noisy' if noisy else ''}"
    inside, wire = RunFolder(out / f"{name}_inside"), RunFolder(out / f"{name}_wire")
    # Errors of the wheels without a correction are no matter of the wire.
    believed = {"pose": "slam" if noisy else "odometry", "steps": steps, "seed": seed}
    known = load_scene(folder_of(scene)).starts
    if number >= len(known):
        raise SystemExit(f"{scene} has {len(known)} starts, and none of number {number}; give --starts smaller ones.")
    start = known[number]
    there = (start.x_m, start.y_m, math.degrees(start.yaw_rad))
    if not inside.metrics.is_file():
        explore_inside(inside.path, scene, noisy=noisy, start=there, **believed)
    if not wire.metrics.is_file():
        errors = ("--sensor", SENSOR, "--set", WHEELS) if noisy else ()
        at = f"--start={','.join(map(str, there))}"
        options = [word for key, value in believed.items() for word in (f"--{key}", value)]
        # As whoever looks into the camera's data sheet would.
        options += ["--set", f"ros.max_range_m={SENSORS[SENSOR].max_range_m}"] if noisy else []
        explore_over_ros(wire.path, (scene, at, *errors, "--seed", seed), options)
    facts = (out / f"{wire.path.name}.txt").read_text()
    ((rate, contacts, left_out),) = re.findall(r"factor ([\d.]+)\), (\d+) contacts, .*, (\d+) left out", facts)
    stops, load = facts.count("The robot stops"), facts.splitlines()[0]
    over, alone = coverage(wire.path, inside), read_json(inside.metrics)["completion_ratio"]
    turned = " | ".join(str(num_turns(run.path)) for run in (wire, inside))
    return (
        f"| {title} | {number} | {'d435i, wheels' if noisy else 'none'} | {steps} | {over:.1f} % | {alone:.1f} % | "
        f"{turned} | {contacts} | {rate} | {left_out} | {stops} | {load} |"
    )


def explore_inside(run: Path, scene: str, *, noisy: bool, **options: Any) -> None:
    """The same in this process: its poses, too, begin at zero."""
    from anm_mj.sim.make_robot import make_robot

    begin = time.perf_counter()
    sensor, settings = (SENSOR, [WHEELS]) if noisy else ("exact", [])
    config = make_config(DEFAULT_PRESET, settings, scene=folder_of(scene), sensor=sensor, **options)
    with (
        make_parts(config) as parts,
        make_robot(load_scene(config.scene), config, knows_start=False, forgets_textures=True) as robot,
    ):
        run_with(replace(parts, robot=robot, true_view=robot.true_view), begin, out=run)


def num_turns(run: Path) -> int:
    """Turns among the actions of a run."""
    return sum("TURN" in step.action for step in read_run(run).steps)


def explore_over_ros(run: Path, simulated: Sequence[object], options: Sequence[object]) -> None:
    """The two processes, and a third one, this one, that hears the true pose."""
    from anm_mj.ros.names import ODOMETRY_TYPE, TRUTH
    from anm_mj.ros.node import Node

    heard: list[tuple[float, ...]] = []

    def hear(message: Any, _: int) -> None:
        pose = message.pose.pose
        yaw = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
        heard.append((seconds(message.header.stamp), pose.position.x, pose.position.y, yaw))

    run.parent.mkdir(parents=True, exist_ok=True)
    log = run.parent / f"{run.name}.txt"
    with Node() as node, log.open("w") as file:
        node.subscribe(TRUTH, ODOMETRY_TYPE, hear)
        before = os.getloadavg()[0]
        robot = command("simulate", *simulated, "--ros", file=file)
        time.sleep(START_S)
        explorer = command("drive", *options, "--out", run, file=file)
        explorer.wait()
        load = f"{before:.1f} to {os.getloadavg()[0]:.1f}"
        robot.terminate()
        robot.wait()
    log.write_text(f"{load}\n{log.read_text()}")
    np.save(run.parent / f"{run.name}.npy", np.array(heard))


def coverage(run: Path, inside: RunFolder) -> float:
    """The completion ratio of a run over the wire [%], by true poses."""
    heard = np.load(run.parent / f"{run.name}.npy")
    found = read_run(run)
    curve = CompletionCurve(GroundTruth.load(inside.ground_truth))
    first = found.frames[0]
    T_base_camera = np.linalg.inv(pose_matrix(first.pose)) @ first.T_world_camera
    for frame in found.frames:
        # The robot stood when it looked.
        _, x, y, yaw = heard[np.argmin(np.abs(heard[:, 0] - frame.time_s))]
        pose = Pose2(float(x), float(y), float(yaw))
        curve.frame(frame.step, found.depth_mm(frame), found.intrinsics, pose_matrix(pose) @ T_base_camera, pose)
    curve.last()
    return curve.rows[-1].completion_ratio


def command(*words: object, file: IO[str] | None = None) -> subprocess.Popen:
    """A command of the program."""
    line = [sys.executable, "-m", "anm_mj.cli", *map(str, words)]
    return subprocess.Popen(line, stdout=file or subprocess.DEVNULL, stderr=subprocess.STDOUT)


if __name__ == "__main__":
    run_script(main)
