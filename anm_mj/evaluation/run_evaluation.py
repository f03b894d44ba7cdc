"""Evaluates a finished run from its folder alone."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.errors import RunFolderError, SceneError
from anm_mj.evaluation.completion import Completion, Coverage, uncapped_completion_cm
from anm_mj.evaluation.completion_curve import CURVE_HEADER, CompletionCurve
from anm_mj.evaluation.covered_before import read_covered_before, true_clouds
from anm_mj.evaluation.mesh_quality import MeshQuality, mesh_quality
from anm_mj.evaluation.metrics import (
    FIXED,
    NOVEL,
    EpisodeStatistics,
    Metrics,
    RunSummary,
    pictured,
    summarise,
    view_metrics,
)
from anm_mj.evaluation.trajectory_error import alignment, is_exact, trajectory_error
from anm_mj.evaluation.view_quality import ViewsResult
from anm_mj.frames import transform_points
from anm_mj.ground_truth.cache import cached_ground_truth
from anm_mj.ground_truth.ground_truth import COVERED_M, GroundTruth
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.ground_truth.reduced_depth import halved_intrinsics
from anm_mj.io.curve_file import COMPLETION_COLUMNS
from anm_mj.io.folder_hold import held
from anm_mj.io.mesh_file import read_mesh
from anm_mj.io.read_run import Run, read_json, read_run, titled
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.scene.folder import load_scene
from anm_mj.types import DEFAULT_FOOTPRINT, Action
from anm_mj.utils.files import write_text
from anm_mj.utils.progress import Progress, unheard

_OF_VIEWS = {field.name for field in dataclasses.fields(Metrics) if field.name.startswith((NOVEL, FIXED))}
"""Keys of ``metrics.json`` about views."""


def evaluate_run(
    path: Path,
    on_progress: Progress = unheard,
    novel_views: ViewsResult | None = None,
    fixed_views: ViewsResult | None = None,
) -> Metrics:
    """Recompute a run's metrics and rewrite ``metrics.json``, ``curve.csv`` and ``curve.png``.

    Facts that only the running program knew (stop reason, wall time, memory) are kept from ``metrics.json``; so are the
    metrics of novel and fixed views unless given. A killed run is evaluated as far as it came. If the run could not
    compute the observable surface, it is computed now, provided that the scene is available. Frames count from the true
    camera pose, whatever pose the robot believed. Raises RunFolderError if the folder is no run, is being written, or a
    file in it is damaged. ``on_progress`` is called with done and total rounds while the observable surface is
    computed.
    """
    path = RunFolder.open(path).path
    with held(path):
        run = read_run(path)
        if not run.frames:
            raise RunFolderError(
                f"{path} holds no frame yet, so there is nothing to evaluate; wait for the run's first step, or start "
                "it again."
            )
        truth = GroundTruth.load(run.folder.ground_truth)
        if truth.observable is None:
            truth = _with_observable(run, truth, on_progress)
        statistics = EpisodeStatistics()
        for step in run.steps:
            statistics = statistics.after(Action[step.action], step.collided, step.moved_m, step.ms)
        curve = CompletionCurve(truth, _covered_before(run.folder, truth))
        for frame in run.frames:
            believed = None if frame.is_lost else frame.pose
            curve.frame(frame.step, run.depth_mm(frame), run.intrinsics, frame.T_true_camera, frame.true_pose, believed)
        known = read_json(run.folder.metrics) if run.folder.metrics.is_file() else {}
        summary = RunSummary(**{field.name: known.get(field.name) for field in dataclasses.fields(RunSummary)})
        views = {name: value for name, value in known.items() if name in _OF_VIEWS}
        for result, prefix in ((novel_views, NOVEL), (fixed_views, FIXED)):
            views |= {} if result is None else view_metrics(result, prefix)
        curve.last()
        uncapped_cm = without_cap_cm(run.folder, truth, curve)
        write_curve(run.folder, curve, statistics)
        mesh = quality_of_mesh(run, truth, curve)
        trajectory = trajectory_metrics(run, truth, curve)
        metrics = summarise(statistics, curve, uncapped_cm, truth, mesh, summary, views, trajectory)
        write_json(run.folder.metrics, metrics)
        return metrics


def without_cap_cm(folder: RunFolder, truth: GroundTruth, curve: CompletionCurve) -> float | None:
    """Completion of a run without the cap at 1 m [cm], from its depth images; None without any depth point. Raises
    RunFolderError if a file of the run is damaged.
    """
    clouds = true_clouds(read_run(folder.path))
    return uncapped_completion_cm(truth.samples, curve.distance_m, clouds, _covered_before(folder, truth))


def write_curve(folder: RunFolder, curve: CompletionCurve, statistics: EpisodeStatistics) -> None:
    """Write ``curve.csv`` and ``curve.png`` of a finished curve. Raises RunFolderError if the manifest is damaged, or a
    file cannot be written.
    """
    # No run waits for matplotlib before its first step.
    from anm_mj.viz.figure_file import save_figure
    from anm_mj.viz.plots import curve_figure

    before = curve.before
    with writing(folder.path):
        lines = [CURVE_HEADER, *(row.csv for row in curve.rows)]
        write_text(folder.curve, "\n".join(lines) + "\n")
        figure = curve_figure(
            # None becomes NaN.
            {name: np.array([getattr(row, name) for row in curve.rows], np.float64) for name in COMPLETION_COLUMNS},
            title=titled(folder, pictured(curve, statistics)),
            before_ratio=None if before is None else before.ratio_percent,
        )
        save_figure(figure, folder.curve_picture)


def quality_of_mesh(
    run: Run, truth: GroundTruth, curve: CompletionCurve, T_true_believed: Float[np.ndarray, "4 4"] | None = None
) -> tuple[MeshQuality, MeshQuality | None] | None:
    """Quality of a run's mesh, moved by a rigid motion if one is given, as a whole, and culled to what a finished curve
    covered; None where there is no mesh. Raises RunFolderError if the mesh is damaged.
    """
    if not run.folder.mesh.is_file():
        return None
    vertices, faces = read_mesh(run.folder.mesh)
    if T_true_believed is not None:
        vertices = transform_points(T_true_believed, vertices).astype(vertices.dtype)
    stands = {"chair": run.frames[-1].chair, "doors": run.frames[-1].doors} if run.frames else {}
    return mesh_quality(vertices, faces, truth, curve.distance_m < COVERED_M, **stands)


def trajectory_metrics(run: Run, truth: GroundTruth, curve: CompletionCurve) -> dict[str, Any] | None:
    """Errors of a run's trajectory, and its mesh after their alignment, by the keys of ``metrics.json``. Returns None
    where the run knew the true pose of every frame. Raises RunFolderError if the mesh is damaged.
    """
    if is_exact(run.frames):
        return None
    found: dict[str, Any] = dataclasses.asdict(trajectory_error(run.frames))
    known = [frame for frame in run.frames if not frame.is_lost]
    if known:
        believed = np.array([frame.T_world_camera[:3, 3] for frame in known])
        true = np.array([frame.T_true_camera[:3, 3] for frame in known])
        _, observed = quality_of_mesh(run, truth, curve, alignment(believed, true)) or (None, None)
        if observed is not None:
            found["aligned_observed_accuracy_cm"] = observed.accuracy_cm
            found["aligned_observed_f_score"] = observed.f_score_percent
    return found


def completion_with_halved_intrinsics(path: Path) -> Completion:
    """Completion at the end of a run, back-projected as by the paper's code.

    See :func:`~anm_mj.ground_truth.reduced_depth.halved_intrinsics`. For images of 128 x 128 pixels it equals the run's
    own. Raises RunFolderError if the folder is no run, or a file in it is damaged.
    """
    run = read_run(path)
    truth = GroundTruth.load(run.folder.ground_truth)
    coverage = Coverage(truth.samples, truth.observable, _covered_before(run.folder, truth))
    intrinsics = halved_intrinsics(run.intrinsics)
    for frame in run.frames:
        coverage.add(run.depth_mm(frame), intrinsics, frame.T_true_camera)
    return coverage.completion()


def add_views(path: Path, novel_views: ViewsResult, fixed_views: ViewsResult) -> None:
    """Add the metrics of novel and fixed views to the ``metrics.json`` of a finished run; everything else stays. Raises
    RunFolderError if the file is missing or damaged, or cannot be written.
    """
    metrics = RunFolder(path).metrics
    added = view_metrics(novel_views, NOVEL) | view_metrics(fixed_views, FIXED)
    write_json(metrics, read_json(metrics) | added)


def _covered_before(folder: RunFolder, truth: GroundTruth) -> Float32[np.ndarray, " n"] | None:
    """What a continued run began with; None for another one."""
    path = folder.covered_before
    return read_covered_before(path, len(truth.samples)) if path.is_file() else None


def _with_observable(run: Run, truth: GroundTruth, on_progress: Progress) -> GroundTruth:
    """The same ground truth with its observable part, if robot and scene are still those of the run."""
    footprint = run.footprint or (DEFAULT_FOOTPRINT if run.manifest.get("robot") == DEFAULT_ROBOT else None)
    if footprint is None:
        return truth
    try:
        scene = load_scene(run.manifest.get("scene", ""))
    except SceneError:
        return truth
    first = run.frames[0]
    if scene.hash != run.manifest.get("scene_hash"):
        return truth
    range_m = float(run.config.get("sensor", {}).get("max_range_m", 0.0)) or math.inf
    camera = CameraExtrinsics.of_view(run.intrinsics, first.T_true_camera, first.true_pose, range_m)
    found = cached_ground_truth(scene, footprint, camera, first.true_pose, on_progress, len(truth.samples))
    return found if np.array_equal(found.samples, truth.samples) else truth
