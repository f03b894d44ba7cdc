"""Runs command lines in processes of their own, each with a limit of time, and reports what they did.

A process is forked from one that has imported the package already, so that a case costs milliseconds.
"""

from __future__ import annotations

import faulthandler
import hashlib
import os
import resource
import signal
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

SECONDS = 20
"""What a command may take of the processor with bad input [s]."""
WAITING_S = 90.0
"""Wall time after which it waits for ever; on a busy machine the processor's time takes several times as long [s]."""
MEMORY_MIB = 2048.0
"""What it may hold [MiB]."""
_HARD_LIMIT_BYTES = 12 << 30
"""The system refuses more before the machine suffers."""


@dataclass(frozen=True)
class Outcome:
    """What a command line did."""

    status: int
    """Exit status; minus the signal that ended it."""
    stderr: str
    peak_mib: float
    timed_out: bool

    def fault(self) -> str:
        """What is wrong with it, or nothing: one sentence and status 2, or success, within the limits."""
        last = self.stderr.strip().split("\n")[-1][:200]
        if self.timed_out:
            return f"not done after {WAITING_S:g} s, most of which it waited"
        if self.status == -signal.SIGXCPU:
            return f"not done after {SECONDS} s"
        if "Traceback" in self.stderr or "unforeseen" in self.stderr:
            return f"traceback: {last}"
        if self.status not in (0, 1, 2):
            return f"exit status {self.status}: {last}"
        if self.status == 2 and "anm-mj" not in self.stderr:
            return f"no sentence: {last!r}"
        if self.peak_mib > MEMORY_MIB:
            return f"{self.peak_mib:.0f} MiB"
        return ""


def run_case(argv: list[str], folder: Path, seconds: float = WAITING_S) -> Outcome:
    """Run ``anm-mj`` with these words in a folder, in a forked process."""
    errors = folder / "stderr.txt"
    began = time.monotonic()
    pid = os.fork()
    if not pid:
        _child(argv, folder, errors)
    timed_out = False
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if time.monotonic() - began > seconds:
            timed_out = True
            os.kill(pid, signal.SIGKILL)
            _, status, usage = os.wait4(pid, 0)
            break
        time.sleep(0.005)
    text = errors.read_text(errors="replace") if errors.is_file() else ""
    errors.unlink(missing_ok=True)
    return Outcome(os.waitstatus_to_exitcode(status), text, usage.ru_maxrss / 1024.0, timed_out)


def content_of(folder: Path) -> dict[str, str]:
    """What a folder holds: hashes of files, targets of links; FIFOs are not opened."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            found[str(path)] = "-> " + os.readlink(path)
        elif path.is_file():
            found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def _child(argv: list[str], folder: Path, errors: Path) -> None:
    status = 70
    try:
        os.chdir(folder)
        with errors.open("wb") as file:
            os.dup2(file.fileno(), 2)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 0)
        os.dup2(null, 1)
        sys.stdout, sys.stderr = (os.fdopen(os.dup(number), "w") for number in (1, 2))
        faulthandler.enable(sys.stderr)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_DATA, (_HARD_LIMIT_BYTES, _HARD_LIMIT_BYTES))
        from anm_mj.cli.main import main

        status = main(argv)
    except SystemExit as err:
        status = err.code if isinstance(err.code, int) else 1
    except BaseException:
        traceback.print_exc()
        status = 1
    finally:
        sys.stderr.flush()
        os._exit(status)
