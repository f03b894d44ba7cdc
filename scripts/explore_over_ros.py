"""Whole explorations over ROS 2, each beside the same one within a single process.

    python scripts/explore_over_ros.py /tmp/over_ros
    python scripts/explore_over_ros.py /tmp/over_ros --scenes home,/tmp/imported --steps 300 --seeds 0,1 --noisy

Starts ``anm-mj simulate`` and ``anm-mj drive`` as two processes on this machine alone, and records the true pose, which
the explorer never hears. Coverage counts the depth points of both runs from true poses. Prints a Markdown table:
completion ratio over the wire and in one process after the same number of actions, contacts, real-time factor, images
that were left out, how often the robot had to stop because something was missing, and the load of the machine.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
import tyro

from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.frames import pose_matrix
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.read_run import read_json, read_run
from anm_mj.io.ros_messages import seconds
from anm_mj.io.run_folder import RunFolder
from anm_mj.types import Pose2

NOISY = ("--sensor", "d435i", "--set", "model.wheel_noise=0.02")
COLUMNS = "scene, seed, errors, steps, over ROS 2, in one process, contacts, real-time factor, left out, stops, load"
START_S = 10.0
DOMAIN = 77


def main(
    out: Annotated[Path, tyro.conf.Positional],
    scenes: str = "home",
    steps: int = 250,
    seeds: str = "0",
    noisy: bool = False,
) -> None:
    """Explore each scene with each seed, twice; runs that the folder holds already are taken as they are.

    Args:
        out: folder of the runs.
        scenes: names or folders, separated by commas.
        steps: actions of a run.
        seeds: separated by commas; a seed decides the training and the policy.
        noisy: a RealSense's depth errors, wheels that slip, and localisation.
    """
    os.environ |= {"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": str(DOMAIN)}
    columns = COLUMNS.split(", ")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|", flush=True)
    for scene in scenes.split(","):
        for seed in seeds.split(","):
            print(pair(out, scene, steps, int(seed), noisy=noisy), flush=True)


def pair(out: Path, scene: str, steps: int, seed: int, *, noisy: bool) -> str:
    """A row of the table."""
    name = f"{Path(scene).name}_{steps}_{seed}{'_noisy' if noisy else ''}"
    inside, wire = out / f"{name}_inside", out / f"{name}_wire"
    errors = NOISY if noisy else ()
    # Errors of the wheels without a correction are no matter of the wire.
    believed = ("--pose", "slam" if noisy else "odometry", "--steps", steps, "--seed", seed)
    if not RunFolder(inside).metrics.is_file():
        command("explore", scene, *believed, *errors, "--out", inside).wait()
    if not RunFolder(wire).metrics.is_file():
        explore_over_ros(wire, scene, believed, errors, seed)
    facts = (out / f"{wire.name}.txt").read_text()
    ((rate, contacts, left_out),) = re.findall(r"factor ([\d.]+)\), (\d+) contacts, .*, (\d+) left out", facts)
    stops, load = facts.count("The robot stops"), facts.splitlines()[0]
    over, alone = coverage(wire, inside), read_json(RunFolder(inside).metrics)["completion_ratio"]
    kind = "d435i, wheels" if noisy else "none"
    title = Path(scene).name
    return (
        f"| {title} | {seed} | {kind} | {steps} | {over:.1f} % | {alone:.1f} % | {contacts} | {rate} | {left_out} | "
        f"{stops} | {load} |"
    )


def explore_over_ros(run: Path, scene: str, believed: tuple, errors: tuple, seed: int) -> None:
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
        robot = command("simulate", scene, "--ros", *errors, "--seed", seed, file=file)
        time.sleep(START_S)
        explorer = command("drive", *believed, "--out", run, file=file)
        explorer.wait()
        load = f"{before:.1f} to {os.getloadavg()[0]:.1f}"
        robot.terminate()
        robot.wait()
    log.write_text(f"{load}\n{log.read_text()}")
    np.save(run.parent / f"{run.name}.npy", np.array(heard))


def coverage(run: Path, inside: Path) -> float:
    """The completion ratio of a run over the wire [%], by true poses."""
    heard = np.load(run.parent / f"{run.name}.npy")
    found = read_run(run)
    curve = CompletionCurve(GroundTruth.load(RunFolder(inside).ground_truth))
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
    tyro.cli(main)
