"""Writes the run folder during the run, a few steps behind it.

One thread computes the completion curve and writes all files in order while the run goes on, the same bytes as if the
run waited for them. A run that is killed loses what was not written yet, the latest steps. Nothing that the robot does
depends on the curve.
"""

from __future__ import annotations

import functools
import importlib
import math
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.evaluation.completion_curve import CURVE_HEADER, CompletionCurve, CurveRow
from anm_mj.evaluation.covered_before import write_covered_before
from anm_mj.evaluation.metrics import EpisodeStatistics, Metrics, RunSummary, pictured, summarise
from anm_mj.evaluation.run_evaluation import quality_of_mesh, without_cap_cm, write_curve
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.io.changes_file import write_changes
from anm_mj.io.explored_file import Explored, write_explored
from anm_mj.io.jsonl import LineWriter
from anm_mj.io.mesh_file import write_mesh
from anm_mj.io.plan_file import PlanRecord, write_plan
from anm_mj.io.read_run import read_json
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_title import titled
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.recording.config import RecordConfig
from anm_mj.recording.run_log import RunLog
from anm_mj.types import (
    Action,
    ActionResult,
    FormerRun,
    MapUpdate,
    Observation,
    Plan,
    Pose2,
    Region,
    StopReason,
    SurfaceChange,
    TopDownMap,
    TrueView,
    VoronoiGraph,
)
from anm_mj.utils.background import Background
from anm_mj.utils.files import atomic_write
from anm_mj.utils.memory import malloc_trim

if TYPE_CHECKING:
    import trimesh

ROOM = 32
"""Observations, frames of the curve, actions and decisions that may wait; the run waits where there are more."""
MESH_RESOLUTION_M = 0.05
"""Grid of the final mesh [m] (the paper's released code)."""


