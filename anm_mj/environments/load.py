"""Loads environments by scene and task, as dm_control's suite does."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs

from anm_mj.environments.config import explore_config
from anm_mj.environments.task import ExploreTask
from anm_mj.environments.world import RobotWorld
from anm_mj.errors import TaskError
from anm_mj.scene.folder import Scene, load_scene

TASKS = ("explore",)


class ExploreEnvironment(control.Environment):
    """Exploration behind the ``dm_env.Environment`` interface. Close it to free the GL context."""

    def __init__(self, world: RobotWorld, task: ExploreTask) -> None:
        """Put the two together."""
        super().__init__(world, task)

    @property
    def physics(self) -> RobotWorld:
        """The robot in its scene."""
        return self._physics

    @property
    def task(self) -> ExploreTask:
        """What an episode is for."""
        return self._task

    def reward_spec(self) -> specs.BoundedArray:
        """A share of the observable surface."""
        return specs.BoundedArray((), float, 0.0, 1.0, name="reward")

    def close(self) -> None:
        """Free the GL context; may be called again."""
        self.physics.close()


def load_environment(scene: str | Path, task: str = "explore", *, seed: int = 0, **options: Any) -> ExploreEnvironment:
    """An environment in which a robot explores a scene.

    Args:
        scene: name from the catalogue, or path of a scene folder.
        task: one of ``TASKS``.
        seed: of everything random: the starts.
        **options: fields of :class:`~anm_mj.environments.config.ExploreConfig`.

    Returns:
        A ``dm_env.Environment``; :class:`~anm_mj.environments.task.ExploreTask` says what it observes and rewards. It
        builds the simulator at the first ``reset``.

    Raises:
        SceneError: if there is no such scene, or the robot does not fit at the start that was asked for.
        TaskError: if there is no such task or option, or a value is out of range.
    """
    if task not in TASKS:
        raise TaskError(f'There is no task "{task}"; choose one of {", ".join(TASKS)}.')
    if seed < 0:
        raise TaskError(f"The seed is {seed}; give a whole number from 0 up.")
    config = explore_config(**options)
    asked = load_scene(scene)
    shared = _scene(asked.folder.resolve(), asked.hash)
    world = RobotWorld(shared, drive=config.drive, image_px=config.image_px)
    explore = ExploreTask(shared, config, np.random.default_rng(seed))
    return ExploreEnvironment(world, explore)


@functools.lru_cache(maxsize=4)
def _scene(folder: Path, content_hash: str) -> Scene:
    """One object per scene for all environments of a process, for the scene is the key to what is computed from it."""
    del content_hash
    return load_scene(folder)
