"""How much a thousand connections that say nothing, or nonsense, slow a watched run down.

    scripts/bench_viewer.py [--steps 100] [--rounds 3]

Runs without and with them take turns, in pairs, each with a live view. Another process opens them while the run goes
on, a hundred a second, and holds them. Printed are the processor's time of the run per step, and by how much it grows.
"""

from __future__ import annotations

import multiprocessing
import resource
import socket
import statistics
import tempfile
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import tyro

CONNECTIONS = 1000
WORDS = (
    b"",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 50,
    b"GET /" + b"a" * 100_000,
    b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000000000\r\n\r\n",
)


def main(steps: int = 100, rounds: int = 3, scene: str = "home") -> None:
    """Measure and print.

    Args:
        steps: of each run.
        rounds: pairs of runs.
        scene: where.
    """
    spent: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(rounds):
        for flooded in (False, True):
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
                seconds, ended = process.submit(_run, scene, steps, flooded).result()
            spent[flooded].append(seconds / steps)
            print(f"{'with' if flooded else 'without':8s} {1e3 * seconds / steps:7.1f} ms a step, ended with {ended}")
    slower = statistics.median(b / a for a, b in zip(spent[False], spent[True], strict=True)) - 1.0
    print(f"{CONNECTIONS} connections: {100.0 * slower:+.1f} % (median of {rounds} pairs)")


def _run(scene: str, steps: int, flooded: bool) -> tuple[float, str]:
    """Processor's time of the loop of a run [s], and why it ended."""
    from anm_mj.config import make_config
    from anm_mj.run import run
    from anm_mj.viz.meshcat_viewer import MeshcatViewer

    viewer = MeshcatViewer(port=0)
    port = viewer._server.port
    stop = multiprocessing.get_context("spawn").Event()
    flood = multiprocessing.get_context("spawn").Process(target=_flood, args=(port, stop), daemon=True)
    if flooded:
        flood.start()
    marks: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        config = make_config("default", [], scene=scene, steps=steps, seed=1, device="cpu")
        _, metrics = run(
            config,
            out=Path(folder) / "run",
            viewer=viewer,
            on_step=lambda *_: marks.append(_processor_s()),
            on_end=lambda _: marks.append(_processor_s()),
        )
    viewer.close()
    if flooded:
        stop.set()
        flood.join()
    _require_free(port)
    return marks[-1] - marks[0], str(metrics.stop_reason)


def _processor_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _flood(port: int, stop: Any) -> None:
    """Open connections, and hold them to the end."""
    held: list[socket.socket] = []
    for number in range(CONNECTIONS):
        client = socket.socket()
        client.setblocking(False)
        client.connect_ex(("127.0.0.1", port))
        held.append(client)
        if stop.wait(0.01):
            break
        with suppress(OSError):
            client.send(WORDS[number % len(WORDS)])
    stop.wait()
    for client in held:
        client.close()


def _require_free(port: int) -> None:
    with socket.socket() as client:
        if client.connect_ex(("127.0.0.1", port)) == 0:
            raise SystemExit(f"port {port} is still open after the end of the run")


if __name__ == "__main__":
    tyro.cli(main)
