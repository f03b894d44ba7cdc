"""Evaluates a finished run's map on novel views.

    python scripts/novel_views.py runs/latest --views 20

Prints the mean metrics and writes ``novel_views.json`` and ``novel_views.png`` into the run folder; see
:mod:`anm_mj.evaluation.novel_views`. ``anm-mj eval RUN --novel-views`` also puts the means into ``metrics.json``.
"""

from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.errors import RunFolderError
from anm_mj.evaluation.novel_views import FAR_M, evaluate_novel_views


def main(run: Annotated[Path, tyro.conf.Positional], views: int = 20, seed: int = 0, scene: str | None = None) -> None:
    """Evaluate a run's map on novel views.

    Args:
        run: Folder of a finished run.
        views: Number of views; fewer if the scene has not as many.
        seed: Seed of places and directions.
        scene: Present name or folder of the run's scene, if it has moved.
    """
    found = evaluate_novel_views(run, views, seed, scene)
    if found.mean is None:
        raise RunFolderError(f"{run} leaves no clear place farther than {FAR_M} m from its path that sees the map.")
    means = ", ".join(f"{name} {value:.2f}" for name, value in vars(found.mean).items())
    print(f"{run.name}: {found.num_views} views: {means}")


if __name__ == "__main__":
    run_script(main)
