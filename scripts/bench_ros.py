"""What images over ROS 2 cost, and how long it takes from an image to a decision.

    python scripts/bench_ros.py
    python scripts/bench_ros.py --during 30 --steps 60

First, one process publishes colour (rgb8) and depth (16UC1), 640 x 480, 30 times a second, and another one hears
them: the share that was lost, the time from a message's making to its hearing, and the CPU time of both, which do
nothing else. Then ``anm-mj simulate`` and ``anm-mj drive`` explore: from the arrival of the image that a decision rests
on to the first velocity that comes of it. All on this machine alone, whose load is printed.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.cli.command_line import run_script
from anm_mj.io.read_run import read_run
from anm_mj.io.ros_messages import seconds
from anm_mj.ros import names
from anm_mj.ros.node import SENSOR, STATE, Delivery, Node

HZ, SIZE = 30.0, (480, 640)
DOMAIN = 79
START_S, AFTER_S = 3.0, 1.0


def main(during: float = 20.0, steps: int = 40) -> None:
    """Measure.

    Args:
        during: of the images [s].
        steps: of the exploration.
    """
    os.environ |= {"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": str(DOMAIN)}
    print(f"Load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.\n")
    columns = ("subscriber", "lost", "latency, median", "95 %", "CPU of the publisher", "of the subscriber")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for name, delivery in (("best effort", SENSOR), ("reliable", STATE)):
        print(f"| {name} | {transport(during, delivery)} |", flush=True)
    print("\n| preset | image to velocity, median | 95 % | images |\n|---|---|---|---|")
    for preset in ("quick", "default"):
        print(f"| {preset} | {decisions(preset, steps)} |", flush=True)


def transport(during_s: float, delivery: Delivery) -> str:
    """Publish in another process, and hear here."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=publish, args=(theirs, during_s))
    delays_s: list[float] = []
    with Node() as node:

        def heard(message: Any, _: int) -> None:
            delays_s.append(time.time() - seconds(message.header.stamp))

        for topic in (names.COLOUR, names.DEPTH):
            node.subscribe(topic, names.IMAGE, heard, delivery)
        process.start()
        ours.recv()
        before_s, begin = _cpu_s(), time.monotonic()
        sent, theirs_s = ours.recv()
        time.sleep(AFTER_S)
        ours_share = (_cpu_s() - before_s) / (time.monotonic() - begin)
    process.join()
    median_ms, most_ms = 1e3 * np.percentile(delays_s, [50, 95])
    lost = f"{100.0 * (1.0 - len(delays_s) / sent):.1f} % of {sent}"
    cpu = f"{100.0 * theirs_s / during_s:.0f} % | {100.0 * ours_share:.0f} %"
    return f"{lost} | {median_ms:.1f} ms | {most_ms:.1f} ms | {cpu}"


def publish(to: Any, during_s: float) -> None:
    """Send images; tells how many, and the CPU time [s]."""
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 255, (*SIZE, 3), np.uint8)
    depth = rng.integers(500, 5000, SIZE, np.uint16)
    with Node() as node:
        topics = ((names.COLOUR, colour), (names.DEPTH, depth))
        publishers = [(node.publisher(topic, names.IMAGE, Delivery(True, depth=5)), image) for topic, image in topics]
        while not all(publisher.num_subscribers for publisher, _ in publishers):
            time.sleep(0.05)
        time.sleep(START_S)
        to.send(None)
        before_s, begin, sent = _cpu_s(), time.monotonic(), 0
        while time.monotonic() - begin < during_s:
            for publisher, image in publishers:
                publisher.publish(node.messages.image(time.time(), names.CAMERA, image))
                sent += 1
            time.sleep(max(begin + sent / 2 / HZ - time.monotonic(), 0.0))
        to.send((sent, _cpu_s() - before_s))
        time.sleep(AFTER_S)


def decisions(preset: str, steps: int) -> str:
    """Explore a room over the wire, and listen in."""
    arrived: dict[float, float] = {}
    commands: list[tuple[float, bool]] = []
    with tempfile.TemporaryDirectory() as folder, Node() as node:
        node.subscribe(
            names.DEPTH,
            names.IMAGE,
            lambda message, _: arrived.setdefault(round(seconds(message.header.stamp), 3), time.monotonic()),
        )
        node.subscribe(
            names.COMMAND,
            names.TWIST,
            lambda message, _: commands.append((time.monotonic(), bool(message.linear.x or message.angular.z))),
            STATE,
        )
        robot = command("simulate", "room", "--ros")
        words = ("--pose", "odometry", "--preset", preset, "--steps", steps, "--out", Path(folder) / "run")
        command("drive", *words).wait()
        robot.terminate()
        robot.wait()
        taken = [arrived.get(round(frame.time_s, 3)) for frame in read_run(Path(folder) / "run").frames]
    begun = [at for (at, moves), (_, moved) in zip(commands[1:], commands, strict=False) if moves and not moved]
    found = [min((at - seen for at in begun if at > seen), default=None) for seen in taken if seen is not None]
    # The first image waits for the set-up, and nothing follows the last one.
    waits = [wait for wait in found[1:-1] if wait is not None]
    median_ms, most_ms = 1e3 * np.percentile(waits, [50, 95])
    return f"{median_ms:.0f} ms | {most_ms:.0f} ms | {len(waits)}"


def _cpu_s() -> float:
    used = os.times()
    return used.user + used.system


def command(*words: object) -> subprocess.Popen:
    """A command of the program."""
    line = [sys.executable, "-m", "anm_mj.cli", *map(str, words)]
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    run_script(main)
