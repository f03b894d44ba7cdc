"""A recorded sequence becomes a run folder: the map, the mesh, and what the planner would have done."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from anm_mj.config import RunConfig
from anm_mj.events import Decided, Observed, Observer
from anm_mj.io.manifest import RunFacts, manifest
from anm_mj.io.mesh_file import write_mesh
from anm_mj.io.plan_file import PlanRecord, write_plan
from anm_mj.io.run_events import Started
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.sequence import Sequence
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.anm_s.region_stages import RegionStages
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.protocols import Policy
from anm_mj.recording.run_log import RunLog
from anm_mj.run_parts import make_mapper
from anm_mj.types import Footprint, Observation
from anm_mj.utils.files import atomic_write

MESH_RESOLUTION_M = 0.05
RECORDED = "recorded"
"""Stands in the manifest for what a recorded sequence has not: a policy, a robot, a renderer."""


def map_sequence(
    sequence: Sequence,
    config: RunConfig,
    footprint: Footprint,
    *,
    out: Path | None = None,
    shadow: bool = False,
    observers: Collection[Observer] = (),
) -> RunFolder:
    """Map a sequence and write a run folder, without actions and without ground truth.

    Args:
        sequence: Posed RGB-D frames.
        config: Settings of map and planner; ``scene`` is the sequence.
        footprint: The robot that the top-down map is for.
        out: The run folder; None = a new one below ``runs/``.
        shadow: Whether the policy decides at every frame, without being obeyed; its decisions are recorded.
        observers: Hear of the start (:class:`~anm_mj.io.run_events.Started`, with the number of frames for a budget),
            of every frame (:class:`~anm_mj.events.Observed`) and decision (:class:`~anm_mj.events.Decided`); any of
            them may end the run with what there is.

    Raises:
        AnmError: An image or the policy cannot be used, or the folder cannot be written.
    """
    begin = time.perf_counter()
    neural_map = make_mapper(config)
    policy = _shadow_policy(config, footprint) if shadow else None
    name = config.policy if shadow else RECORDED
    folder = RunFolder.create(out, Path(config.scene).resolve().name, name)
    folder.write_manifest(manifest(_facts(config, neural_map, name), sys.argv))
    folder.write_config(config)
    log = RunLog(folder, config.record)
    last: Observation | None = None

    def tell(event: object) -> bool:
        return any([observer.on_event(event) for observer in observers])

    interrupted = tell(Started(folder.path, len(sequence), lambda: None))
    try:
        for observation in sequence.observations():
            if interrupted:
                break
            last = observation
            update = neural_map.integrate(observation)
            log.observation(observation)
            if policy is not None:
                policy.observe(observation)
                plan = policy.plan(neural_map, observation)
                log.plan(observation.step, plan)
                interrupted |= tell(Decided(observation.step, plan))
            interrupted |= tell(Observed(observation, update))
    finally:
        log.close()
    if last is not None:
        _finish(folder, config, neural_map, footprint, log, last)
    write_json(folder.metrics, {"frames": len(log.poses), "wall_s": time.perf_counter() - begin})
    return folder


def _finish(
    folder: RunFolder, config: RunConfig, neural_map: NeuralMap, footprint: Footprint, log: RunLog, last: Observation
) -> None:
    """Map, mesh, top-down map and its picture."""
    from anm_mj.viz.plots import draw_topdown

    with writing(folder.map), atomic_write(folder.map) as partial:
        neural_map.save(partial)
    write_mesh(folder.mesh, neural_map.mesh(MESH_RESOLUTION_M))
    stages = RegionStages(config.planning, footprint)
    for pose in log.poses:
        stages.topdown.visit(pose.xy_m)
    state = stages.read(neural_map, last)
    write_plan(folder.survey, PlanRecord(np.zeros((0, 2)), state.topdown, state.graph, state.regions))
    with writing(folder.topdown_picture):
        draw_topdown(
            folder.topdown_picture,
            state.topdown,
            state.graph,
            state.regions,
            log.poses,
            target_xy_m=log.last_target_xy_m,
            title=f"{Path(config.scene).resolve().name}, {len(log.poses)} recorded frames",
        )


def _shadow_policy(config: RunConfig, footprint: Footprint) -> Policy:
    """The policy without its bootstrap rotation: the recording turns as it turns."""
    settings = config.policy_settings
    if any(field.name == "bootstrap_turns" for field in fields(settings)):
        settings = replace(settings, bootstrap_turns=0)
    return make_policy(config.policy, PolicyContext(footprint, settings, config.planning, config.seed))


def _facts(config: RunConfig, neural_map: NeuralMap, policy: str) -> RunFacts:
    return RunFacts(
        scene=config.scene,
        scene_hash="",
        robot=RECORDED,
        robot_hash="",
        policy=policy,
        seed=config.seed,
        device=neural_map.backend.device,
        engine=neural_map.backend.name,
        gl_backend=RECORDED,
        gl_renderer=RECORDED,
        camera=RECORDED,
        sensor=RECORDED,
        goal=config.goal,
    )
