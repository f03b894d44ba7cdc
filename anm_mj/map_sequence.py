"""A recorded sequence becomes a run folder: the map, the mesh, and what the planner would have done.

Its poses are taken as they come, or found by localisation in the map that grows from it.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Collection
from contextlib import closing
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from anm_mj.checkpoint.going_on import lay_over, say_other_engine
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.checkpoint.store import Checkpointer, CheckpointStore
from anm_mj.config import RunConfig
from anm_mj.events import Decided, Ended, Observed, Observer
from anm_mj.io.bag_poses import Track
from anm_mj.io.folder_hold import held
from anm_mj.io.jsonl import LineWriter
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.run_events import Mapped, Started
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import Sequence
from anm_mj.io.sequence_poses import camera_line
from anm_mj.io.to_json import to_json, write_json
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.loop_stages import find_moved, integrate
from anm_mj.mapping_results import frame_metrics, tracking_metrics, write_map
from anm_mj.mapping_state import MappingState, digest, stored_mapping
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.planning.policies.registry import make_policy, policy_class
from anm_mj.recording.results import sync_results
from anm_mj.recording.run_log import RunLog
from anm_mj.run_parts import make_mapper, make_tracker
from anm_mj.sequence_check.find_faults import Verdict
from anm_mj.sequence_check.frame_fit import frame_fit
from anm_mj.types import Footprint, MapUpdate, Observation, StopReason

_logger = logging.getLogger(__name__)

RECORDED = "recorded"
"""Stands in the manifest for what a recorded sequence has not: a policy, a robot, a renderer."""


def map_sequence(
    sequence: Sequence,
    config: RunConfig,
    footprint: Footprint,
    *,
    out: Path | None = None,
    shadow: bool = False,
    reference: Track | None = None,
    verdict: Verdict | None = None,
    corrections: tuple[str, ...] = (),
    observers: Collection[Observer] = (),
    resume: Path | None = None,
) -> RunFolder:
    """Map a sequence and write a run folder, without actions and without ground truth.

    Args:
        sequence: Posed RGB-D frames.
        config: Settings of map and planner; ``scene`` is the sequence. With ``pose`` = ``slam`` the poses of the
            sequence are a prior of the motion between its frames, where it has any.
        footprint: The robot that the top-down map is for.
        out: The run folder; None = a new one below ``runs/``.
        shadow: Whether the policy decides at every frame, without being obeyed; its decisions are recorded. A fault of
            the policy is the last one, and the mapping goes on.
        reference: Poses that the tracked ones are compared with, at the times of the sequence; for ``slam`` only.
        verdict: What a check found before; its figures go to ``metrics.json``.
        corrections: Options that it found and that were applied, for the manifest.
        observers: Hear of the start (:class:`~anm_mj.io.run_events.Started`, with the number of frames for a budget),
            of every frame (:class:`~anm_mj.events.Observed`, :class:`~anm_mj.io.run_events.Mapped`) and decision
            (:class:`~anm_mj.events.Decided`), and after the last frame of the end (:class:`~anm_mj.events.Ended`, whose
            steps are frames); any of them may end the run with what there is.
        resume: The folder of a run of the same sequence and settings that was killed, interrupted or ended in an
            error, to go on with.

    Raises:
        AnmError: Too many images or the policy cannot be used, or the folder cannot be written. As with any other
            error, the folder holds the map up to there.
        CheckpointError: The run cannot be resumed.
    """
    mapping = _Mapping(sequence, config, footprint, shadow=shadow)
    # What cannot be mapped leaves no folder.
    folder = mapping.new_folder(out, corrections) if resume is None else RunFolder.open(resume)
    with held(folder.path):
        mapping.begin(folder, resumes=resume is not None)
        # Nothing is written any more once the folder is let go.
        with closing(mapping.checkpointer):
            _map(mapping, sequence, reference, verdict, observers)
    return folder


def _map(
    mapping: _Mapping,
    sequence: Sequence,
    reference: Track | None,
    verdict: Verdict | None,
    observers: Collection[Observer],
) -> None:
    """Map all frames and write the results; arguments as of :func:`map_sequence`."""
    folder, state, checkpointer = mapping.folder, mapping.state, mapping.checkpointer

    def tell(event: object) -> bool:
        return any([observer.on_event(event) for observer in observers])

    failure: Exception | None = None
    # Between two frames, state and map belong together.
    between = True
    interrupted = tell(Started(folder.path, len(sequence), lambda: None))
    try:
        frames = sequence.observations(start=state.next_frame)
        while not interrupted:
            with state.watch.stage("read"):
                observation = next(frames, None)
            if observation is None:
                break
            between = False
            interrupted = mapping.map_frame(observation, tell)
            between = True
            checkpointer.after_step(state.next_frame, mapping.wall_s)
    except Exception as err:
        # What was mapped before is worth more than nothing.
        failure = err
    ended = failure is None and not interrupted
    try:
        try:
            if not ended and state.last is not None and (between or checkpointer.last_step is not None):
                step = state.next_frame if between else checkpointer.last_step or 0
                checkpointer.finish(step, resumable=True)
        finally:
            mapping.close_logs()
        # Frames after an interruption by the user are not missed.
        reached = state.next_frame if interrupted else len(sequence)
        mapping.write(reached, verdict, reference, ended=ended)
        if ended:
            # What stands for the checkpoints reaches the disk before they go.
            sync_results(folder, mapping.log_paths)
            checkpointer.finish(state.next_frame, resumable=False)
        if failure is None and state.last is not None:
            reason = StopReason.INTERRUPTED if interrupted else StopReason.BUDGET
            tell(Ended(reason, len(state.records), sum(state.watch.ms.values()) / 1e3, state.last))
    except Exception:
        if failure is None:
            raise
    if not ended and any(folder.checkpoints.glob("*.checkpoint")):
        _logger.warning("The same command with --resume %s in place of --out goes on with it.", folder.path)
    if failure is not None:
        if folder.map.is_file():
            text = "Mapping ended after %d frames; %s holds the map up to there."
            _logger.warning(text, len(state.records), folder.path)
        raise failure


class _Mapping:
    """One mapping of a sequence: its parts, where it stands, and the folder that it writes."""

    def __init__(
        self,
        sequence: Sequence,
        config: RunConfig,
        footprint: Footprint,
        *,
        shadow: bool,
    ) -> None:
        """Arguments as of :func:`map_sequence`; raises AnmError as that does."""
        self._begin = time.perf_counter()
        self._sequence, self._config, self._footprint = sequence, config, footprint
        self._map = make_mapper(config)
        tracks = config.pose == "slam"
        self._tracker = make_tracker(config, self._map, has_poses=sequence.has_poses) if tracks else None
        self._policy = _shadow_policy(config, footprint) if shadow else None
        self._options = {"radius": footprint.radius_m, "height": footprint.z_max_m, "shadow": shadow}
        self.state = MappingState()

    def new_folder(self, out: Path | None, corrections: tuple[str, ...]) -> RunFolder:
        """A folder that says what is mapped; arguments as of :func:`map_sequence`."""
        name = RECORDED if self._policy is None else self._config.policy
        folder = RunFolder.create(out, Path(self._config.scene).resolve().name, name)
        said = RunFacts.unsimulated(
            RECORDED,
            scene=self._config.scene,
            policy=name,
            goal=self._config.goal,
            seed=self._config.seed,
            device=self._map.backend.device,
            engine=self._map.backend.name,
        )
        said = replace(said, corrections=corrections, origin_m=self._sequence.origin_m)
        write_json(folder.manifest, manifest(said, sys.argv))
        write_json(folder.config, self._config)
        return folder

    def begin(self, folder: RunFolder, *, resumes: bool) -> None:
        """Open the logs of a folder, new or of a mapping that this one ``resumes``; raises AnmError as
        :func:`map_sequence` does.
        """
        self.folder = folder
        stored = stored_mapping(folder, self._sequence, self._config, self._options) if resumes else None
        if stored is not None:
            say_other_engine(stored, self._map.backend.name)
            self._begin -= float(stored.facts["wall_s"])
        goes_on = stored is not None
        self._log = RunLog(folder, self._config.record, goes_on=goes_on)
        self._cameras = [] if self._tracker is None else [LineWriter(folder.camera_trajectory, goes_on=goes_on)]
        parts = {
            "mapper": self._map,
            "log": self._log,
            "state": self.state,
            "tracker": self._tracker,
            "policy": self._policy,
        }
        roots = {name: part for name, part in parts.items() if part is not None}
        known, store = KnownClasses(policy_class(self._config.policy).__module__), CheckpointStore(folder.checkpoints)
        if stored is not None:
            lay_over(stored, roots, known)
            # Only here is anything in the folder changed.
            self._log.cut(sizes := stored.facts["files"], stored.step)
            for file in self._cameras:
                file.cut(sizes.get(file.path.name, 0))
            store.drop_after(stored.step)
            folder.drop_results()
        self.checkpointer = Checkpointer(
            store,
            self._config.checkpoint,
            lambda: roots,
            self._facts_and_files,
            known,
            resumed_at=None if stored is None else stored.step,
        )

    @property
    def wall_s(self) -> float:
        """Time since the start of the mapping, without what lay between two parts of it [s]."""
        return time.perf_counter() - self._begin

    @property
    def log_paths(self) -> list[Path]:
        """All logs."""
        return [file.path for file in self._files]

    @property
    def _files(self) -> list[LineWriter]:
        return [*self._log.files, *self._cameras]

    def _facts_and_files(self) -> tuple[dict[str, Any], list[Path]]:
        """What a checkpoint says beside the state, and what must be on the disk before it counts."""
        said = {
            "files": {file.path.name: file.size for file in self._files},
            "engine": self._map.backend.name,
            "wall_s": self.wall_s,
            "config": to_json(self._config),
            "options": self._options,
            "sequence": digest(self._sequence),
        }
        since = self.checkpointer.synced_step
        new = [self.folder.depth(record.step) for record in self.state.records if record.step >= since]
        return said, [*self.log_paths, *new]

    def map_frame(self, observation: Observation, tell: Callable[[object], bool]) -> bool:
        """Take in the next frame, and tell observers; whether one of them wants the mapping to end."""
        state, watch = self.state, self.state.watch
        estimate = None
        if self._tracker is not None:
            with watch.stage("localise"):
                estimate = self._tracker.localise(observation)
            observation = estimate.observation
        with watch.stage("map"):
            observation, estimate = find_moved(observation, estimate, self._map)
        with watch.stage("check"):
            fit = frame_fit(observation, self._map, estimate)
        with watch.stage("map"):
            update = integrate(observation, estimate, self._tracker, self._map)
        state.last = observation
        state.fits.append(fit)
        self._log.observation(observation, estimate=estimate, fit=asdict(fit), closes_loop=update.closes_loop)
        record = _record(observation, estimate, update)
        state.records.append(record)
        interrupted, plan = False, None
        if not record.is_lost:
            # A trajectory in this format is of the poses that are known.
            for file in self._cameras:
                file.line(camera_line(observation.time_s, observation.T_world_camera))
            # After a fault it is not asked again, and the mapping goes on.
            if self._policy is not None and not self._policy.has_failed:
                if record.is_mapped:
                    self._policy.observe(observation)
                plan = self._policy.plan(self._map, observation)
                self._log.plan(observation.step, plan)
                interrupted = tell(Decided(observation.step, plan))
        interrupted |= tell(Observed(observation, update, estimate))
        return interrupted | tell(Mapped(observation, self._map, plan))

    def close_logs(self) -> None:
        """No frame is to come."""
        self._log.close()
        for file in self._cameras:
            file.close()

    def write(self, reached: int, verdict: Verdict | None, reference: Track | None, *, ended: bool) -> None:
        """The map and all that is said of it, after ``reached`` frames of the sequence, which has ``ended`` or not; the
        others as of :func:`map_sequence`.
        """
        state, folder = self.state, self.folder
        if state.last is not None:
            if self._config.goal != "coverage" and ended:
                with state.watch.stage("finish"):
                    self._map.finish()
            write_map(folder, self._config, self._map, self._footprint, self._log, state.last)
        records = state.records
        metrics: dict[str, Any] = {
            "frames": len(records),
            "left_out_frames": reached - len(records) + sum(each.frames for each in self._sequence.left_out),
            "wall_s": self.wall_s,
        }
        if records:
            metrics |= frame_metrics(folder, state.fits[: len(records)], records, verdict)
        if self._tracker is not None and records:
            metrics |= tracking_metrics(records, reference, state.watch)
        write_json(folder.metrics, metrics)


def _record(observation: Observation, estimate: PoseEstimate | None, update: MapUpdate) -> FrameRecord:
    pose, T = observation.pose, observation.T_world_camera
    is_lost = estimate is not None and estimate.state is TrackingState.LOST
    is_mapped = estimate is None or estimate.usable
    return FrameRecord(observation.step, observation.time_s, pose, T, pose, T, is_lost, is_mapped, update.closes_loop)


def _shadow_policy(config: RunConfig, footprint: Footprint) -> GuardedPolicy:
    """The policy without its bootstrap rotation: the recording turns as it turns."""
    settings = config.policy_settings
    if any(field.name == "bootstrap_turns" for field in fields(settings)):
        settings = replace(settings, bootstrap_turns=0)
    context = PolicyContext(footprint, settings, config.planning, config.seed, goal=config.goal)
    return GuardedPolicy(make_policy(config.policy, context), config.policy, "The mapping goes on without decisions")
