"""One run, from a configuration to a run folder: lets ``explore`` loop over the parts, and writes what it brought."""

import functools
import math
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from anm_mj.anticipating_robot import AnticipatingRobot
from anm_mj.checkpoint.store import Checkpointer, CheckpointStore
from anm_mj.config import RunConfig
from anm_mj.errors import RunFolderError
from anm_mj.evaluation.covered_before import covered_before
from anm_mj.evaluation.metrics import Metrics
from anm_mj.events import Ended, Observed, Observer, Stepped
from anm_mj.explore import explore
from anm_mj.io.folder_hold import held
from anm_mj.io.manifest import manifest
from anm_mj.io.run_events import Started
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import to_json, write_json
from anm_mj.loop_stages import doubt_stop
from anm_mj.loop_state import LoopState
from anm_mj.planning.policies.anm_s.region_stages import RegionStages
from anm_mj.planning.policies.registry import policies
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.prior_run import PriorRun
from anm_mj.recording.recorder import Before, RunRecorder
from anm_mj.recording.results import load_mesh_library, sync_results, write_results
from anm_mj.run_parts import Parts, make_parts
from anm_mj.types import Observation, Plan, Pose2, StopReason
from anm_mj.utils.memory import malloc_trim

TRIM_STEPS = 100
"""Steps after which freed memory goes back to the system."""


def run(config: RunConfig, *, out: Path | None = None, observers: Sequence[Observer] = ()) -> tuple[RunFolder, Metrics]:
    """Explore a scene and write everything about it into a run folder; ``out`` None = a new one below ``runs/``.
    Observers hear the events of the loop (:mod:`anm_mj.events`) and of the run (:mod:`anm_mj.io.run_events`); any of
    them may end the run, with everything written.

    Raises AnmError if the scene, start, policy, device, renderer or output folder cannot be used; nothing has been
    written then, but for an error in the loop itself.
    """
    begin = time.perf_counter()
    prior = None if config.continue_from is None else PriorRun.read(Path(config.continue_from))
    with make_parts(config, observers, prior) as parts:
        return run_with(parts, begin, out=out, prior=prior, observers=observers)


def run_with(
    parts: Parts,
    begin: float,
    *,
    out: Path | None = None,
    prior: PriorRun | None = None,
    observers: Sequence[Observer] = (),
    state: LoopState | None = None,
) -> tuple[RunFolder, Metrics]:
    """:func:`run` with what it is put together from. ``begin`` is ``time.perf_counter`` at the start of the program
    [s], ``prior`` the run that this one goes on from, ``state`` where the loop stands, for who follows it; None =
    nobody does. Raises AnmError as that does.
    """
    config = parts.config
    folder = RunFolder.create(out, parts.name, config.policy)
    write_json(folder.manifest, manifest(parts.facts, sys.argv))
    write_json(folder.config, config)
    surface, before = parts.surface, None
    if prior is not None and surface is not None:
        before = Before(prior.found(config.policy), covered_before(prior.run, surface))
    malloc_trim()
    state = state or LoopState(config.planning.patience_steps)
    with (
        held(folder.path),
        RunRecorder(folder, surface, parts.true_view, config.record, before=before) as recorder,
        saying_how_to_go_on(folder, parts.config),
    ):
        return folder, run_loop(parts, folder, recorder, state, observers, begin)


@contextmanager
def saying_how_to_go_on(folder: RunFolder, config: RunConfig) -> Iterator[None]:
    """Add to the error of a folder that cannot be written any more how the run goes on from its checkpoint. Raises
    RunFolderError if the block raised one.
    """
    try:
        yield
    except RunFolderError as err:
        if not any(folder.checkpoints.glob("*.checkpoint")):
            raise
        command = resume_command(folder.path, config.policy, config.COMMAND)
        raise RunFolderError(f"{err} Then go on with: {command}") from err


def resume_command(folder: Path, policy: str, command: str) -> str:
    """The command line that goes on with an interrupted run of ``anm-mj`` ``command``."""
    named = [] if policy in policies() else ["--policy", policy]
    return shlex.join(["anm-mj", command, "--resume", str(folder), *named])


class _StateKeeper:
    """Takes checkpoints between two steps, and gives freed memory back; hears of a step after the recorder has."""

    def __init__(self, checkpointer: Checkpointer, num_steps: int) -> None:
        self._checkpointer, self._num_steps = checkpointer, num_steps

    def on_event(self, event: object) -> None:
        if isinstance(event, Observed) and event.observation.step == 0:
            self._checkpointer.after_step(0, 0.0)
        elif isinstance(event, Stepped) and event.step < self._num_steps:
            self._checkpointer.after_step(event.step, event.loop_s)
            # What steps allocate and free leaves holes in the heap, ever more of them.
            if event.step % TRIM_STEPS == 0:
                malloc_trim()


