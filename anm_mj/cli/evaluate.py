"""``anm-mj eval``: the metrics of a finished run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_evaluate(commands: Any) -> None:
    """Add ``eval`` to the commands of the program."""
    evaluate = commands.add_parser("eval", help="recompute the metrics of a run from its folder alone")
    evaluate.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    evaluate.add_argument(
        "--novel-views",
        action="store_true",
        help="also evaluate the map on views from places the robot never visited, and on the scene's 200 fixed views",
    )
    # Its former name.
    evaluate.add_argument(
        "--halved-intrinsics",
        action="store_true",
        help="also print completion as the paper's code back-projects, half a pixel aside",
    )
    evaluate.add_argument(
        "--scene",
        metavar="SCENE",
        help="with --novel-views: name or folder of the run's scene, if it has moved",
    )
    evaluate.set_defaults(command=_evaluate)


def _evaluate(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import progress_bar
    from anm_mj.cli.console import PlainConsole
    from anm_mj.cli.folder_line import print_folder
    from anm_mj.cli.metrics_table import print_metrics
    from anm_mj.cli.progress import ProgressLine
    from anm_mj.evaluation.run_evaluation import completion_with_halved_intrinsics, evaluate_run

    console = PlainConsole()
    novel_views, fixed_views = None, None
    if parsed.novel_views:
        from anm_mj.evaluation.fixed_views import evaluate_fixed_views
        from anm_mj.evaluation.novel_views import evaluate_novel_views

        with progress_bar(console, "novel views") as on_progress:
            novel_views = evaluate_novel_views(parsed.run, scene=parsed.scene, on_progress=on_progress)
        with progress_bar(console, "fixed views") as on_progress:
            fixed_views = evaluate_fixed_views(parsed.run, scene=parsed.scene, on_progress=on_progress)
    with ProgressLine(console) as line:
        metrics = evaluate_run(parsed.run, line.survey, novel_views, fixed_views)
    print_metrics(console, metrics)
    print_folder(console, parsed.run)
    if parsed.halved_intrinsics:
        other = completion_with_halved_intrinsics(parsed.run)
        console.print(
            f"With halved intrinsics: completion ratio {other.ratio_percent:.2f} %, completion "
            f"{other.completion_cm:.2f} cm",
            highlight=False,
        )
    return 0
