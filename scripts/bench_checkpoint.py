"""Measure what checkpoints cost a run: the figures of docs/reliability.md.

    scripts/bench_checkpoint.py [--scene home] [--steps 300] [--repeats 2]

The same run with and without checkpoints, in turns, each in a process of its own: processor's time of the whole
process, wall time of the loop, and the time that was spent on them.
"""

from __future__ import annotations

import json
import multiprocessing
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

import anm_mj.run
from anm_mj.checkpoint.store import Checkpointer
from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config


def main(scene: str = "home", steps: int = 300, repeats: int = 2, seed: int = 0, preset: str = "default") -> None:
    """Run and print one line per run, and the shares.

    Args:
        scene: where.
        steps: of each run.
        repeats: runs with checkpoints, and as many without.
        seed: of the runs.
        preset: of the map.
    """
    found: dict[bool, list[dict[str, Any]]] = {True: [], False: []}
    context = multiprocessing.get_context("spawn")
    for _ in range(repeats):
        for with_them in (False, True):
            with context.Pool(1) as pool:
                one = pool.apply(_measured, (scene, steps, seed, preset, with_them))
            found[with_them].append(one)
            sys.stdout.write(json.dumps({"checkpoints": with_them, **one}) + "\n")
            sys.stdout.flush()
    for key in ("cpu_s", "loop_s"):
        best = {with_them: min(one[key] for one in runs) for with_them, runs in found.items()}
        sys.stdout.write(f"{key}: {100.0 * (best[True] / best[False] - 1.0):.1f} % more with checkpoints\n")


def _measured(scene: str, steps: int, seed: int, preset: str, with_them: bool) -> dict[str, Any]:
    """One run."""
    settings = [] if with_them else ["checkpoint.every_steps=0"]
    config = make_config(preset, settings, scene=scene, steps=steps, seed=seed, device="cpu")
    taken: dict[str, Any] = {"taken": 0, "spent_s": 0.0}
    take, finish = Checkpointer._take, Checkpointer.finish

    def counting(self: Checkpointer, step: int) -> None:
        taken["taken"] += 1
        take(self, step)

    def ending(self: Checkpointer, step: int, *, resumable: bool) -> None:
        finish(self, step, resumable=resumable)
        taken["spent_s"], taken["mb"] = round(self.spent_s, 3), round(self.num_bytes / 1e6, 1)

    Checkpointer._take, Checkpointer.finish = counting, ending
    with tempfile.TemporaryDirectory() as folder:
        _, metrics = anm_mj.run.run(config, out=Path(folder) / "run")
    used = resource.getrusage(resource.RUSAGE_SELF)
    loop_s = metrics.steps / metrics.hz if metrics.hz else 0.0
    return {
        "cpu_s": round(used.ru_utime + used.ru_stime, 2),
        "loop_s": round(loop_s, 2),
        **taken,
        "share_of_loop": round(taken["spent_s"] / loop_s, 4) if loop_s else None,
    }


if __name__ == "__main__":
    run_script(main)
