"""One run, from a configuration to a run folder: puts the stages together and lets ``explore`` loop."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from anm_mj.config import RunConfig, default_steps
from anm_mj.evaluation.ground_truth_cache import cached_ground_truth, reachable_area
from anm_mj.evaluation.metrics import Metrics
from anm_mj.evaluation.oracle.policy import Oracle
from anm_mj.evaluation.pixel_rays import CameraExtrinsics
from anm_mj.explore import Progress, explore
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.recorder import RunRecorder
from anm_mj.io.run_folder import RunFolder
from anm_mj.planning.policies.registry import make_policy, policy_class
from anm_mj.planning.stages import Stages
from anm_mj.protocols import Viewer
from anm_mj.scene.folder import load_scene
from anm_mj.sim.gl import select_backend
from anm_mj.types import Pose2
from anm_mj.utils.memory import malloc_trim
from anm_mj.viz.viewer import NullViewer

ORACLE = "oracle"
"""Name of the policy that knows the scene; it is no plug-in, because no plug-in is told the truth."""


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    viewer: Viewer | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    on_step: Callable[[Progress, RunRecorder, int], None] = lambda progress, recorder, num_steps: None,
    on_survey: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[RunFolder, Metrics]:
    """Explore a scene and write everything about it.

    Args:
        config: what to do.
        out: the run folder; None = a new one below ``runs/``.
        viewer: shows the run while it goes; None = nothing does.
        stop_requested: asked before every step; True ends the run with INTERRUPTED and everything written.
        on_step: told after every step, with the budget.
        on_survey: told how much of the search for what can be seen is done; only at the first run in a scene.

    Raises:
        AnmError: the scene, start, policy, device, renderer or output folder cannot be used; nothing has been written
            then, but for an error in the loop itself.
    """
    begin = time.perf_counter()
    policy_type = None if config.policy == ORACLE else policy_class(config.policy)
    scene = load_scene(config.scene)
    steps = config.steps or scene.budget_steps or default_steps(scene.rooms)
    backend = select_backend()
    # Threads of torch that wait for work by spinning take the cores away from rendering and from other programs: on a
    # busy machine that costs a factor of five. Read by the OpenMP runtime when torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # mujoco and torch are imported from here on: the first because its GL back-end is chosen only now, both because
    # they take seconds that a mistyped option should not cost.
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.sim.make_robot import make_robot

    mapper = NeuralMap(config.mapping, seed=config.seed, device=config.device)
    with make_robot(
        scene,
        start=_start_pose(config),
        drive=config.drive,
        image_px=config.image_px,
        robot=config.robot,
        config=config.model,
        pose=config.pose,
        seed=config.seed,
    ) as robot:
        policy = (
            None if policy_type is None else make_policy(policy_type, config.planning, robot.footprint, config.seed)
        )
        folder = RunFolder.create(out, scene.name, config.policy)
        facts = RunFacts(
            config.scene,
            scene.hash,
            config.robot,
            robot.robot_hash,
            config.policy,
            config.seed,
            mapper.backend.device,
            mapper.engine_name,
            backend.name,
            backend.renderer_string,
            robot.camera_kind,
        )
        folder.write_manifest(manifest(facts, sys.argv))
        folder.write_config(replace(config, steps=steps))
        first = robot.observe()
        camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose)
        truth = cached_ground_truth(scene, robot.footprint, camera, first.pose, on_survey)
        if policy is None:
            policy = Oracle(truth, reachable_area(scene, robot.footprint, first.pose), camera)
        malloc_trim()
        true_view = None if config.pose == "true" else lambda: (robot.pose, robot.T_true_camera)
        with RunRecorder(folder, truth, true_view) as recorder:
            outcome = explore(
                robot,
                mapper,
                policy,
                num_steps=steps,
                recorder=recorder,
                viewer=viewer or NullViewer(),
                stop_requested=stop_requested,
                on_step=lambda progress: on_step(progress, recorder, steps),
            )
            wall_s = time.perf_counter() - begin
            stages = Stages(config.planning, robot.footprint)
            for pose in recorder.poses:
                stages.topdown.visit(pose.xy_m)
            survey = stages.read(mapper, outcome.observation)
            # What the camera holds is room for the mesh and its comparison with the truth.
            robot.close()
            metrics = recorder.finish(outcome.stop_reason, mapper, survey, wall_s=wall_s, loop_s=outcome.loop_s)
            return folder, metrics


def _start_pose(config: RunConfig) -> Pose2 | None:
    if config.start is None:
        return None
    x, y, yaw_deg = config.start
    return Pose2(x, y, math.radians(yaw_deg))
