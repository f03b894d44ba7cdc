"""The numbers of a run from its folder alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.coverage import COVERED_M
from anm_mj.evaluation.curve import CURVE_HEADER, CompletionCurve
from anm_mj.evaluation.depth import back_project_reduced
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.mesh import mesh_quality
from anm_mj.evaluation.metrics import Ending, Metrics, Travel, summarise
from anm_mj.evaluation.uncapped import uncapped_mean_cm
from anm_mj.io.jsonable import write_json
from anm_mj.io.mesh_file import read_mesh
from anm_mj.io.read_run import Run, read_json, read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.viz.plots import draw_curve


def evaluate_run(path: Path) -> Metrics:
    """Compute a run's numbers again and rewrite ``metrics.json``, ``curve.csv`` and ``curve.png``.

    What only the running program knew (why it ended, wall time, memory) is kept from ``metrics.json``; of a run that
    was killed the rest is computed as far as it came.

    Raises:
        RunFolderError: The folder is not one of a run, or a file in it is damaged.
    """
    run = read_run(path)
    truth = GroundTruth.load(run.folder.ground_truth)
    curve, travel = _replay(run, truth)
    return write_results(run.folder, truth, curve, travel, _ending(run.folder))


def write_results(
    folder: RunFolder, truth: GroundTruth, curve: CompletionCurve, travel: Travel, ending: Ending
) -> Metrics:
    """Finish the curve and write ``metrics.json``, ``curve.csv`` and ``curve.png``.

    Raises:
        RunFolderError: A file of the run is damaged, or cannot be written.
    """
    curve.last()
    uncapped_cm = uncapped_mean_cm(truth.samples, curve.distance_m, _clouds(read_run(folder.path)))
    covered = curve.distance_m < COVERED_M
    mesh = mesh_quality(*read_mesh(folder.mesh), truth, covered) if folder.mesh.is_file() else None
    metrics = summarise(travel, curve.rows, curve.path_m, uncapped_cm, truth, mesh, ending)
    try:
        lines = [CURVE_HEADER, *(row.csv for row in curve.rows)]
        folder.curve.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
        draw_curve(
            folder.curve_picture,
            np.array([row.step for row in curve.rows], dtype=np.int64),
            np.array([row.completion_ratio for row in curve.rows], dtype=np.float64),
            np.array([row.completion_cm for row in curve.rows], dtype=np.float64),
            title=folder.path.name,
        )
    except OSError as err:
        raise RunFolderError(f"{folder.path} cannot be written ({err.strerror}); free some space.") from err
    write_json(folder.metrics, metrics)
    return metrics


def _replay(run: Run, truth: GroundTruth) -> tuple[CompletionCurve, Travel]:
    travel = Travel()
    for step in run.steps:
        travel = travel.after(step.action, step.collided, step.moved_m, step.stage_ms)
    curve = CompletionCurve(truth)
    for frame in run.frames:
        curve.frame(frame.step, run.depth_mm(frame), run.intrinsics, frame.T_world_camera, frame.pose)
    return curve, travel


def _clouds(run: Run) -> Iterator[Float[np.ndarray, "n 3"]]:
    for frame in run.frames:
        yield back_project_reduced(run.depth_mm(frame), run.intrinsics, frame.T_world_camera)


def _ending(folder: RunFolder) -> Ending:
    if not folder.metrics.is_file():
        return Ending()
    known = read_json(folder.metrics)
    return Ending(**{field.name: known.get(field.name) for field in dataclasses.fields(Ending)})
