"""One run, from a configuration to a run folder: puts the stages together and lets ``explore`` loop."""

from __future__ import annotations

import functools
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.checkpoint.store import Checkpointer, CheckpointStore
from anm_mj.config import RunConfig
from anm_mj.errors import RunFolderError
from anm_mj.evaluation.metrics import Metrics
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.explore import LoopState, Outcome, StepReport, explore
from anm_mj.former_run import Former
from anm_mj.ground_truth.cache import cached_ground_truth, reachable_area
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import to_json
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import LookingAround
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.planning.policies.registry import make_policy, needs_truth, policy_class, policy_entry
from anm_mj.planning.policies.returning import Returning
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.protocols import Policy, Viewer
from anm_mj.recording.recorder import Before, RunRecorder, WayBack
from anm_mj.scene.budget import default_steps
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.gl import GlBackend, select_backend
from anm_mj.types import Pose2, StopReason, TrueView
from anm_mj.utils.memory import malloc_trim
from anm_mj.viz.viewer import NullViewer

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.sim.robot import SimRobot

TRIM_STEPS = 100
"""Steps after which freed memory goes back to the system."""


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    viewer: Viewer | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    on_step: Callable[[StepReport, RunRecorder, int], None] = lambda report, recorder, num_steps: None,
    on_survey: Callable[[int, int], None] = lambda done, total: None,
    on_end: Callable[[Outcome], None] = lambda outcome: None,
) -> tuple[RunFolder, Metrics]:
    """Explore a scene and write everything about it.

    Args:
        config: what to do.
        out: the run folder; None = a new one below ``runs/``.
        viewer: shows the run while it goes on; None = no viewer.
        stop_requested: asked before every step; True ends the run with INTERRUPTED and everything written.
        on_step: called after every step, with the budget.
        on_survey: called with the progress of the search for the observable surface; only at the first run in a scene.
        on_end: called when the loop has ended, before the results are written.

    Raises:
        AnmError: the scene, start, policy, device, renderer or output folder cannot be used; nothing has been written
            then, but for an error in the loop itself.
    """
    begin = time.perf_counter()
    former = None if config.continue_from is None else Former.read(Path(config.continue_from))
    with make_parts(config, on_survey, former) as parts:
        folder = RunFolder.create(out, parts.scene.name, config.policy)
        folder.write_manifest(manifest(parts.facts, sys.argv))
        folder.write_config(parts.config)
        surface = parts.truth().surface
        before = None if former is None else Before(former.found(config.policy), former.covered(surface))
        malloc_trim()
        with RunRecorder(folder, surface, true_view(parts), config.record, before=before) as recorder:
            watched = Watched(viewer or NullViewer(), stop_requested, on_step, on_end)
            with saying_how_to_go_on(folder):
                metrics = run_loop(parts, folder, recorder, LoopState(), watched, begin)
    return folder, metrics


@dataclass(frozen=True)
class Parts:
    """What a run is put together from."""

    config: RunConfig
    """With the budget filled in."""
    scene: Scene
    robot: SimRobot
    mapper: NeuralMap
    explorer: GuardedPolicy
    """The policy that the configuration names."""
    policy: Policy
    """The same, with what the run adds to it."""
    truth: Callable[[], SceneTruth]
    facts: RunFacts

    @property
    def known(self) -> KnownClasses:
        """The classes that the state of the run may have: the package's own, and those of the user's policy."""
        return KnownClasses(policy_class(self.config.policy).__module__)


class Watched(NamedTuple):
    """Who follows a run while it goes on; see :func:`run`."""

    viewer: Viewer
    stop_requested: Callable[[], bool]
    on_step: Callable[[StepReport, RunRecorder, int], None]
    on_end: Callable[[Outcome], None]


