"""Builds the parts of a run from its configuration, in one place for new, resumed and continued runs."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from anm_mj.checkpoint.known_classes import KnownClasses
from anm_mj.config import RunConfig
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.events import Observer
from anm_mj.ground_truth.cache import cached_ground_truth, reachable_area
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.io.manifest import RunFacts
from anm_mj.io.run_events import Surveying
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import LookingAround
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.planning.policies.registry import make_policy, needs_truth, policy_class
from anm_mj.planning.policies.return_to_certainty import ReturnToCertainty
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.prior_run import PriorRun
from anm_mj.protocols import Policy, Robot
from anm_mj.scene.budget import default_steps
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.navigable import sample_start
from anm_mj.sim.gl import GlBackend, select_backend
from anm_mj.types import Footprint, TrueView
from anm_mj.utils.memory import use_one_heap

if TYPE_CHECKING:
    from anm_mj.localisation.field_localiser import FieldLocaliser
    from anm_mj.mapping.neural_map import NeuralMap
    from anm_mj.sim.sim_robot import SimRobot


@runtime_checkable
class RunRobot(Robot, Protocol):
    """A robot that a run closes at its end."""

    def close(self) -> None:
        """Free what it holds; may be called again."""
        ...


@dataclass(frozen=True)
class Parts:
    """What a run is put together from."""

    config: RunConfig
    """With the budget filled in."""
    name: str
    """Of the scene, or of what stands for it; the run folder is named after it."""
    robot: RunRobot
    mapper: NeuralMap
    localiser: FieldLocaliser | None
    """Where poses come from localisation."""
    explorer: GuardedPolicy
    """The policy that the configuration names."""
    policy: Policy
    """The same, with what the run adds to it."""
    facts: RunFacts
    truth: Callable[[], SceneTruth] | None = None
    """For the recorder, and for policies that declare that they need it; it is built when it is first asked for. None
    where nobody knows it."""
    true_view: Callable[[], TrueView] | None = None
    """Gives true poses and depth; None where observations hold them, or nobody knows them."""

    @property
    def known(self) -> KnownClasses:
        """The classes that the state of the run may have: the package's own, and those of the user's policy."""
        return KnownClasses(policy_class(self.config.policy).__module__)

    @property
    def surface(self) -> GroundTruth | None:
        """The true surface; None where nobody knows it."""
        return None if self.truth is None else self.truth().surface


@contextmanager
def make_parts(config: RunConfig, observers: Sequence[Observer] = (), prior: PriorRun | None = None) -> Iterator[Parts]:
    """Put a run together; the robot is closed at the end. ``observers`` hear of the search for the observable surface;
    ``prior`` None = it begins with nothing, or with a checkpoint. Raises AnmError as :func:`run` does.
    """
    scene = load_scene(config.scene)
    steps = config.steps or default_steps(scene, config.budget)
    config = replace(config, steps=steps)
    if prior is not None:
        prior.compare_scene(config.scene, scene.hash)
        config = prior.config(config)
    use_one_heap()
    backend = select_backend()
    mapper = make_mapper(config)
    if prior is not None:
        prior.begin(mapper)
    from anm_mj.sim.make_robot import make_robot

    knows_start = not config.unknown_start
    with make_robot(scene, config, knows_start=knows_start, anticipates=True, forgets_textures=True) as robot:
        if config.unknown_start and config.start is None:
            config = _somewhere(config, scene, robot)
        truth = functools.cache(lambda: _true_scene(scene, robot, steps, observers))
        told = truth() if needs_truth(config.policy) else None
        context = PolicyContext(
            robot.footprint, config.policy_settings, config.planning, config.seed, told, config.goal
        )
        explorer = GuardedPolicy(make_policy(config.policy, context), config.policy)
        if prior is not None:
            explorer.continue_from(prior.found(config.policy), mapper)
        facts = _facts(config, scene, robot, mapper, backend, prior)
        localiser = make_localiser(config, mapper)
        policy = wrapped_policy(explorer, config, robot.footprint)
        # With a wrong stamp, the camera was not where its pose says.
        true_poses = config.pose == "true" and config.sensor.stamp_error_s == 0.0
        exact = true_poses and not config.sensor.misses and not config.people.num_bodies
        true_view = None if exact else robot.true_view
        yield Parts(config, scene.name, robot, mapper, localiser, explorer, policy, facts, truth, true_view)


# The next functions import the map and mujoco: a mistyped option should not cost the time that this takes, and mujoco
# must not be imported before its GL back-end is chosen.


def make_mapper(config: RunConfig) -> NeuralMap:
    """The empty map of a run, or of a recorded sequence. Raises MapError if the device or the engine is absent."""
    # Threads of torch that spin while they wait for work take the cores away from rendering and from other programs; on
    # a busy machine that costs a factor of five. The OpenMP runtime reads this when torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from anm_mj.mapping.neural_map import NeuralMap

    return NeuralMap(config.mapping, seed=config.seed, device=config.device)


def make_localiser(config: RunConfig, mapper: NeuralMap) -> FieldLocaliser | None:
    """What finds the poses of a robot on wheels in its map; None where poses are taken as they come. Raises MapError if
    the engine of the map cannot localise.
    """
    if config.pose != "slam":
        return None
    from anm_mj.localisation.field_localiser import FieldLocaliser

    return FieldLocaliser(
        mapper, config.localisation, seed=config.seed, planar=True, odometry=True, lost=config.unknown_start
    )


def make_tracker(config: RunConfig, mapper: NeuralMap, *, has_poses: bool) -> FieldLocaliser:
    """What finds the poses of a freely moving camera; ``has_poses``: observations tell its motion roughly."""
    from anm_mj.io.sequence_poses import base_pose
    from anm_mj.localisation.field_localiser import FieldLocaliser

    return FieldLocaliser(
        mapper, config.localisation, seed=config.seed, planar=False, odometry=has_poses, base_pose=base_pose
    )


def _somewhere(config: RunConfig, scene: Scene, robot: SimRobot) -> RunConfig:
    """Place the robot where the seed says; the configuration with that start."""
    start = sample_start(scene, robot.footprint, np.random.default_rng([config.seed, 31]))
    robot.restart(start)  # People keep away from where the robot begins.
    return replace(config, start=(start.x_m, start.y_m, math.degrees(start.yaw_rad)))


def _true_scene(scene: Scene, robot: SimRobot, budget_steps: int, observers: Sequence[Observer]) -> SceneTruth:
    """The true surface with its observable part; the search for that part takes minutes at the first run in a scene."""

    def tell(done: int, total: int) -> None:
        for observer in observers:
            observer.on_event(Surveying(done, total))

    first, start = robot.observe(), robot.pose
    camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose, first.range_m)
    surface = cached_ground_truth(scene, robot.footprint, camera, start, tell)
    return SceneTruth(surface, reachable_area(scene, robot.footprint, start), camera, budget_steps)


def wrapped_policy(explorer: Policy, config: RunConfig, footprint: Footprint) -> Policy:
    """A policy with the look around of a continued run, and with the returns to certainty and to the start."""
    policy = explorer if config.continue_from is None else LookingAround(explorer)
    if config.pose == "slam" and config.planning.uncertainty_aware:
        policy = ReturnToCertainty(policy, config.planning)
    if not config.return_to_start:
        return policy
    assert config.steps is not None
    return ReturnToStart(policy, config.planning, footprint, config.steps)


def _facts(
    config: RunConfig, scene: Scene, robot: SimRobot, mapper: NeuralMap, backend: GlBackend, prior: PriorRun | None
) -> RunFacts:
    return RunFacts(
        config.scene,
        scene.hash,
        config.robot,
        robot.robot_hash,
        config.policy,
        config.goal,
        config.seed,
        mapper.backend.device,
        mapper.backend.name,
        backend.name,
        backend.renderer_string,
        robot.camera_kind,
        config.sensor.name,
        config.people.number,
        robot.footprint,
        config.reality,
        None if prior is None else prior.provenance,
    )
