"""What connections that say nothing, or nonsense, cost the live view, and with it the run that it shows.

    python scripts/bench_viewer.py
    python scripts/bench_viewer.py --scene home --steps 500

Another process opens a thousand connections of each kind and holds them. Printed are the processor's time that the
server spends on each, the file descriptors that it holds at most, and whether its port is closed at the end.

With ``--scene``, runs of ``anm-mj explore --view`` are compared, in turns without connections and with a thousand of
all kinds within some seconds of the loop: steps a second, and how much the flood takes off them.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.api import explore_scene
from anm_mj.cli.command_line import run_script
from anm_mj.viz.live_view import LiveView
from anm_mj.viz.page_server import PageServer

FLOOD = """
import socket, sys, time
port, count, words = int(sys.argv[1]), int(sys.argv[2]), [bytes.fromhex(each) for each in sys.argv[3:]]
held = []
for number in range(count):
    client = socket.socket()
    client.setblocking(False)
    client.connect_ex(("127.0.0.1", port))
    held.append(client)
    time.sleep(0.002)
    try:
        client.send(words[number % len(words)])
    except OSError:
        pass
time.sleep(0.5)
"""
"""Opens connections, says something on each, and holds them to the end; a program that takes next to no time itself."""
KINDS = {
    "silent": b"",
    "half a request": b"GET / HTTP/1.1\r\nHost: 127.0.0.1",
    "malformed": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 50,
    "head of 20 kB": b"GET /" + b"a" * 20_000,
    "body of 1 TB": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000000000\r\n\r\n",
}


def main(connections: int = 1000, scene: str = "", steps: int = 500, pairs: int = 3) -> None:
    """Measure and print.

    Args:
        connections: of each kind; in a run, of all kinds together.
        scene: the scene of the runs; none = the server alone.
        steps: of a run.
        pairs: runs without and with connections.
    """
    if scene:
        _compare_runs(connections, scene, steps, pairs)
    else:
        _measure_server(connections)


def _compare_runs(connections: int, scene: str, steps: int, pairs: int) -> None:
    loss = []
    for number in range(pairs):
        # The order changes: what comes second has a warmer machine.
        rates = {flood: _rate(connections * flood, scene, steps) for flood in ((0, 1), (1, 0))[number % 2]}
        loss.append(100.0 * (1.0 - rates[1] / rates[0]))
        print(f"without {rates[0]:5.1f} Hz, with {rates[1]:5.1f} Hz: {loss[-1]:+.1f} % slower", flush=True)
    error = np.std(loss, ddof=1) / np.sqrt(pairs) if pairs > 1 else float("nan")
    print(f"mean {np.mean(loss):+.1f} +- {error:.1f} %")


def _rate(connections: int, scene: str, steps: int) -> float:
    """Steps a second of a run with so many connections."""
    viewer = LiveView()
    port = int(viewer.url.split(":")[2].split("/")[0])
    process: subprocess.Popen[bytes] | None = None

    def begin(report: Any) -> None:
        nonlocal process
        # The first frame trains longer; the flood shall meet the loop as it goes on.
        if connections and process is None and report.step >= 10:
            process = _flood(port, tuple(KINDS.values()), connections)

    try:
        with tempfile.TemporaryDirectory() as folder:
            run = explore_scene(scene, steps=steps, out=Path(folder) / "run", on_step=begin, observers=(viewer,))
            return run.metrics["hz"]
    finally:
        viewer.close()
        if process is not None:
            process.wait()


def _measure_server(connections: int) -> None:
    server = PageServer()
    for name, words in KINDS.items():
        files, most, begin = _num_files(), 0, time.process_time()
        process = _flood(server.port, (words,), connections)
        while process.poll() is None:
            most = max(most, _num_files() - files)
            time.sleep(0.05)
        spent_ms = 1e3 * (time.process_time() - begin) / connections
        print(f"{name:16s} {spent_ms:6.2f} ms each, {most} file descriptors at most")
    server.close()
    with socket.socket() as client:
        print("port closed" if client.connect_ex(("127.0.0.1", server.port)) else "port still open")


def _flood(port: int, words: tuple[bytes, ...], count: int) -> subprocess.Popen[bytes]:
    said = [each.hex() for each in words]
    return subprocess.Popen([sys.executable, "-I", "-S", "-c", FLOOD, str(port), str(count), *said])


def _num_files() -> int:
    return len(os.listdir("/proc/self/fd"))


if __name__ == "__main__":
    run_script(main)
