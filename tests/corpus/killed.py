"""Makes a run folder as a killed run leaves it, with two checkpoints: ``python -m tests.corpus.killed SCENE OUT``."""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

import anm_mj.run
from anm_mj.config import make_config
from anm_mj.events import On, Stepped

TINY = ("mapping.schedule.first_iterations=5", "mapping.schedule.replay_bytes=2000000", "image_px=64")
"""Settings of short runs."""
STEPS = 12


def main(scene: str, out: str) -> None:
    """Copy the folder of a run that goes on; its checkpoints come as often as they can be written."""
    settings = [*TINY, "checkpoint.every_steps=1", "checkpoint.loop_share=1"]
    config = make_config("quick", settings, scene=scene, steps=STEPS, device="cpu")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "run"

        def copy(report: Stepped) -> None:
            if report.step < STEPS // 2 or Path(out).exists():
                return
            until = time.monotonic() + 20.0
            # Another thread writes them.
            while len(list(folder.glob("checkpoint/[0-9]*"))) < 2 and time.monotonic() < until:
                time.sleep(0.02)
            try:
                shutil.copytree(folder, out, ignore=shutil.ignore_patterns(".*"))
            except shutil.Error:  # The oldest checkpoint was removed meanwhile.
                shutil.rmtree(out)

        anm_mj.run.run(config, out=folder, observers=(On(Stepped, copy),))


if __name__ == "__main__":
    main(*sys.argv[1:])
