"""One run, from a configuration to a run folder: puts the stages together and lets ``explore`` loop."""

from __future__ import annotations

import functools
import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from anm_mj.config import RunConfig, default_steps
from anm_mj.evaluation.ground_truth_cache import cached_ground_truth, reachable_area
from anm_mj.evaluation.metrics import Metrics
from anm_mj.evaluation.pixel_rays import CameraExtrinsics
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.explore import Outcome, StepReport, explore
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.recorder import RunRecorder
from anm_mj.io.run_folder import RunFolder
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guard import GuardedPolicy
from anm_mj.planning.policies.registry import make_policy, needs_truth, policy_entry
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.protocols import Policy, Viewer
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.gl import GlBackend, select_backend
from anm_mj.types import Pose2, StopReason, TrueView
from anm_mj.utils.memory import malloc_trim
from anm_mj.viz.viewer import NullViewer

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.sim.robot import SimRobot


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
    scene = load_scene(config.scene)
    steps = config.steps or scene.budget_steps or default_steps(scene.rooms)
    backend = select_backend()
    mapper = _make_mapper(config)
    with _make_robot(config, scene) as robot:
        truth = functools.cache(lambda: _true_scene(scene, robot, on_survey))
        policy = _make_policy(config, robot, truth)
        folder = RunFolder.create(out, scene.name, config.policy)
        folder.write_manifest(manifest(_facts(config, scene, robot, mapper, backend), sys.argv))
        folder.write_config(replace(config, steps=steps))
        surface = truth().surface
        malloc_trim()
        with RunRecorder(folder, surface, _true_view(config, robot), config.record) as recorder:
            outcome = explore(
                robot,
                mapper,
                policy,
                num_steps=steps,
                recorder=recorder,
                viewer=viewer or NullViewer(),
                stop_requested=stop_requested,
                on_step=lambda report: on_step(report, recorder, steps),
            )
            wall_s = time.perf_counter() - begin
            on_end(outcome)
            if config.goal != "coverage" and outcome.stop_reason is not StopReason.INTERRUPTED:
                mapper.finish()
            left = _what_is_left(config, robot, mapper, recorder, outcome)
            # The renderer's memory is needed for the mesh and its comparison with the truth.
            robot.close()
            return folder, recorder.finish(outcome.stop_reason, mapper, left, wall_s=wall_s, loop_s=outcome.loop_s)


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
    )


def _start_pose(config: RunConfig) -> Pose2 | None:
    if config.start is None:
        return None
    x, y, yaw_deg = config.start
    return Pose2(x, y, math.radians(yaw_deg))


def _true_scene(scene: Scene, robot: SimRobot, on_survey: Callable[[int, int], None]) -> SceneTruth:
    """The true surface with its observable part; the search for that part takes minutes at the first run in a scene."""
    first = robot.observe()
    camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose)
    surface = cached_ground_truth(scene, robot.footprint, camera, first.pose, on_survey)
    return SceneTruth(surface, reachable_area(scene, robot.footprint, first.pose), camera)


def _make_policy(config: RunConfig, robot: SimRobot, truth: Callable[[], SceneTruth]) -> Policy:
    """The policy; only one that needs the truth waits for it."""
    told = truth() if needs_truth(config.policy) else None
    context = PolicyContext(robot.footprint, config.policy_settings, config.planning, config.seed, told, config.goal)
    return GuardedPolicy(make_policy(config.policy, context), config.policy)


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


def _true_view(config: RunConfig, robot: SimRobot) -> Callable[[], TrueView] | None:
    """A function that gives true poses and depth; None where observations hold them."""
    return None if config.pose == "true" and not config.sensor.misses else robot.true_view


def _what_is_left(
    config: RunConfig, robot: SimRobot, mapper: NeuralMap, recorder: RunRecorder, outcome: Outcome
) -> PlanningState:
    """The shared planning stages, run once on the final map along the trajectory of the whole run."""
    stages = Stages(config.planning, robot.footprint)
    for pose in recorder.poses:
        stages.topdown.visit(pose.xy_m)
    return stages.read(mapper, outcome.observation)
