"""Programs that run beside a test: both sides of the wire, and the peer in Rust that nobody here wrote."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

PEER = Path(__file__).parent / "peer"


@contextmanager
def running(*words: object, out: Path, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A command of the program; what it prints goes to a file."""
    with out.open("w") as file:
        command = [sys.executable, "-m", "anm_mj.cli", *map(str, words)]
        process = subprocess.Popen(
            command, stdout=file, stderr=subprocess.STDOUT, text=True, env=os.environ | environment
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


class Peer:
    """The peer, on a domain of its own."""

    def __init__(self, program: Path, domain: int) -> None:
        self._program, self.environment = program, {"ROS_DOMAIN_ID": str(domain), "ROS_LOCALHOST_ONLY": "0"}

    def begin(self, command: str, seconds: float, *words: object) -> subprocess.Popen[str]:
        """Start one of its commands."""
        line = [str(self._program), command, str(seconds), *map(str, words)]
        return subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=os.environ | self.environment)

    def __call__(self, command: str, seconds: float, *words: object) -> list[dict]:
        """What one of its commands says."""
        return self.end(self.begin(command, seconds, *words))

    def end(self, process: subprocess.Popen[str]) -> list[dict]:
        """Wait for a command; what it says."""
        said, _ = process.communicate(timeout=120.0)
        assert process.returncode == 0, said
        return [json.loads(line) for line in said.splitlines()]


def build_peer() -> Path:
    """The program; a test that needs it is skipped where it cannot be built."""
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("there is no cargo here, which builds the peer")
    target = Path(os.environ.get("CARGO_TARGET_DIR", PEER.parents[2] / "build" / "peer"))
    done = subprocess.run(
        [cargo, "build", "--release", "--quiet"],
        cwd=PEER,
        env=os.environ | {"CARGO_TARGET_DIR": str(target)},
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode != 0 and "error[" not in done.stderr:
        pytest.skip(f"the peer cannot be built here: {done.stderr[-300:]}")
    assert done.returncode == 0, done.stderr
    return target / "release" / "peer"
