"""The numbers of a run from its folder alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError, SceneError
from anm_mj.evaluation.coverage import COVERED_M
from anm_mj.evaluation.curve import CURVE_HEADER, CompletionCurve
from anm_mj.evaluation.depth import back_project_reduced
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.ground_truth_cache import mount_of, scene_truth
from anm_mj.evaluation.mesh import mesh_quality
from anm_mj.evaluation.metrics import Ending, Metrics, Travel, held_out_numbers, summarise
from anm_mj.evaluation.novel_view_poses import HeldOut, ViewQuality
from anm_mj.evaluation.uncapped import uncapped_mean_cm
from anm_mj.io.mesh_file import read_mesh
from anm_mj.io.read_run import Run, read_json, read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import write_json
from anm_mj.scene.folder import load_scene
from anm_mj.scene.navigable import DEFAULT_FOOTPRINT
from anm_mj.viz.plots import draw_curve

OUR_ROBOT = "diff_drive"
"""The robot that made runs whose manifest names none."""


def evaluate_run(
    path: Path,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    heldout: HeldOut | None = None,
) -> Metrics:
    """Compute a run's numbers again and rewrite ``metrics.json``, ``curve.csv`` and ``curve.png``.

    What only the running program knew (why it ended, wall time, memory) is kept from ``metrics.json``, and so is what
    was measured on held-out views unless they were measured anew; of a run that was killed the rest is computed as far
    as it came. A run that was made where nothing could tell which part of the surface can be seen is told it now, if
    its scene is there. What a camera saw counts from where it truly was, whatever the robot believed.

    Args:
        path: The run folder.
        on_progress: Told how much of the search for what can be seen is done, where that is still to be found.
        heldout: What was measured on held-out views (:func:`anm_mj.evaluation.novel_views.measure_held_out`).

    Raises:
        RunFolderError: The folder is not one of a run, or a file in it is damaged.
    """
    run = read_run(path)
    truth = GroundTruth.load(run.folder.ground_truth)
    if truth.observable is None:
        truth = _with_observable(run, truth, on_progress)
    curve, travel = _replay(run, truth)
    return write_results(run.folder, truth, curve, travel, _ending(run.folder), heldout or _heldout(run.folder))


def write_results(
    folder: RunFolder,
    truth: GroundTruth,
    curve: CompletionCurve,
    travel: Travel,
    ending: Ending,
    heldout: HeldOut | None = None,
) -> Metrics:
    """Finish the curve and write ``metrics.json``, ``curve.csv`` and ``curve.png``.

    Raises:
        RunFolderError: A file of the run is damaged, or cannot be written.
    """
    curve.last()
    uncapped_cm = uncapped_mean_cm(truth.samples, curve.distance_m, _clouds(read_run(folder.path)))
    covered = curve.distance_m < COVERED_M
    mesh = mesh_quality(*read_mesh(folder.mesh), truth, covered) if folder.mesh.is_file() else None
    metrics = summarise(travel, curve.rows, curve.path_m, uncapped_cm, truth, mesh, ending, heldout)
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
        curve.frame(frame.step, run.depth_mm(frame), run.intrinsics, frame.T_true_camera, frame.true_pose)
    return curve, travel


def _with_observable(run: Run, truth: GroundTruth, on_progress: Callable[[int, int], None]) -> GroundTruth:
    """The same truth with its observable part, where scene and robot are known and no others than then."""
    if not run.frames or run.manifest.get("robot", OUR_ROBOT) != OUR_ROBOT:
        return truth
    try:
        scene = load_scene(run.manifest.get("scene", ""))
    except SceneError:
        return truth
    first = run.frames[0]
    if scene.hash != run.manifest.get("scene_hash"):
        return truth
    mount = mount_of(run.intrinsics, first.T_true_camera, first.true_pose)
    found = scene_truth(scene, DEFAULT_FOOTPRINT, mount, first.true_pose, on_progress, len(truth.samples))
    return found if np.array_equal(found.samples, truth.samples) else truth


def _clouds(run: Run) -> Iterator[Float[np.ndarray, "n 3"]]:
    for frame in run.frames:
        yield back_project_reduced(run.depth_mm(frame), run.intrinsics, frame.T_true_camera)


def _ending(folder: RunFolder) -> Ending:
    if not folder.metrics.is_file():
        return Ending()
    known = read_json(folder.metrics)
    return Ending(**{field.name: known.get(field.name) for field in dataclasses.fields(Ending)})


def add_held_out(path: Path, heldout: HeldOut) -> None:
    """Put what was measured on held-out views into the ``metrics.json`` of a finished run; all else stays.

    Raises:
        RunFolderError: The file is missing or damaged, or cannot be written.
    """
    folder = RunFolder(path)
    write_json(folder.metrics, read_json(folder.metrics) | held_out_numbers(heldout))


def _heldout(folder: RunFolder) -> HeldOut | None:
    known = read_json(folder.metrics) if folder.metrics.is_file() else {}
    if known.get("heldout_views") is None:
        return None
    values = {field.name: known.get(f"heldout_{field.name}") for field in dataclasses.fields(ViewQuality)}
    mean = ViewQuality(**{name: math.nan if value is None else value for name, value in values.items()})
    return HeldOut(known["heldout_views"], mean if known["heldout_views"] else None)