@contextmanager
def make_parts(
    config: RunConfig, on_survey: Callable[[int, int], None], former: Former | None = None
) -> Iterator[Parts]:
    """Put a run together; the robot is closed at the end.

    Args:
        config: what to do.
        on_survey: called with the progress of the search for the observable surface.
        former: the run that this one goes on from; None = it begins with nothing, or with a checkpoint.

    Raises:
        AnmError: see :func:`run`.
    """
    scene = load_scene(config.scene)
    config = replace(config, steps=config.steps or scene.budget_steps or default_steps(scene.rooms))
    if former is not None:
        former.compare_scene(config.scene, scene.hash)
        config = former.config(config)
    backend = select_backend()
    mapper = _make_mapper(config)
    if former is not None:
        former.begin(mapper)
    with _make_robot(config, scene) as robot:
        truth = functools.cache(lambda: _true_scene(scene, robot, config.steps, on_survey))
        explorer = _make_policy(config, robot, truth)
        if former is not None:
            explorer.continue_from(former.found(config.policy), mapper)
        facts = _facts(config, scene, robot, mapper, backend)
        if former is not None:
            facts = replace(facts, continued_from=former.provenance)
        yield Parts(config, scene, robot, mapper, explorer, _wrapped(explorer, config, robot), truth, facts)


@contextmanager
def saying_how_to_go_on(folder: RunFolder) -> Iterator[None]:
    """Add to the error of a folder that cannot be written any more how the run goes on from its checkpoint.

    Raises:
        RunFolderError: the block raised one.
    """
    try:
        yield
    except RunFolderError as err:
        if not any(folder.checkpoints.glob("*.checkpoint")):
            raise
        raise RunFolderError(f"{err} Then go on with: anm-mj explore --resume {folder.path}") from err


def run_loop(
    parts: Parts, folder: RunFolder, recorder: RunRecorder, state: LoopState, watched: Watched, begin: float
) -> Metrics:
    """The loop and what follows it, from the start or from where a checkpoint was taken.

    Args:
        parts: what the run is put together from.
        folder: the run folder.
        recorder: writes it.
        state: where the loop stands.
        watched: who follows the run.
        begin: ``time.perf_counter`` at the start of the program, less the time of a former one [s].

    Raises:
        AnmError: of a stage, or the folder cannot be written.
    """
    config, robot, mapper = parts.config, parts.robot, parts.mapper
    assert config.steps is not None
    steps = config.steps

    def facts() -> tuple[dict[str, Any], list[Path]]:
        """What a checkpoint says beside the state, and what must be on the disk before it counts."""
        said = {
            "config": to_json(config),
            "engine": mapper.engine_name,
            "files": recorder.log_sizes,
            "wall_s": time.perf_counter() - begin,
        }
        return said, recorder.written_since(checkpointer.last_step or 0)

    def between_steps(state: LoopState) -> None:
        checkpointer.after_step(state.step, state.loop_s)
        # What steps allocate and free leaves holes in the heap, ever more of them.
        if state.step % TRIM_STEPS == 0:
            malloc_trim()

    checkpointer = Checkpointer(
        CheckpointStore(folder.checkpoints),
        config.checkpoint,
        lambda: checkpoint_roots(parts, recorder, state),
        facts,
        parts.known,
        resumed_at=state.step if state.observation is not None else None,
    )
    outcome = explore(
        robot,
        mapper,
        parts.policy,
        num_steps=steps,
        recorder=recorder,
        viewer=watched.viewer,
        stop_requested=watched.stop_requested,
        on_step=lambda report: watched.on_step(report, recorder, steps),
        state=state,
        between_steps=between_steps,
    )
    interrupted = outcome.stop_reason is StopReason.INTERRUPTED
    if interrupted:
        checkpointer.finish(outcome.num_steps, resumable=True)
    recorder.prepare_results()
    wall_s = time.perf_counter() - begin
    watched.on_end(outcome)
    # What the renderer took is needed for the final training, the mesh and its comparison with the truth.
    robot.close()
    malloc_trim()
    if config.goal != "coverage" and not interrupted:
        mapper.finish()
    left = _what_is_left(config, robot, mapper, recorder, outcome)
    back = None
    if isinstance(parts.policy, Returning):
        back = WayBack.of(recorder.poses, None if interrupted else parts.policy.explored_steps)
    remembered = None if config.record.replay_bytes == 0 else parts.explorer.memory()
    metrics = recorder.finish(
        outcome.stop_reason, mapper, left, wall_s=wall_s, loop_s=outcome.loop_s, memory=remembered, back=back
    )
    if not interrupted:
        checkpointer.finish(outcome.num_steps, resumable=False)
    return metrics