@runtime_checkable
class Arrays(Protocol):
    """Something that can be stored as arrays."""

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays by name."""
        ...


@runtime_checkable
class FinishedMap(Protocol):
    """The neural map at the end of a run."""

    @property
    def is_trained(self) -> bool:
        """Whether it has a surface: whether anything was trained."""
        ...

    def mesh(self, resolution_m: float) -> trimesh.Trimesh:
        """The coloured mesh of the surface, world [m]."""
        ...

    def save(self, path: Path) -> None:
        """Write the map to a file."""
        ...

    def replay(self, limit_bytes: int) -> Arrays:
        """What is replayed of the frames, thinned to so much memory."""
        ...

    def changes(self) -> tuple[SurfaceChange, ...] | None:
        """What is gone or new since the former run; None for a map that began empty."""
        ...

    def close(self) -> None:
        """Give the memory back; nothing is asked any more."""
        ...


@runtime_checkable
class Survey(Protocol):
    """The state of planning that is drawn."""

    @property
    def topdown(self) -> TopDownMap:
        """The map."""
        ...

    @property
    def graph(self) -> VoronoiGraph:
        """The road map."""
        ...

    @property
    def regions(self) -> tuple[Region, ...]:
        """The regions of interest."""
        ...


class Before(NamedTuple):
    """What a continued run begins with."""

    former: FormerRun
    """What the former runs found out beside the map."""
    covered_m: Float32[np.ndarray, " n"]
    """How near each sample of the true surface had been seen [m]."""


class WayBack(NamedTuple):
    """How a robot that was to go back to its start did so."""

    steps: int | None
    """Steps of the way back; None where it did not begin one."""
    distance_m: float
    """From the last pose to the first one [m]."""

    @classmethod
    def of(cls, poses: list[Pose2], explored_steps: int | None) -> WayBack:
        """The way back of a run, from its poses and the number of steps before it; None = there was none."""
        steps = None if explored_steps is None else len(poses) - 1 - explored_steps
        return cls(steps, math.dist(poses[-1].xy_m, poses[0].xy_m))


class RunRecorder:
    """Records a run and its completion.

    Args:
        folder: A new run folder.
        truth: Ground truth, for the metrics only.
        true_view: Returns true poses and depth, if observations hold only what the robot measures: metrics count what
            the camera truly saw from where it truly was.
        record: What is kept besides the numbers; None = the defaults.
        resumed: None for a new run; for one that was resumed, the lengths of its logs by name, as :attr:`log_sizes`
            gave them, and the step after which they were taken. What was written later is removed.
        before: What a continued run begins with; None for one that begins with nothing, and for a resumed one.

    Raises:
        RunFolderError: From every method, if the folder cannot be written; perhaps from one that comes later.
    """

    REBUILT = ("_background", "_folder", "_true_view", "_truth", "_curve_file")

    def __init__(
        self,
        folder: RunFolder,
        truth: GroundTruth,
        true_view: Callable[[], TrueView] | None = None,
        record: RecordConfig | None = None,
        resumed: tuple[dict[str, int], int] | None = None,
        before: Before | None = None,
    ) -> None:
        self._background = Background("recorder", ROOM)
        self._folder = folder
        self._true_view = true_view
        self._truth = truth
        if resumed is None:
            with writing(folder.ground_truth), atomic_write(folder.ground_truth) as partial:
                truth.save(partial)
        if before is not None:
            write_covered_before(folder.covered_before, before.covered_m)
        record = record or RecordConfig()
        self._replay_bytes = record.replay_bytes
        self._log = RunLog(folder, record, resumed)
        self._curve_file = LineWriter(folder.curve, resumed and resumed[0][folder.curve.name])
        if resumed is None:
            self._curve_file.line(CURVE_HEADER)
        self._curve = CompletionCurve(truth, None if before is None else before.covered_m, num_threads=1)
        self.former = None if before is None else before.former
        """What the runs that this one goes on from found out; None where it began with nothing."""
        self._refused: list[Pose2] = []
        self._statistics = EpisodeStatistics()
        self._evaluation_s = 0.0

    def flush(self) -> None:
        """Wait until everything so far is written; then the files and this object belong together."""
        self._background.flush()

    @property
    def log_sizes(self) -> dict[str, int]:
        """Lengths of all logs as of now, by name [bytes]."""
        self.flush()
        return {log.path.name: log.size for log in (*self._log.files, self._curve_file)}

    def written_since(self, step: int) -> list[Path]:
        """The logs, and the depth images after a step: what must be on the disk before a checkpoint counts."""
        self.flush()
        new = range(step + 1, len(self.poses))
        logs = [log.path for log in (*self._log.files, self._curve_file)]
        return [*logs, *(self._folder.depth(each) for each in new)]

    @property
    def poses(self) -> list[Pose2]:
        """Poses of the base so far."""
        self.flush()
        return self._log.poses

    @property
    def completion(self) -> CurveRow | None:
        """Latest row of the curve that is computed, for who watches the run; None before the first one."""
        return self._curve.rows[-1] if self._curve.rows else None

    def observation(self, observation: Observation) -> None:
        """Record an observation; the first one comes before any action."""
        # Only the truth counts as seen, and only where the sensor gave a value.
        true = None if self._true_view is None else self._true_view()
        where = observation if true is None else true
        depth_mm = reduce_depth(where.depth_m)
        self._background.submit(lambda: self._log.observation(observation, true, depth_mm))
        frame = observation.step, depth_mm, observation.intrinsics, where.T_world_camera, where.pose
        self._background.submit(lambda: self._cover(lambda: self._curve.frame(*frame)))

    def _cover(self, add_frame: Callable[[], CurveRow | None]) -> None:
        """Add a frame to the curve, and its row to the file."""
        begin = time.perf_counter()
        row = add_frame()
        if row is not None:
            self._curve_file.line(row.csv)
        self._evaluation_s += time.perf_counter() - begin

    def step(self, step: int, result: ActionResult, pose: Pose2, update: MapUpdate, stage_ms: dict[str, float]) -> None:
        """Record an executed action; ``pose`` is the pose after it."""
        self._statistics = self._statistics.after(result.action, result.collided, result.moved_m, stage_ms)
        if result.collided and result.action is Action.MOVE_FORWARD:
            self._refused.append(pose)
        self._background.submit(lambda: self._log.step(step, result, pose, update, stage_ms))

    def plan(self, step: int, plan: Plan) -> None:
        """Record a decision."""
        self._background.submit(lambda: self._log.plan(step, plan))

    def prepare_results(self) -> None:
        """Wait until everything is written, and begin to load what :meth:`finish` writes pictures and mesh with."""
        self.flush()
        # No run waits for these before its first step.
        for name in ("anm_mj.viz.plots", "trimesh"):
            self._background.submit(functools.partial(importlib.import_module, name))

    def finish(
        self,
        stop_reason: StopReason,
        finished: FinishedMap,
        survey: Survey,
        *,
        wall_s: float,
        loop_s: float,
        memory: dict[str, np.ndarray] | None = None,
        back: WayBack | None = None,
    ) -> Metrics:
        """Write mesh, map, pictures and metrics.

        Args:
            stop_reason: Why the run ended.
            finished: The neural map; closed, as soon as it has been written.
            survey: What planning reads out of it at the end, for the picture.
            wall_s: Wall time from the start of the program to the end of the loop [s].
            loop_s: Wall time of the loop itself, without set-up [s].
            memory: What the policy remembers beside the map, for a run that goes on from this one; None = no run is to
                do so.
            back: How the robot went back to its start; None where it was not to.
        """
        self.flush()
        summary = RunSummary(
            stop_reason=stop_reason.value,
            wall_s=wall_s,
            hz=self._statistics.steps / loop_s if loop_s > 0.0 else None,
            evaluation_s=self._evaluation_s,
            peak_rss_mib=peak_rss_mib(),
            return_steps=back and back.steps,
            return_distance_m=back and back.distance_m,
        )
        self._close_logs()
        # What cannot be recomputed comes first, then what takes long: a run killed in between loses nothing.
        write_json(self._folder.metrics, summary)
        with writing(self._folder.map), atomic_write(self._folder.map) as partial:
            finished.save(partial)
        if memory is not None:
            self._write_explored(finished, memory)
        changes = finished.changes() if self.former is not None else None
        if changes is not None:
            write_changes(self._folder.changes, self._folder.changed_voxels, changes)
        write_plan(self._folder.survey, PlanRecord(np.zeros((0, 2)), survey.topdown, survey.graph, survey.regions))
        # The curve's last figure is searched for beside the mesh, and the pictures are drawn beside its comparison.
        self._curve.last()
        uncapped_cm: list[float | None] = []
        self._background.submit(lambda: uncapped_cm.append(without_cap_cm(self._folder, self._truth, self._curve)))
        if finished.is_trained:
            write_mesh(self._folder.mesh, finished.mesh(MESH_RESOLUTION_M))
        # Its memory is needed for the comparison with the truth.
        finished.close()
        malloc_trim()
        # Map and mesh took memory too, since the summary was first written.
        summary = replace(summary, peak_rss_mib=peak_rss_mib())
        self.flush()
        self._background.submit(lambda: self._draw(survey, changes or ()))
        mesh = quality_of_mesh(self._folder, self._truth, self._curve)
        curve = self._curve
        metrics = summarise(
            self._statistics, curve.rows, curve.path_m, uncapped_cm[0], self._truth, mesh, summary, before=curve.before
        )
        # Before the pictures, which may find no room.
        write_json(self._folder.metrics, metrics)
        self.flush()
        self.close()
        return metrics

    def _draw(self, survey: Survey, changes: Sequence[SurfaceChange]) -> None:
        """Draw the curve and the top-down map."""
        from anm_mj.viz.plots import draw_topdown  # No run waits for matplotlib before its first step.

        write_curve(self._folder, self._curve, self._statistics)
        with writing(self._folder.topdown_picture):
            draw_topdown(
                self._folder.topdown_picture,
                survey.topdown,
                survey.graph,
                survey.regions,
                self._log.poses,
                target_xy_m=self._log.last_target_xy_m,
                title=titled(self._folder, pictured(self._curve, self._statistics)),
                changes=changes,
            )

    def _write_explored(self, finished: FinishedMap, memory: dict[str, np.ndarray]) -> None:
        """Write what a run that goes on from this one needs beside the map."""
        manifest = read_json(self._folder.manifest) if self._folder.manifest.is_file() else {}
        poses, refused = _rows(self.poses), _rows(self._refused)
        if self.former is not None:
            poses = np.concatenate((self.former.poses, poses))
            refused = np.concatenate((self.former.refused, refused))
        former = FormerRun(str(manifest.get("policy", "")), poses, refused, memory)
        write_explored(self._folder.explored, Explored(former, finished.replay(self._replay_bytes).arrays()))

    def close(self) -> None:
        """Close all files when everything is written; a second time does nothing."""
        self._background.close()
        self._close_logs()

    def _close_logs(self) -> None:
        self._log.close()
        self._curve_file.close()

    def __enter__(self) -> RunRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _rows(poses: list[Pose2]) -> Float[np.ndarray, "n 3"]:
    return np.array([[pose.x_m, pose.y_m, pose.yaw_rad] for pose in poses], float).reshape(-1, 3)


def peak_rss_mib() -> float:
    """Peak resident memory of this process [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in KiB, macOS in bytes.
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
