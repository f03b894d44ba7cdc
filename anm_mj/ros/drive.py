"""A run on a live robot: the loop, recorder and run folder of any other, over ROS 2."""

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anm_mj.config import RunConfig
from anm_mj.evaluation.metrics import Metrics
from anm_mj.events import Observer
from anm_mj.io.manifest import RunFacts
from anm_mj.io.run_folder import RunFolder
from anm_mj.loop_state import LoopState
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.planning.policies.registry import make_policy
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.resume import resume
from anm_mj.ros.connect import connect
from anm_mj.ros.control import Control
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.ros.map_publisher import MapPublisher
from anm_mj.ros.navigation import GoalDriver
from anm_mj.run import run_with
from anm_mj.run_parts import Parts, make_localiser, make_mapper, wrapped_policy

LIVE = "live"
"""Stands in the manifest for what a live robot has not: a scene, a file, a renderer."""
STEPS = 2000
"""Budget of a run that says none."""


@dataclass
class _Followers:
    """Observers that are known only once the robot is connected."""

    those: list[Observer] = field(default_factory=list)

    def on_event(self, event: object) -> bool:
        return any([observer.on_event(event) for observer in self.those])


def drive(
    config: DriveConfig,
    *,
    out: Path | None = None,
    waits: bool = False,
    is_over: Callable[[], bool] = lambda: False,
    observers: Sequence[Observer] = (),
) -> tuple[RunFolder, Metrics]:
    """Explore with a live robot, and write everything about it. Raises AnmError if robot, network, policy, device or
    output folder cannot be used.

    Args:
        config: what to do.
        out: the run folder; None = a new one below ``runs/``.
        waits: whether the robot waits for ``start`` on ``explore/command``.
        is_over: whether the user wants an end, for the waits within a step.
        observers: see :func:`anm_mj.run.run`.
    """
    begin, followers = time.perf_counter(), _Followers()
    state = LoopState(config.planning.patience_steps)
    with _parts(config, observers, followers=followers, state=state, waits=waits, is_over=is_over) as parts:
        return run_with(parts, begin, out=out, observers=(*observers, followers), state=state)


def go_on(
    path: Path,
    *,
    policy: str | None = None,
    waits: bool = False,
    is_over: Callable[[], bool] = lambda: False,
    observers: Sequence[Observer] = (),
) -> tuple[RunFolder, Metrics]:
    """Go on with a run on a live robot that was killed or interrupted, as long as its odometry went on meanwhile.
    ``path`` is its folder, ``policy`` as of :func:`anm_mj.resume.resume`; the other arguments are those of
    :func:`drive`. Raises CheckpointError as :func:`anm_mj.resume.resume`, and AnmError as :func:`drive`.
    """
    state, followers = LoopState(), _Followers()
    assemble = functools.partial(_parts, followers=followers, state=state, waits=waits, is_over=is_over)
    return resume(
        path, policy=policy, observers=(*observers, followers), kind=DriveConfig, assemble=assemble, state=state
    )


@contextmanager
def _parts(
    config: RunConfig, observers: Sequence[Observer] = (), *, followers: _Followers, state: LoopState, **options: Any
) -> Iterator[Parts]:
    """Connect to the robot and put the run together; the robot is stopped at the end."""
    assert isinstance(config, DriveConfig)
    mapper = make_mapper(config)
    footprint = config.ros.footprint
    context = PolicyContext(footprint, config.policy_settings, config.planning, config.seed, None, config.goal)
    explorer = GuardedPolicy(make_policy(config.policy, context), config.policy)
    policy = wrapped_policy(explorer, config, footprint)
    if not isinstance(policy, ReturnToStart):
        policy = ReturnToStart(policy, config.planning, footprint, None)
    waits, asked = options["waits"], options["is_over"]
    with connect(config, asked) as to:
        publisher = MapPublisher(to)
        to.poses.on_pose, to.node.on_look = publisher.tell, publisher.diagnose
        control = Control(to.node, mapper, policy, state, waits=waits)
        publisher.command = lambda: control.last
        to.robot.is_over = lambda: asked() or control.is_over
        control.on_pause = to.robot.rest
        followers.those += [publisher, control]
        if to.navigation is not None:
            to.robot.goals = GoalDriver(to.navigation, to.poses, to.health, state)
        name, localiser = config.ros.namespace or LIVE, make_localiser(config, mapper)
        yield Parts(config, name, to.robot, mapper, localiser, explorer, policy, _facts(config, mapper))


def _facts(config: DriveConfig, mapper: Any) -> RunFacts:
    return RunFacts.unsimulated(
        LIVE,
        scene=config.scene,
        policy=config.policy,
        goal=config.goal,
        seed=config.seed,
        device=mapper.backend.device,
        engine=mapper.backend.name,
        footprint=config.ros.footprint,
    )
