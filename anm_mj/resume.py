"""Goes on with a run that was killed or interrupted, from its newest whole checkpoint.

The run is rebuilt from the configuration in its folder, the stored state is laid over it, the logs are cut
to the length that they had then, and the loop goes on. On a CPU the files at the end are those of an undisturbed run,
but for times. Files of a run folder are data: nothing in them is executed.
"""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

from msgspec import field

from anm_mj.checkpoint.checkpoint_file import StoredState
from anm_mj.checkpoint.going_on import (
    LoggedFacts,
    first_difference,
    lay_over,
    logged_facts,
    of_stored_state,
    say_other_engine,
)
from anm_mj.checkpoint.store import CheckpointStore
from anm_mj.config import RunConfig, leaves, read_config
from anm_mj.errors import CheckpointError, RobotError, SceneError
from anm_mj.evaluation.metrics import Metrics
from anm_mj.events import Observer
from anm_mj.io.folder_hold import held
from anm_mj.io.jsonl import LineWriter, read_jsonl
from anm_mj.io.manifest import manifest
from anm_mj.io.read_run import read_json
from anm_mj.io.run_folder import RunFolder, refuse_links
from anm_mj.io.to_json import to_json
from anm_mj.loop_state import LoopState
from anm_mj.planning.policies.registry import policies
from anm_mj.recording.recorder import RunRecorder
from anm_mj.run import checkpoint_roots, run_loop, saying_how_to_go_on
from anm_mj.run_parts import Parts, make_parts
from anm_mj.types import StopReason
from anm_mj.utils.read_file import convert

_logger = logging.getLogger(__name__)

_MADE_WITH = ("git", "packages", "camera", "gl_renderer")
"""Entries of the manifest by which a step may differ, although scene, robot and settings are the same."""
_FREE = ("scene", "robot", "device", "steps", "checkpoint", "continue_from")
"""What may differ from the run so far: paths of what is compared by its content, and what does not change a step."""


class _Facts(LoggedFacts):
    """What a run says of itself in a checkpoint."""

    config: dict[str, Any] = field(default_factory=dict)
    """The configuration that it was made with; older checkpoints do not say."""


def resume(
    path: Path,
    *,
    policy: str | None = None,
    observers: Sequence[Observer] = (),
    kind: type[RunConfig] = RunConfig,
    assemble: Callable[..., AbstractContextManager[Parts]] = make_parts,
    state: LoopState | None = None,
) -> tuple[RunFolder, Metrics]:
    """Go on with the run in a folder. ``policy`` is the ``module:Class`` of the run, which says that this code may run;
    None = only policies of this package.

    A configuration of the class ``kind`` is put together by ``assemble``, called as
    :func:`anm_mj.run_parts.make_parts`; ``observers`` are as of :func:`anm_mj.run.run`, ``state`` as of
    :func:`anm_mj.run.run_with`. Raises CheckpointError if the run has ended, has no whole checkpoint, or is one of
    another scene, robot or version, and AnmError as :func:`anm_mj.run.run` does.
    """
    begin = time.perf_counter()
    folder = RunFolder.open(path)
    refuse_links(folder.path.resolve())
    with held(folder.path):
        _require_unfinished(folder)
        config = _config(folder, policy, kind)
        store = CheckpointStore(folder.checkpoints)
        stored = store.newest(lambda state: _require_logs(folder, state))
        with _found(folder, assemble(config, observers), config) as parts:
            _require_same_world(folder, parts)
            _require_same_settings(folder, stored, parts)
            say_other_engine(stored, parts.mapper.backend.name)
            lost = len(read_jsonl(folder.steps)) - stored.step
            state = state or LoopState()
            made_with = _made_with(folder, parts)
            with RunRecorder(folder, parts.surface, parts.true_view, config.record, goes_on=True) as recorder:
                lay_over(stored, checkpoint_roots(parts, recorder, state), parts.known)
                # Only here is anything in the folder changed.
                recorder.cut(stored.facts["files"], stored.step)
                store.drop_after(stored.step)
                folder.drop_results()
                with LineWriter(folder.resumed, goes_on=True) as log:
                    said = {"step": stored.step, "steps_lost": max(lost, 0), "engine": parts.mapper.backend.name}
                    log.json(said | made_with)
                _logger.info("The run goes on at step %d; %d later steps are done again.", stored.step, max(lost, 0))
                begin -= float(stored.facts.get("wall_s", 0.0))
                with of_stored_state(stored, store), saying_how_to_go_on(folder, parts.config):
                    return folder, run_loop(parts, folder, recorder, state, observers, begin)


