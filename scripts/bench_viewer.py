"""What connections that say nothing, or nonsense, cost the live view, and with it the run that it shows.

    scripts/bench_viewer.py

Another process opens a thousand connections of each kind and holds them. Printed are the processor's time that the
server spends on each, the file descriptors that it holds at most, and whether its port is closed at the end.
"""

from __future__ import annotations

import multiprocessing
import os
import socket
import time
from contextlib import suppress
from typing import Any

import tyro

from anm_mj.viz.page_server import PageServer

KINDS = {
    "silent": b"",
    "half a request": b"GET / HTTP/1.1\r\nHost: 127.0.0.1",
    "malformed": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 50,
    "head of 100 kB": b"GET /" + b"a" * 100_000,
    "body of 1 TB": b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000000000\r\n\r\n",
}


def main(connections: int = 1000) -> None:
    """Measure and print, with so many connections of each kind."""
    server, spawn = PageServer(), multiprocessing.get_context("spawn")
    for name, words in KINDS.items():
        files, most, begin = _num_files(), 0, time.process_time()
        process = spawn.Process(target=_open, args=(server.port, words, connections))
        process.start()
        while process.is_alive():
            most = max(most, _num_files() - files)
            time.sleep(0.05)
        spent_ms = 1e3 * (time.process_time() - begin) / connections
        print(f"{name:16s} {spent_ms:6.2f} ms each, {most} file descriptors at most")
    server.close()
    with socket.socket() as client:
        print("port closed" if client.connect_ex(("127.0.0.1", server.port)) else "port still open")


def _num_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def _open(port: int, words: bytes, count: int) -> None:
    """Open connections, say something on each, and hold them to the end."""
    held: list[Any] = []
    for _ in range(count):
        client = socket.socket()
        client.setblocking(False)
        client.connect_ex(("127.0.0.1", port))
        held.append(client)
        time.sleep(0.002)
        with suppress(OSError):
            client.send(words)
    time.sleep(0.5)
    for client in held:
        client.close()


if __name__ == "__main__":
    tyro.cli(main)
