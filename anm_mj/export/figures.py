"""The figures of a run as PNG, and as PDF and SVG for print."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anm_mj.export.floor_plan import survey_of
from anm_mj.io.curve_file import read_curve
from anm_mj.io.read_run import Run, read_json
from anm_mj.io.run_title import titled
from anm_mj.io.write import writing
from anm_mj.viz.figure_file import KINDS
from anm_mj.viz.plots import draw_curve, draw_topdown


def export_figures(run: Run, out: Path) -> list[Path]:
    """``topdown`` and ``curve``, each as ``.png``, ``.pdf`` and ``.svg``; the curve where coverage was measured.

    Raises:
        RunFolderError: The run has no top-down map, or the files cannot be written.
    """
    survey = survey_of(run)
    assert survey.topdown is not None
    title = titled(run.folder, read_json(run.folder.metrics) if run.folder.metrics.is_file() else {})
    targets = [plan["target_xy_m"] for plan in run.plans if plan.get("target_xy_m") is not None]
    with writing(out):
        written = draw_topdown(
            out / run.folder.topdown_picture.name,
            survey.topdown,
            survey.graph,
            survey.regions,
            [frame.pose for frame in run.frames],
            target_xy_m=np.array(targets[-1], dtype=np.float64) if targets else None,
            title=title,
            kinds=KINDS,
        )
        curve = read_curve(run.folder.curve)
        if len(curve["step"]):
            ratio, observable, cm = (curve[key] for key in ("completion_ratio", "observable_ratio", "completion_cm"))
            steps = curve["step"].astype(np.int64)
            path = out / run.folder.curve_picture.name
            written += draw_curve(path, steps, ratio, observable, cm, title=title, kinds=KINDS)
    return written
