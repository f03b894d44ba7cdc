"""``anm-mj eval``: the numbers of a finished run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console


def add_evaluate(commands: Any) -> None:
    """Add ``eval`` to the commands of the program."""
    evaluate = commands.add_parser("eval", help="compute the numbers of a run anew from its folder alone")
    evaluate.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    evaluate.add_argument(
        "--heldout", action="store_true", help="also compare the map with views from where the robot never stood"
    )
    evaluate.add_argument(
        "--scene", metavar="SCENE", help="with --heldout: the run's scene, where it lies now if it has moved"
    )
    evaluate.set_defaults(command=_evaluate)


def _evaluate(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.progress import ProgressLine, print_metrics
    from anm_mj.evaluation.evaluate import evaluate_run

    console = Console()
    heldout = None
    if parsed.heldout:
        from anm_mj.evaluation.novel_views import measure_held_out

        heldout = measure_held_out(parsed.run, scene=parsed.scene)
    with ProgressLine(console) as line:
        metrics = evaluate_run(parsed.run, line.surveying, heldout)
    print_metrics(console, metrics, parsed.run)
    return 0
