"""What a run folder gets at its end: map, mesh, pictures and metrics."""

from __future__ import annotations

import functools
import importlib
import resource
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from anm_mj.evaluation.completion import COVERED_M
from anm_mj.evaluation.metrics import Metrics, RunSummary, pictured, summarise
from anm_mj.evaluation.people_metrics import surface_lost_percent
from anm_mj.evaluation.run_evaluation import quality_of_mesh, trajectory_metrics, without_cap_cm, write_curve
from anm_mj.events import Ended
from anm_mj.io.changes_file import write_changes
from anm_mj.io.explored_file import Explored, write_explored
from anm_mj.io.mesh_file import MESH_RESOLUTION_M, write_mesh
from anm_mj.io.plan_file import write_plan
from anm_mj.io.read_run import Run, read_json, read_run, titled
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.sequence_poses import base_line
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.recording.recorder import RunRecorder
from anm_mj.types import ExploredState, Plan, Pose2, SurfaceChange
from anm_mj.utils.files import atomic_write, sync, write_text
from anm_mj.utils.memory import malloc_trim

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap


def load_mesh_library(recorder: RunRecorder) -> None:
    """Begin to load what meshes are written with: no run waits for it before its first step."""
    recorder.background.submit(functools.partial(importlib.import_module, "trimesh"))


def write_results(
    recorder: RunRecorder,
    ended: Ended,
    finished: NeuralMap,
    survey: Plan,
    *,
    wall_s: float,
    release: Callable[[], None] = lambda: None,
    memory: dict[str, np.ndarray] | None = None,
    back: tuple[int | None, float | None] = (None, None),
) -> Metrics:
    """Write mesh, map, pictures and metrics of a recorded run that has ``ended``, and close the recorder. Raises
    RunFolderError if the folder cannot be written.

    Args:
        recorder: Has recorded the run.
        ended: How the loop ended.
        finished: The neural map.
        survey: What planning reads out of it at the end.
        wall_s: From the start of the program to the end of the loop [s].
        release: Called as soon as the map is needed no more, so that its memory is free for what follows.
        memory: What the policy remembers beside the map, for a run that goes on from this one; None = none does.
        back: Of a robot that was to go back to its start: the steps of its return, None where it did not begin one, and
            how far from the start it ended [m].
    """
    recorder.flush()
    folder, curve, statistics = recorder.folder, recorder.curve, recorder.statistics
    summary = RunSummary(
        stop_reason=ended.stop_reason.value,
        wall_s=wall_s,
        hz=statistics.steps / ended.loop_s if ended.loop_s > 0.0 else None,
        evaluation_s=recorder.evaluation_s,
        peak_rss_mib=peak_rss_mib(),
        return_steps=back[0],
        return_distance_m=back[1],
        **recorder.people.metrics(),
    )
    recorder.close_logs()
    # What cannot be recomputed comes first, then what takes long: a run killed in between loses nothing.
    write_json(folder.metrics, summary)
    with writing(folder.map), atomic_write(folder.map) as partial:
        finished.save(partial)
    if memory is not None:
        _write_explored(recorder, finished, memory)
    changes = finished.changes() if recorder.prior is not None else None
    if changes is not None:
        write_changes(folder.changes, folder.changed_voxels, changes)
    write_plan(folder.survey, survey)
    # The curve's last figure is searched for beside the mesh, and the pictures are drawn beside its comparison.
    curve.last()
    uncapped_cm: list[float | None] = [None]
    truth = recorder.truth
    if truth is not None:
        lost = surface_lost_percent(finished.occupancy_grid(), truth.samples[curve.distance_m < COVERED_M])
        summary = replace(summary, surface_lost_percent=lost)
        recorder.background.submit(lambda: uncapped_cm.append(without_cap_cm(folder, truth, curve)))
    if finished.is_trained:
        # The mesh takes most; what the survey and the files took is to make room for it.
        malloc_trim()
        write_mesh(folder.mesh, finished.mesh(MESH_RESOLUTION_M))
    release()
    malloc_trim()
    # Map and mesh took memory too, since the summary was first written.
    summary = replace(summary, peak_rss_mib=peak_rss_mib())
    recorder.flush()
    run = read_run(folder.path)
    recorder.background.submit(lambda: _draw(recorder, run, survey, changes or ()))
    mesh = trajectory = None
    if truth is not None:
        mesh = quality_of_mesh(run, truth, curve)
        trajectory = trajectory_metrics(run, truth, curve)
        if trajectory is not None:
            lines = [base_line(frame.time_s, frame.true_pose) for frame in run.frames]
            write_text(folder.true_trajectory, "\n".join(lines) + "\n")
    metrics = summarise(statistics, curve, uncapped_cm[-1], truth, mesh, summary, trajectory=trajectory)
    # Before the pictures, which may find no room.
    write_json(folder.metrics, metrics)
    recorder.flush()
    recorder.close()
    return metrics


def sync_results(folder: RunFolder, logs: Iterable[Path]) -> None:
    """Force logs and results of a run that has ended to the disk. Raises RunFolderError if that fails."""
    for path in (*logs, *folder.results):
        if path.is_file():
            with writing(path):
                sync(path)


def _draw(recorder: RunRecorder, run: Run, survey: Plan, changes: Sequence[SurfaceChange]) -> None:
    # No run waits for matplotlib before its first step.
    from anm_mj.viz.figure_file import save_figure
    from anm_mj.viz.plots import topdown_figure

    folder = recorder.folder
    if recorder.truth is not None:
        write_curve(folder, recorder.curve, recorder.statistics)
    with writing(folder.topdown_picture):
        figure = topdown_figure(
            survey,
            run.known_poses,
            target_xy_m=recorder.log.last_target_xy_m,
            title=titled(folder, pictured(recorder.curve, recorder.statistics)),
            changes=changes,
        )
        save_figure(figure, folder.topdown_picture)


def _write_explored(recorder: RunRecorder, finished: NeuralMap, memory: dict[str, np.ndarray]) -> None:
    """Write what a run that goes on from this one needs beside the map."""
    folder = recorder.folder
    manifest = read_json(folder.manifest) if folder.manifest.is_file() else {}
    poses, collisions = _rows(recorder.poses), _rows(recorder.collisions)
    if recorder.prior is not None:
        poses = np.concatenate((recorder.prior.poses, poses))
        collisions = np.concatenate((recorder.prior.collisions, collisions))
    prior = ExploredState(str(manifest.get("policy", "")), poses, collisions, memory)
    write_explored(folder.explored, Explored(prior, finished.replay(recorder.replay_bytes).arrays()))


def _rows(poses: list[Pose2]) -> Float[np.ndarray, "n 3"]:
    return np.array([[pose.x_m, pose.y_m, pose.yaw_rad] for pose in poses], float).reshape(-1, 3)


def peak_rss_mib() -> float:
    """Peak resident memory of this process [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in KiB, macOS in bytes.
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
