"""How many threads numerical work gets."""

from __future__ import annotations

import os


def usual_num_threads() -> int:
    """As ``OMP_NUM_THREADS`` says, like OpenMP and torch; without it, one per core that the process may use."""
    try:
        asked = int(os.environ.get("OMP_NUM_THREADS", "").partition(",")[0])
    except ValueError:
        asked = 0
    if asked > 0:
        return asked
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Not on macOS.
        return os.cpu_count() or 1