def run_loop(
    parts: Parts,
    folder: RunFolder,
    recorder: RunRecorder,
    state: LoopState,
    observers: Sequence[Observer],
    begin: float,
) -> Metrics:
    """The loop and what follows it, from the start or from where a checkpoint was taken. ``begin`` is
    ``time.perf_counter`` at the start of the program, less the time of an earlier one [s]. Raises AnmError where a
    stage does, or if the folder cannot be written.
    """
    config, mapper = parts.config, parts.mapper
    assert config.steps is not None

    def facts() -> tuple[dict[str, Any], list[Path]]:
        """What a checkpoint says beside the state, and what must be on the disk before it counts."""
        said = {
            "config": to_json(config),
            "engine": mapper.backend.name,
            "files": recorder.log_sizes,
            "wall_s": time.perf_counter() - begin,
        }
        return said, recorder.written_since(checkpointer.synced_step)

    checkpointer = Checkpointer(
        CheckpointStore(folder.checkpoints),
        config.checkpoint,
        lambda: checkpoint_roots(parts, recorder, state),
        facts,
        parts.known,
        resumed_at=state.step if state.observation is not None else None,
    )
    for observer in observers:
        observer.on_event(Started(folder.path, config.steps, lambda: recorder.completion, parts.robot.footprint))
    robot = AnticipatingRobot(parts.robot, state)
    if isinstance(parts.policy, ReturnToStart):
        parts.policy.confirm = functools.partial(doubt_stop, state=state)
    keeper = _StateKeeper(checkpointer, config.steps)
    followers = (robot, recorder, *observers, keeper)
    # Nothing is written any more once the folder is let go.
    with closing(checkpointer):
        ended = explore(
            robot,
            mapper,
            parts.policy,
            num_steps=config.steps,
            localiser=parts.localiser,
            observers=followers,
            state=state,
        )
    interrupted = ended.stop_reason is StopReason.INTERRUPTED
    if interrupted:
        checkpointer.finish(ended.num_steps, resumable=True)
    recorder.flush()
    wall_s = time.perf_counter() - begin
    # What these took is needed for the final training, the mesh and its comparison with the truth.
    parts.robot.close()
    if parts.localiser is not None:
        parts.localiser.close()
    malloc_trim()
    load_mesh_library(recorder)
    # The last checkpoint holds what a resumed run goes on from; nobody shows this map anything any more.
    if interrupted or config.goal == "coverage":
        mapper.settle_moved()
    else:
        mapper.finish()
        # It holds the optimiser twice.
        malloc_trim()
    left = _what_is_left(parts, recorder, _where_it_was(recorder, ended, is_lost=state.lost_steps > 0))
    back = None, None
    if isinstance(parts.policy, ReturnToStart):
        explored_steps, poses = None if interrupted else parts.policy.explored_steps, recorder.poses
        steps = None if explored_steps is None else ended.num_steps - explored_steps
        back = steps, math.dist(poses[-1].xy_m, poses[0].xy_m) if poses else None
    memory = None if config.record.replay_bytes == 0 else parts.explorer.memory()
    metrics = write_results(
        recorder, ended, mapper, left, wall_s=wall_s, release=mapper.close, memory=memory, back=back
    )
    if not interrupted:
        # What stands for the checkpoints reaches the disk before they go.
        sync_results(folder, recorder.log_paths)
        checkpointer.finish(ended.num_steps, resumable=False)
    return metrics


def checkpoint_roots(parts: Parts, recorder: RunRecorder, state: LoopState) -> dict[str, Any]:
    """Everything that a checkpoint holds, by name."""
    recorder.flush()
    roots = {"loop": state, "robot": parts.robot, "mapper": parts.mapper, "policy": parts.policy, "recorder": recorder}
    return roots if parts.localiser is None else {**roots, "localiser": parts.localiser}


def _what_is_left(parts: Parts, recorder: RunRecorder, seen: Observation) -> Plan:
    """The planning stages of the paper's policy, run once on the final map along the trajectory of the whole run."""
    stages = RegionStages(parts.config.planning, parts.robot.footprint)
    if recorder.prior is not None:
        stages.continue_from(recorder.prior)
    for pose in recorder.poses:
        stages.topdown.visit(pose.xy_m)
    return stages.read(parts.mapper, seen).plan("what is left")


def _where_it_was(recorder: RunRecorder, ended: Ended, *, is_lost: bool) -> Observation:
    """The last observation; of a robot that is lost, where it last knew that it was, or where the prior run ended."""
    seen = ended.observation
    if not is_lost:
        return seen
    if recorder.poses:
        return replace(seen, pose=recorder.poses[-1])
    prior = None if recorder.prior is None else recorder.prior.poses
    return seen if prior is None or not len(prior) else replace(seen, pose=Pose2(*prior[-1].tolist()))