def checkpoint_roots(parts: Parts, recorder: RunRecorder, state: LoopState) -> dict[str, Any]:
    """Everything that a checkpoint holds, by name."""
    recorder.flush()
    return {
        "loop": state,
        "robot": parts.robot,
        "mapper": parts.mapper,
        "policy": parts.policy,
        "recorder": recorder,
    }


def true_view(parts: Parts) -> Callable[[], TrueView] | None:
    """A function that gives true poses and depth; None where observations hold them."""
    config = parts.config
    exact = config.pose == "true" and not config.sensor.misses and config.sensor.fault == "none"
    return None if exact else parts.robot.true_view


# The next two functions import torch and mujoco: a mistyped option should not cost the seconds that this takes, and
# mujoco must not be imported before its GL back-end is chosen.


def _make_mapper(config: RunConfig) -> NeuralMap:
    # Threads of torch that spin while they wait for work take the cores away from rendering and from other programs; on
    # a busy machine that costs a factor of five. The OpenMP runtime reads this when torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from anm_mj.mapping.neural_map import NeuralMap

    return NeuralMap(
        config.mapping,
        seed=config.seed,
        device=config.device,
        # A policy with a map of its own kind reads no geometry out of it.
        field_is_geometry=config.planning.geometry == "field" and policy_entry(config.policy).mapping_preset is None,
    )


def _make_robot(config: RunConfig, scene: Scene) -> SimRobot:
    from anm_mj.sim.make_robot import make_robot

    return make_robot(
        scene,
        start=_start_pose(config),
        drive=config.drive,
        image_px=config.image_px,
        robot=config.robot,
        config=config.model,
        pose=config.pose,
        seed=config.seed,
        sensor=config.sensor,
        camera=config.camera,
        motion=config.motion,
        anticipates=True,
        forgets_textures=True,
    )


def _start_pose(config: RunConfig) -> Pose2 | None:
    if config.start is None:
        return None
    x, y, yaw_deg = config.start
    return Pose2(x, y, math.radians(yaw_deg))


def _true_scene(
    scene: Scene, robot: SimRobot, budget_steps: int | None, on_survey: Callable[[int, int], None]
) -> SceneTruth:
    """The true surface with its observable part; the search for that part takes minutes at the first run in a scene."""
    first = robot.observe()
    camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose, first.range_m)
    surface = cached_ground_truth(scene, robot.footprint, camera, first.pose, on_survey)
    return SceneTruth(surface, reachable_area(scene, robot.footprint, first.pose), camera, budget_steps)


def _make_policy(config: RunConfig, robot: SimRobot, truth: Callable[[], SceneTruth]) -> GuardedPolicy:
    """The policy; only one that needs the truth waits for it."""
    told = truth() if needs_truth(config.policy) else None
    context = PolicyContext(robot.footprint, config.policy_settings, config.planning, config.seed, told, config.goal)
    return GuardedPolicy(make_policy(config.policy, context), config.policy)


def _wrapped(explorer: Policy, config: RunConfig, robot: SimRobot) -> Policy:
    """A policy with the look around of a continued run, and with the way back."""
    policy = explorer if config.continue_from is None else LookingAround(explorer)
    if not config.return_to_start:
        return policy
    assert config.steps is not None
    return Returning(policy, config.planning, robot.footprint, config.steps)


def _facts(config: RunConfig, scene: Scene, robot: SimRobot, mapper: NeuralMap, backend: GlBackend) -> RunFacts:
    return RunFacts(
        config.scene,
        scene.hash,
        config.robot,
        robot.robot_hash,
        config.policy,
        config.goal,
        config.seed,
        mapper.backend.device,
        mapper.engine_name,
        backend.name,
        backend.renderer_string,
        robot.camera_kind,
        config.sensor.name,
    )


def _what_is_left(
    config: RunConfig, robot: SimRobot, mapper: NeuralMap, recorder: RunRecorder, outcome: Outcome
) -> PlanningState:
    """The shared planning stages, run once on the final map along the trajectory of the whole run."""
    stages = Stages(config.planning, robot.footprint)
    if recorder.former is not None:
        stages.continue_from(recorder.former)
    for pose in recorder.poses:
        stages.topdown.visit(pose.xy_m)
    return stages.read(mapper, outcome.observation)
