"""The figures of a run: as PNG, and as PDF and SVG for print."""

from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.export.floor_plan import survey_of
from anm_mj.io.changes_file import read_changes
from anm_mj.io.curve_file import read_curve
from anm_mj.io.read_run import Run, read_json, titled
from anm_mj.io.write import writing
from anm_mj.viz.figure_file import KINDS, ShownFigure, save_figure
from anm_mj.viz.plots import curve_figure, topdown_figure


def export_figures(run: Run, out: Path) -> list[Path]:
    """``topdown`` and ``curve``, each as ``.png``, ``.pdf`` and ``.svg``; the curve where coverage was measured. Raises
    RunFolderError if the run has no top-down map, or the files cannot be written.
    """
    figures = {run.folder.topdown_picture.name: topdown_of(run)}
    if len(read_curve(run.folder.curve)["step"]):
        figures[run.folder.curve_picture.name] = curve_of(run)
    with writing(out):
        return [file for name, figure in figures.items() for file in save_figure(figure, out / name, KINDS)]


def topdown_of(run: Run) -> ShownFigure:
    """A run's top-down map, with what changed since a run before it. Raises RunFolderError if it has none, or a file is
    damaged.
    """
    targets = [plan["target_xy_m"] for plan in run.plans if plan.get("target_xy_m") is not None]
    return topdown_figure(
        survey_of(run),
        run.known_poses,
        target_xy_m=np.array(targets[-1], dtype=np.float64) if targets else None,
        title=titled(run.folder, _metrics(run)),
        changes=read_changes(run.folder.changed_voxels),
    )


def curve_of(run: Run) -> ShownFigure:
    """A run's completion curve. Raises RunFolderError if its coverage was not measured."""
    curve, metrics = read_curve(run.folder.curve), _metrics(run)
    if not len(curve["step"]):
        raise RunFolderError(f"{run.folder.path} has no completion curve: its coverage was not measured.")
    before = metrics.get("completion_ratio_before")
    return curve_figure(curve, title=titled(run.folder, metrics), before_ratio=before)


def _metrics(run: Run) -> dict[str, Any]:
    return read_json(run.folder.metrics) if run.folder.metrics.is_file() else {}
