"""Measures a finished run's map on views from places where its robot never stood.

    python scripts/heldout_views.py runs/latest --views 20

Prints the means and writes ``heldout.json`` and ``heldout.png`` into the run's folder; see
:mod:`anm_mj.evaluation.novel_views`. ``anm-mj eval RUN --heldout`` does the same and puts the means into
``metrics.json``.
"""

from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.novel_views import FAR_M, measure_held_out


def main(run: Annotated[Path, tyro.conf.Positional], views: int = 20, seed: int = 0, scene: str | None = None) -> None:
    """Measure a run's map on held-out views.

    Args:
        run: Folder of a finished run.
        views: How many views; fewer where there are not as many.
        seed: Places and directions derive from it.
        scene: The run's scene, where it lies now if it has moved.
    """
    found = measure_held_out(run, views, seed, scene)
    if found.mean is None:
        raise RunFolderError(f"{run} leaves no clear place farther than {FAR_M} m from its path that sees the map.")
    means = ", ".join(f"{name} {value:.2f}" for name, value in vars(found.mean).items())
    print(f"{run.name}: {found.num_views} views: {means}")


if __name__ == "__main__":
    tyro.cli(main)
