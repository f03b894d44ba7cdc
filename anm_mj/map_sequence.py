"""A recorded sequence becomes a run folder: the map, the mesh, and what the planner would have done.

Its poses are taken as they come, or found by localisation in the map that grows from it.
"""

import logging
import sys
import time
from collections.abc import Collection
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.checkpoint.going_on import lay_over, say_other_engine
from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.checkpoint.store import Checkpointer, CheckpointStore
from anm_mj.config import RunConfig
from anm_mj.evaluation.trajectory_error import reference_error, warn_of_assumed_times
from anm_mj.events import Decided, Observed, Observer
from anm_mj.io.bag_poses import Track
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.mesh_file import MESH_RESOLUTION_M, write_mesh
from anm_mj.io.plan_file import write_plan
from anm_mj.io.run_events import Mapped, Started
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import Sequence, ranges_text
from anm_mj.io.sequence_poses import camera_line
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.loop_stages import find_moved, integrate
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping_state import MappingState, facts_of, open_logs, stored_mapping
from anm_mj.planning.policies.anm_s.region_stages import RegionStages
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy, policy_class
from anm_mj.protocols import Policy
from anm_mj.recording.run_log import RunLog
from anm_mj.run_parts import make_mapper, make_tracker
from anm_mj.sequence_check.find_faults import Verdict
from anm_mj.sequence_check.frame_fit import FrameFit, fit_metrics, frame_fit, misfits, say_misfits
from anm_mj.sequence_check.warn_and_fix import facts
from anm_mj.types import Footprint, MapUpdate, Observation
from anm_mj.utils.files import atomic_write
from anm_mj.utils.stopwatch import Stopwatch

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
        shadow: Whether the policy decides at every frame, without being obeyed; its decisions are recorded.
        reference: Poses that the tracked ones are compared with, at the times of the sequence; for ``slam`` only.
        verdict: What a check found before; its figures go to ``metrics.json``.
        corrections: Options that it found and that were applied, for the manifest.
        observers: Hear of the start (:class:`~anm_mj.io.run_events.Started`, with the number of frames for a budget),
            of every frame (:class:`~anm_mj.events.Observed`, :class:`~anm_mj.io.run_events.Mapped`) and decision
            (:class:`~anm_mj.events.Decided`); any of them may end the run with what there is.
        resume: The folder of a run of the same sequence and settings that was killed, interrupted or ended in an
            error, to go on with.

    Raises:
        AnmError: Too many images or the policy cannot be used, or the folder cannot be written. As with any other
            error, the folder holds the map up to there.
        CheckpointError: The run cannot be resumed.
    """
    begin = time.perf_counter()
    neural_map = make_mapper(config)
    tracker = make_tracker(config, neural_map, has_poses=sequence.has_poses) if config.pose == "slam" else None
    policy = _shadow_policy(config, footprint) if shadow else None
    name = config.policy if shadow else RECORDED
    stored = None
    if resume is None:
        folder = RunFolder.create(out, Path(config.scene).resolve().name, name)
        said = replace(_facts(config, neural_map, name), corrections=corrections)
        write_json(folder.manifest, manifest(said, sys.argv))
        write_json(folder.config, config)
    else:
        folder, stored = stored_mapping(resume, sequence, config)
        say_other_engine(stored, neural_map.backend.name)
        begin -= float(stored.facts["wall_s"])
    log, cameras = open_logs(folder, config, stored, tracks=tracker is not None)
    state = MappingState()
    roots = {"mapper": neural_map, "log": log, "state": state, "tracker": tracker, "policy": policy}
    roots = {name: each for name, each in roots.items() if each is not None}
    known = KnownClasses(policy_class(config.policy).__module__)
    if stored is not None:
        lay_over(stored, roots, known)
        folder.metrics.unlink(missing_ok=True)
    records, fits, watch = state.records, state.fits, state.watch

    def facts_and_files() -> tuple[dict[str, Any], list[Path]]:
        said = facts_of(sequence, config, neural_map.backend.name, [*log.files, *cameras], time.perf_counter() - begin)
        since = checkpointer.last_step or 0
        new = [folder.depth(record.step) for record in records if record.step >= since]
        return said, [*(file.path for file in (*log.files, *cameras)), *new]

    checkpointer = Checkpointer(
        CheckpointStore(folder.checkpoints),
        config.checkpoint,
        lambda: roots,
        facts_and_files,
        known,
        resumed_at=None if stored is None else stored.step,
    )

    def tell(event: object) -> bool:
        return any([observer.on_event(event) for observer in observers])

    failure: Exception | None = None
    # Between two frames, state and map belong together.
    between = True
    interrupted = tell(Started(folder.path, len(sequence), lambda: None))
    try:
        frames = sequence.observations(start=state.next_frame)
        while not interrupted:
            with watch.stage("read"):
                observation = next(frames, None)
            if observation is None:
                break
            between = False
            estimate = None
            if tracker is not None:
                with watch.stage("localise"):
                    estimate = tracker.localise(observation)
                observation = estimate.observation
            with watch.stage("map"):
                observation, estimate = find_moved(observation, estimate, neural_map)
            with watch.stage("check"):
                fits.append(frame_fit(observation, neural_map))
            with watch.stage("map"):
                update = integrate(observation, estimate, tracker, neural_map)
            state.last = observation
            log.observation(observation, estimate=estimate, fit=asdict(fits[-1]), closes_loop=update.closes_loop)
            records.append(_record(observation, estimate, update))
            is_lost = records[-1].is_lost
            # A trajectory in this format is of the poses that are known.
            for file in cameras if not is_lost else ():
                file.line(camera_line(observation.time_s, observation.T_world_camera))
            plan = None
            if policy is not None and not is_lost:
                policy.observe(observation)
                plan = policy.plan(neural_map, observation)
                log.plan(observation.step, plan)
                interrupted |= tell(Decided(observation.step, plan))
            interrupted |= tell(Observed(observation, update, estimate))
            interrupted |= tell(Mapped(observation, neural_map, plan))
            between = True
            checkpointer.after_step(state.next_frame, time.perf_counter() - begin)
    except Exception as err:
        # What was mapped before is worth more than nothing.
        failure = err
    last = state.last
    ended = failure is None and not interrupted
    try:
        try:
            if not ended and last is not None and (between or checkpointer.last_step is not None):
                step = state.next_frame if between else checkpointer.last_step or 0
                checkpointer.finish(step, resumable=True)
        finally:
            log.close()
            for file in cameras:
                file.close()
        if last is not None:
            if config.goal != "coverage" and ended:
                with watch.stage("finish"):
                    neural_map.finish()
            _finish(folder, config, neural_map, footprint, log, last)
        # Frames after an interruption by the user are not missed.
        reached = state.next_frame if interrupted else len(sequence)
        metrics: dict[str, Any] = {
            "frames": len(records),
            "left_out_frames": reached - len(records) + sum(each.frames for each in sequence.left_out),
            "wall_s": time.perf_counter() - begin,
        }
        if records:
            metrics |= _fit_metrics(folder, fits[: len(records)], records, verdict)
        if tracker is not None and records:
            metrics |= _tracking_metrics(records, reference, watch)
        write_json(folder.metrics, metrics)
        if ended:
            checkpointer.finish(state.next_frame, resumable=False)
    except Exception:
        if failure is None:
            raise
    if not ended and any(folder.checkpoints.glob("*.checkpoint")):
        _logger.warning("The same command with --resume %s in place of --out goes on with it.", folder.path)
    if failure is not None:
        if folder.map.is_file():
            _logger.warning("Mapping ended after %d frames; %s holds the map up to there.", len(records), folder.path)
        raise failure
    return folder


def _record(observation: Observation, estimate: PoseEstimate | None, update: MapUpdate) -> FrameRecord:
    pose, T = observation.pose, observation.T_world_camera
    is_lost = estimate is not None and estimate.state is TrackingState.LOST
    is_mapped = estimate is None or estimate.usable
    return FrameRecord(observation.step, observation.time_s, pose, T, pose, T, is_lost, is_mapped, update.closes_loop)


def _fit_metrics(
    folder: RunFolder, fits: list[FrameFit], records: list[FrameRecord], verdict: Verdict | None
) -> dict[str, Any]:
    """How well frames fit each other and the map; warnings name those that do not."""
    from anm_mj.viz.plots import draw_fit

    positions = np.array([record.T_world_camera[:3, 3] for record in records])
    say_misfits(fits, positions, [record.time_s for record in records])
    with writing(folder.fit_picture):
        draw_fit(folder.fit_picture, [fit.fitting for fit in fits], [fit.residual_m for fit in fits], misfits(fits))
    used = 100.0 * float(np.mean([record.is_mapped for record in records]))
    return {"used_percent": used, **fit_metrics(fits), **({} if verdict is None else facts(verdict))}


def _tracking_metrics(records: list[FrameRecord], reference: Track | None, watch: Stopwatch) -> dict[str, Any]:
    """What ``metrics.json`` says of a tracked sequence; warnings name the frames that were not mapped."""
    lost = [record.step for record in records if record.is_lost]
    unmapped = [record.step for record in records if not record.is_mapped]
    if lost:
        _logger.warning("The camera was LOST in %d of %d frames: %s.", len(lost), len(records), ranges_text(lost))
    if len(unmapped) > len(lost):
        _logger.warning(
            "%d of %d frames are not in the map, as their pose was not good enough: %s.",
            len(unmapped),
            len(records),
            ranges_text(unmapped),
        )
    metrics: dict[str, Any] = {
        "lost_percent": 100.0 * len(lost) / len(records),
        "unmapped_percent": 100.0 * len(unmapped) / len(records),
        "loops_closed": sum(record.closes_loop for record in records),
        "frame_ms": {stage: ms / len(records) for stage, ms in watch.ms.items() if stage != "finish"},
    }
    if reference is not None:
        warn_of_assumed_times([record.time_s for record in records], reference)
        error = reference_error(records, reference)
        if error is None:
            _logger.warning("%s has fewer than 3 poses at the times of the frames.", reference.name)
        else:
            metrics |= asdict(error)
    return metrics


def _finish(
    folder: RunFolder, config: RunConfig, neural_map: NeuralMap, footprint: Footprint, log: RunLog, last: Observation
) -> None:
    """Map, mesh, top-down map and its picture."""
    from anm_mj.viz.figure_file import save_figure
    from anm_mj.viz.plots import topdown_figure

    with writing(folder.map), atomic_write(folder.map) as partial:
        neural_map.save(partial)
    write_mesh(folder.mesh, neural_map.mesh(MESH_RESOLUTION_M))
    stages = RegionStages(config.planning, footprint)
    for pose in log.poses:
        stages.topdown.visit(pose.xy_m)
    survey = stages.read(neural_map, last).plan("the end")
    write_plan(folder.survey, survey)
    with writing(folder.topdown_picture):
        figure = topdown_figure(
            survey,
            log.poses,
            target_xy_m=log.last_target_xy_m,
            title=f"{Path(config.scene).resolve().name}, {log.num_frames} recorded frames",
        )
        save_figure(figure, folder.topdown_picture)


def _shadow_policy(config: RunConfig, footprint: Footprint) -> Policy:
    """The policy without its bootstrap rotation: the recording turns as it turns."""
    settings = config.policy_settings
    if any(field.name == "bootstrap_turns" for field in fields(settings)):
        settings = replace(settings, bootstrap_turns=0)
    return make_policy(config.policy, PolicyContext(footprint, settings, config.planning, config.seed))


def _facts(config: RunConfig, neural_map: NeuralMap, policy: str) -> RunFacts:
    return RunFacts.unsimulated(
        RECORDED,
        scene=config.scene,
        policy=policy,
        goal=config.goal,
        seed=config.seed,
        device=neural_map.backend.device,
        engine=neural_map.backend.name,
    )
