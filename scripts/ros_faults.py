"""How long a robot over ROS 2 drives on after something fails between the two processes.

    python scripts/ros_faults.py
    python scripts/ros_faults.py --trials 5 --scene room

``anm-mj simulate`` and ``anm-mj drive`` run as two processes on this machine alone. All messages between them pass
through this one, which spoils them once the explorer has begun an action. Prints a Markdown table: from the fault to
the last velocity that is not zero, at the median and at most, from the fault until the robot stands, and what the
explorer says. An explorer that was killed sends nothing more: there the robot's own timeout counts.
"""

from __future__ import annotations

import copy
import itertools
import math
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.cli.command_line import run_script
from anm_mj.io.ros_messages import seconds
from anm_mj.ros import names
from anm_mj.ros.node import LATCHED, STATE, Delivery, Node

ROBOT, EXPLORER = "robot", "wire"
"""Namespaces of the two sides of this program."""
QUIET_S, WATCH_S, BACK_S, REST_S = 0.25, 1.4, 1.5, 0.3
"""An action begins after so long at rest; a fault lasts so long; all is back so long before the next one; a rest lasts
at least so long [s]."""
DOMAIN = 78
IMAGES = (names.COLOUR, names.DEPTH)
TOPICS = {
    names.COLOUR: names.IMAGE,
    names.DEPTH: names.IMAGE,
    names.DEPTH_INFO: names.CAMERA_INFO,
    names.ODOMETRY: names.ODOMETRY_TYPE,
    names.TF: names.TF_TYPE,
    names.TF_STATIC: names.TF_TYPE,
}
Spoil = Callable[[str, Any], Any]
"""Gives the message of a topic that goes on instead; None = none."""


def without(*topics: str) -> Spoil:
    """Some topics fall silent."""
    return lambda topic, message: None if topic in topics else message


def with_stamps(moved_s: Callable[[float], float], *topics: str) -> Spoil:
    """Other stamps, on some topics."""

    def spoil(topic: str, message: Any) -> Any:
        if topic not in topics:
            return message
        message = copy.deepcopy(message)
        for header in [message.header] if hasattr(message, "header") else [one.header for one in message.transforms]:
            sec, nanosec = divmod(round(moved_s(seconds(header.stamp)) * 1e9), 10**9)
            header.stamp.sec, header.stamp.nanosec = sec, nanosec
        return message

    return spoil


