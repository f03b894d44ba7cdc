"""Writes the run folder during the run, a few steps behind it.

One thread computes the completion curve and writes all files in order while the run goes on, the same bytes as if the
run waited for them. A run that is killed loses what was not written yet, the latest steps. Nothing that the robot does
depends on the curve.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from anm_mj.evaluation.completion_curve import CURVE_HEADER, CompletionCurve, CurveRow
from anm_mj.evaluation.covered_before import write_covered_before
from anm_mj.evaluation.metrics import EpisodeStatistics
from anm_mj.evaluation.people_metrics import PeopleStatistics
from anm_mj.events import Decided, Observed, Stepped
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.io.jsonl import LineWriter
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.write import writing
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.recording.record_config import RecordConfig
from anm_mj.recording.run_log import RunLog
from anm_mj.types import Action, ActionResult, ExploredState, MapUpdate, Observation, Plan, Pose2, TrueView
from anm_mj.utils.files import atomic_write
from anm_mj.utils.threads import Background

ROOM = 32
"""Observations, frames of the curve, actions and decisions that may wait; the run waits where there are more."""


class Before(NamedTuple):
    """What a continued run begins with."""

    prior: ExploredState
    """What the prior runs found out beside the map."""
    covered_m: Float32[np.ndarray, " n"]
    """How near each sample of the true surface had been seen [m]."""


class RunRecorder:
    """Records a run and its completion, from the events of its loop. Every method raises RunFolderError if the folder
    cannot be written; perhaps one that comes later.

    Args:
        folder: A new run folder, or that of a run that was resumed.
        truth: Ground truth, for the metrics only; None where nobody knows it, as of a real robot.
        true_view: Returns true poses and depth, if observations hold only what the robot measures: metrics count what
            the camera truly saw from where it truly was.
        record: What is kept besides the numbers; None = the defaults.
        goes_on: Whether the run was resumed; its logs are to be :meth:`cut`.
        before: What a continued run begins with; None for one that begins with nothing, and for a resumed one.
    """

    REBUILT = ("background", "folder", "_true_view", "truth", "_curve_file")

    def __init__(
        self,
        folder: RunFolder,
        truth: GroundTruth | None,
        true_view: Callable[[], TrueView] | None = None,
        record: RecordConfig | None = None,
        *,
        goes_on: bool = False,
        before: Before | None = None,
    ) -> None:
        self.background = Background("recorder", ROOM)
        self.folder = folder
        self._true_view = true_view
        self.truth = truth
        if not goes_on and truth is not None:
            with writing(folder.ground_truth), atomic_write(folder.ground_truth) as partial:
                truth.save(partial)
        if before is not None:
            write_covered_before(folder.covered_before, before.covered_m)
        record = record or RecordConfig()
        self.replay_bytes = record.replay_bytes
        self.log = RunLog(folder, record, goes_on=goes_on)
        self._curve_file = None
        if truth is not None:
            self._curve_file = LineWriter(folder.curve, goes_on=goes_on)
            if not goes_on:
                self._curve_file.line(CURVE_HEADER)
        self.curve = CompletionCurve(truth, None if before is None else before.covered_m, num_threads=1)
        self.prior = None if before is None else before.prior
        """What the runs that this one goes on from found out; None where it began with nothing."""
        self.collisions: list[Pose2] = []
        self.statistics = EpisodeStatistics()
        self.people = PeopleStatistics()
        self.evaluation_s = 0.0

    def cut(self, sizes: Mapping[str, int], step: int) -> None:
        """Remove what was written after a step, as :meth:`RunLog.cut`; lengths are as of :attr:`log_sizes`."""
        self.log.cut(sizes, step)
        if self._curve_file is not None:
            self._curve_file.cut(sizes.get(self._curve_file.path.name, 0))

    def flush(self) -> None:
        """Wait until everything so far is written; then the files and this object belong together."""
        self.background.flush()

    @property
    def log_sizes(self) -> dict[str, int]:
        """Lengths of all logs as of now, by name [bytes]."""
        self.flush()
        return {log.path.name: log.size for log in self._logs}

    @property
    def log_paths(self) -> list[Path]:
        """All logs."""
        return [log.path for log in self._logs]

    @property
    def _logs(self) -> tuple[LineWriter, ...]:
        return self.log.files if self._curve_file is None else (*self.log.files, self._curve_file)

    def written_since(self, step: int) -> list[Path]:
        """The logs, and what else was written after a step, -1 for all: what must be on the disk before a checkpoint
        counts.
        """
        self.flush()
        folder, new = self.folder, range(step + 1, self.log.num_frames)
        once = (folder.config, folder.manifest, folder.camera, folder.ground_truth) if step < 0 else ()
        # The decision at a step comes after its checkpoint.
        beside = [path(each) for path in (folder.image, folder.plan) for each in (max(step, 0), *new)]
        there = [path for path in (*once, *beside) if path.is_file()]
        return [*self.log_paths, *(folder.depth(each) for each in new), *there]

    @property
    def poses(self) -> list[Pose2]:
        """Poses of the base so far, without those of frames whose pose was not known."""
        self.flush()
        return self.log.poses

    @property
    def completion(self) -> CurveRow | None:
        """Latest row of the curve that is computed, for who watches the run; None before the first one."""
        return self.curve.rows[-1] if self.curve.rows else None

    def on_event(self, event: object) -> None:
        """Record an event; see :class:`anm_mj.events.Observer`."""
        if isinstance(event, Observed):
            self.observation(event.observation, event.estimate, closes_loop=event.update.closes_loop)
        elif isinstance(event, Decided):
            self.plan(event.step, event.plan)
        elif isinstance(event, Stepped):
            self.step(event.step, event.result, event.observation.pose, event.update, event.stage_ms)

    def observation(
        self, observation: Observation, estimate: PoseEstimate | None = None, *, closes_loop: bool = False
    ) -> None:
        """Record an observation, and whether it moved earlier keyframes; the first one comes before any action."""
        # Only the truth counts as seen, and only where the sensor gave a value.
        true = None if self._true_view is None else self._true_view()
        where = observation if true is None else true
        self.people.add(observation, true)
        depth_mm = reduce_depth(where.depth_m)
        self.background.submit(
            lambda: self.log.observation(observation, true, depth_mm, estimate, closes_loop=closes_loop)
        )
        is_lost = estimate is not None and estimate.state is TrackingState.LOST
        believed = None if is_lost else observation.pose
        frame = observation.step, depth_mm, observation.intrinsics, where.T_world_camera, where.pose, believed
        self.background.submit(lambda: self._cover(lambda: self.curve.frame(*frame)))

    def _cover(self, add_frame: Callable[[], CurveRow | None]) -> None:
        """Add a frame to the curve, and its row to the file."""
        begin = time.perf_counter()
        row = add_frame()
        if row is not None and self._curve_file is not None:
            self._curve_file.line(row.csv)
        self.evaluation_s += time.perf_counter() - begin

    def step(self, step: int, result: ActionResult, pose: Pose2, update: MapUpdate, stage_ms: dict[str, float]) -> None:
        """Record an executed action; ``pose`` is the pose after it."""
        self.statistics = self.statistics.after(result.action, result.collided, result.moved_m, stage_ms)
        self.people.step(result)
        if result.collided and result.action is Action.MOVE_FORWARD:
            self.collisions.append(pose)
        self.background.submit(lambda: self.log.step(step, result, pose, update, stage_ms))

    def plan(self, step: int, plan: Plan) -> None:
        """Record a decision."""
        self.background.submit(lambda: self.log.plan(step, plan))

    def close(self) -> None:
        """Close all files when everything is written; a second time does nothing."""
        self.background.close()
        self.close_logs()

    def close_logs(self) -> None:
        """Close all logs; nothing is recorded any more."""
        for log in self._logs:
            log.close()

    def __enter__(self) -> RunRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