@contextmanager
def _found(folder: RunFolder, assembled: AbstractContextManager[Parts], config: RunConfig) -> Iterator[Parts]:
    """The parts of a run. Raises CheckpointError where its scene or robot is not found, with what to do: a resumed run
    is told of neither.
    """
    with ExitStack() as stack:
        try:
            parts = stack.enter_context(assembled)
        except (SceneError, RobotError) as err:
            # Of a live robot, the network is meant.
            if config.COMMAND != RunConfig.COMMAND:
                raise
            raise CheckpointError(
                f"{err} The run goes on with the scene and the robot that {folder.config} names, as seen from the "
                "folder that it was begun in; where one has moved, write its present place there."
            ) from err
        yield parts


def _config(folder: RunFolder, policy: str | None, kind: type[RunConfig]) -> RunConfig:
    """The configuration; raises CheckpointError where the policy is no name, or code that nobody has vouched for."""
    values = read_json(folder.config)
    named = values.get("policy")
    if not isinstance(named, str):
        raise CheckpointError(
            f"The run's policy in {folder.config} is {named!r}, which is no name; copy the run again."
        )
    if policy is not None and policy != named:
        raise CheckpointError(f"--policy is '{policy}', but the run's policy is '{named}'; leave --policy out.")
    if named not in policies() and policy is None:
        raise CheckpointError(
            f"The run's policy '{named}' is code outside of this program, and a run folder may come from anybody; if "
            f"you trust it, add --policy {named}."
        )
    return read_config(values, kind)


def _require_unfinished(folder: RunFolder) -> None:
    if not folder.metrics.is_file() or folder.checkpoints.is_dir():
        return
    reason = read_json(folder.metrics).get("stop_reason")
    if reason is not None and reason != StopReason.INTERRUPTED:
        raise CheckpointError(f"The run in {folder.path} has ended ({reason}); there is nothing to resume.")


def _require_logs(folder: RunFolder, state: StoredState) -> None:
    """Raises CheckpointError unless logs and images reach as far as the checkpoint."""
    logged_facts(state, _Facts, folder.path, "step")
    missing = next((step for step in range(state.step + 1) if not folder.depth(step).is_file()), None)
    if missing is not None:
        raise CheckpointError(f"{folder.depth(missing).name} is missing.")


def _require_same_world(folder: RunFolder, parts: Parts) -> None:
    known = read_json(folder.manifest) if folder.manifest.is_file() else {}
    for name, now in (("scene", parts.facts.scene_hash), ("robot", parts.facts.robot_hash)):
        before = known.get(f"{name}_hash")
        if before != now:
            raise CheckpointError(
                f"The {name} '{known.get(name)}' has changed since the run began (hash {str(before)[:12]}, now "
                f"{now[:12]}); put the old one back, or start a new run."
            )


def _made_with(folder: RunFolder, parts: Parts) -> dict[str, Any]:
    """What of the program and the machine goes on with the run; what differs from its beginning is logged."""
    known = read_json(folder.manifest)
    now = {key: value for key, value in manifest(parts.facts, []).items() if key in _MADE_WITH}
    other = [key for key in _MADE_WITH if known.get(key) != to_json(now[key])]
    if other:
        _logger.warning(
            "The run goes on with another %s than it began with, and may take another way from here; %s says which.",
            " and ".join(other),
            folder.resumed.name,
        )
    return now


def _require_same_settings(folder: RunFolder, stored: StoredState, parts: Parts) -> None:
    before, now = dict(leaves(convert(stored.facts, _Facts).config)), dict(leaves(to_json(parts.config)))
    name = first_difference(before, now, _FREE)
    if name is not None:
        raise CheckpointError(
            f"{folder.config} says {name} = {now[name]!r:.60}, and the run was made with {before[name]!r:.60}; put "
            "that back, or start a new run."
        )