class Repeated:
    """A topic says its last message again and again."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self.last: Any = None

    def __call__(self, topic: str, message: Any) -> Any:
        """See ``Spoil``."""
        if topic != self._topic:
            return message
        self.last = self.last or message
        return self.last


def other_encoding(topic: str, message: Any) -> Any:
    """Depth comes as colour."""
    if topic != names.DEPTH:
        return message
    message = copy.copy(message)
    message.encoding, message.step = "rgb8", 3 * message.width
    message.data = np.zeros(message.step * message.height, np.uint8)
    return message


def half_size(topic: str, message: Any) -> Any:
    """Depth has a quarter of its pixels."""
    if topic != names.DEPTH:
        return message
    depth = message.data.view("<f4").reshape(message.height, message.width)[::2, ::2]
    message = copy.copy(message)
    message.height, message.width = depth.shape
    message.step, message.data = 4 * message.width, np.ascontiguousarray(depth).view(np.uint8).ravel()
    return message


def other_camera(topic: str, message: Any) -> Any:
    """The calibration is of other pixels."""
    if topic != names.DEPTH_INFO:
        return message
    message = copy.copy(message)
    message.width, message.height = 2 * message.width, 2 * message.height
    return message


def obstacle(topic: str, message: Any) -> Any:
    """Something appears right before the robot."""
    if topic != names.DEPTH:
        return message
    depth = message.data.view("<f4").reshape(message.height, message.width).copy()
    rows, cols = depth.shape
    middle = depth[rows // 3 : 2 * rows // 3, cols // 3 : 2 * cols // 3]
    np.minimum(middle, 0.15, out=middle)
    message = copy.copy(message)
    message.data = depth.view(np.uint8).ravel()
    return message


ALL = (*IMAGES, names.ODOMETRY, names.TF)
FAULTS: dict[str, Spoil | None] = {
    "no image": without(*IMAGES),
    "colour without depth": without(names.DEPTH),
    "depth without colour": without(names.COLOUR),
    "no pose": without(names.ODOMETRY),
    "the clock jumps ahead by 30 s": with_stamps(lambda time_s: time_s + 30.0, *ALL),
    "the clock jumps back by 2 s": with_stamps(lambda time_s: time_s - 2.0, *ALL),
    "the last pose again and again": Repeated(names.ODOMETRY),
    "the last frames again and again": Repeated(names.TF),
    "no frames": without(names.TF),
    "stamps of colour and depth differ by 5 s": with_stamps(lambda time_s: time_s - 5.0, names.COLOUR),
    "depth in another encoding": other_encoding,
    "depth of another size": half_size,
    "a calibration of other pixels": other_camera,
    "two programs publish one transform": lambda _, message: message,
    "an obstacle in raw depth": obstacle,
    "the explorer is killed (kill -9)": None,
}
TWICE, BLOCKED = "two programs publish one transform", "an obstacle in raw depth"
BY_FRAMES = ("the last frames again and again", "no frames")
"""These are faults of ``--topic odometry=tf``."""


class Wire:
    """Hands on what both sides say, and spoils it."""

    def __init__(self, node: Node, second: Node) -> None:
        self.spoil: Spoil = lambda _, message: message
        self.twice = False
        self.commands: list[tuple[float, tuple[float, float]]] = []
        """When which speeds were commanded: turn, forward."""
        self.speeds: list[tuple[float, tuple[float, float]]] = []
        """When the robot had which true speeds."""
        self._second = second.publisher(f"/{EXPLORER}/{names.TF}", names.TF_TYPE, STATE)
        for topic, kind in TOPICS.items():
            delivery = LATCHED if topic == names.TF_STATIC else Delivery(reliable=True, depth=5)
            to = node.publisher(f"/{EXPLORER}/{topic}", kind, delivery)
            asked = LATCHED if topic == names.TF_STATIC else STATE
            node.subscribe(f"/{ROBOT}/{topic}", kind, self._from_robot(topic, to), asked)
        back = node.publisher(f"/{ROBOT}/{names.COMMAND}", names.TWIST)
        node.subscribe(f"/{EXPLORER}/{names.COMMAND}", names.TWIST, self._from_explorer(back), STATE)
        node.subscribe(f"/{ROBOT}/{names.TRUTH}", names.ODOMETRY_TYPE, self._truth, STATE)

    def _from_robot(self, topic: str, to: Any) -> Callable[[Any, int], None]:
        def heard(message: Any, _: int) -> None:
            message = self.spoil(topic, message)
            if message is not None:
                to.publish(message)
            if self.twice and topic == names.TF:
                self._second.publish(message)

        return heard

    def _from_explorer(self, back: Any) -> Callable[[Any, int], None]:
        def heard(message: Any, _: int) -> None:
            self.commands.append((time.monotonic(), _twist(message)))
            back.publish(message)

        return heard

    def _truth(self, message: Any, _: int) -> None:
        self.speeds.append((time.monotonic(), _twist(message.twist.twist)))

    def wait_for_action(self, *, forward: bool) -> None:
        """Until the robot has stood for a while and is driven again."""
        end = time.monotonic() + 120.0
        while time.monotonic() < end:
            recent = [twist for at, twist in self.commands if time.monotonic() - at < QUIET_S]
            begun = len(recent) > 2 and (recent[-1][1] if forward else max(recent[-1])) > 0.0
            if begun and not any(map(any, recent[:-2])):
                return
            time.sleep(0.002)
        raise SystemExit("The explorer begins no action.")


def _twist(twist: Any) -> tuple[float, float]:
    return abs(twist.angular.z), abs(twist.linear.x)


def main(scene: str = "room", trials: int = 5, faults: str = "") -> None:
    """Inject each fault some times.

    Args:
        scene: name or folder.
        trials: of each fault.
        faults: those that contain one of these texts, separated by commas; all by default.
    """
    os.environ |= {"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": str(DOMAIN)}
    chosen = [name for name in FAULTS if any(text in name for text in faults.split(","))]
    print("| fault | velocity zero after | at most | stands after, at most | what it says |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, Node() as node, Node() as second:
        wire = Wire(node, second)
        with command(Path(folder) / "robot.txt", "simulate", scene, "--ros", "--namespace", ROBOT):
            for name in chosen:
                print(row(wire, Path(folder), name, trials), flush=True)
    print(f"\nLoad of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.")


def row(wire: Wire, folder: Path, name: str, trials: int) -> str:
    """Inject a fault some times."""
    zero_s, stands_s, said = [], [], ""
    is_kill = FAULTS[name] is None
    log, number = folder / "explorer.txt", 0
    while len(stands_s) < trials:
        number += 1
        source = ("--topic", "odometry=tf") if name in BY_FRAMES else ()
        words = (
            "--namespace",
            EXPLORER,
            *source,
            "--pose",
            "odometry",
            "--preset",
            "quick",
            "--out",
            folder / f"{name}{number}",
        )
        with command(log, "drive", *words) as explorer:
            while len(stands_s) < trials:
                before = len(log.read_text())
                zero, stands = inject(wire, name, explorer)
                said = _said(log.read_text()[before:]) or said
                zero_s.append(zero)
                stands_s.append(stands)
                if is_kill:
                    break
                time.sleep(BACK_S)
    at = "-" if is_kill else f"{statistics.median(zero_s):.2f} s | {max(zero_s):.2f} s"
    return f"| {name} | {at if not is_kill else '- | -'} | {max(stands_s):.2f} s | {said} |"


def inject(wire: Wire, name: str, explorer: subprocess.Popen) -> tuple[float, float]:
    """Begin a fault in an action; after which time the velocity is zero and the robot stands [s]."""
    wire.wait_for_action(forward=name == BLOCKED)
    begin, spoil = time.monotonic(), FAULTS[name]
    if spoil is None:
        explorer.send_signal(signal.SIGKILL)
    else:
        if isinstance(spoil, Repeated):
            spoil.last = None
        wire.spoil, wire.twice = spoil, name == TWICE
    time.sleep(WATCH_S)
    wire.spoil, wire.twice = (lambda _, message: message), False
    # What is in the way keeps nobody from turning.
    ways = 1 if name == BLOCKED else 0
    return at_rest(wire.commands, begin, ways), at_rest(wire.speeds, begin, ways)


def at_rest(speeds: list[tuple[float, tuple[float, float]]], begin: float, ways: int) -> float:
    """When the last motion was that rest followed [s]; infinite without a rest."""
    seen = [(at - begin, max(twist[ways:])) for at, twist in list(speeds) if begin < at < begin + WATCH_S]
    moving = [0.0, *(at for at, speed in seen if speed > 1e-3), math.inf]
    return next(at for at, after in itertools.pairwise(moving) if after - at > REST_S)


def _said(text: str) -> str:
    found = re.search(r"The robot stops: (.*?)\.\s*$", text, re.MULTILINE)
    return f"`{found[1]}`" if found else ""


@contextmanager
def command(log: Path, *words: object):
    """A command of the program, ended by Ctrl-C."""
    with log.open("w") as file:
        line = [sys.executable, "-m", "anm_mj.cli", *map(str, words)]
        process = subprocess.Popen(line, stdout=file, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
        process.wait()


if __name__ == "__main__":
    run_script(main)
