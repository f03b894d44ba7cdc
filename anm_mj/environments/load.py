"""Loads environments by scene and task, as dm_control's suite does."""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs

from anm_mj.environments.environment_config import explore_config
from anm_mj.environments.physics import RobotPhysics
from anm_mj.environments.task import ExploreTask
from anm_mj.errors import TaskError
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.footprint import footprint_of

TASKS = ("explore",)


class ExploreEnvironment(control.Environment):
    """Exploration as a ``dm_env.Environment``. Close it to free the GL context."""

    @property
    def physics(self) -> RobotPhysics:
        """The simulated robot."""
        return self._physics

    @property
    def task(self) -> ExploreTask:
        """Episodes, observations and rewards."""
        return self._task

    def reward_spec(self) -> specs.Array:
        """Bounds of the reward: a share of the observable surface in [0, 1], square metres, or bits."""
        return self._task.reward_spec()

    def close(self) -> None:
        """Free the GL context; may be called again."""
        self.physics.close()


def load_environment(
    scene: str | Path | Sequence[str | Path], task: str = "explore", *, seed: int = 0, **options: Any
) -> ExploreEnvironment:
    """An environment in which a robot explores a scene. Returns a ``dm_env.Environment``;
    :class:`~anm_mj.environments.task.ExploreTask` defines observations and rewards. The first ``reset`` creates the
    simulator.

    Args:
        scene: name from the catalogue, or path of a scene folder; of several, every episode draws one.
        task: one of ``TASKS``.
        seed: of the random starts and the sensor's errors.
        **options: fields of :class:`~anm_mj.environments.environment_config.EnvironmentConfig`.

    Raises:
        SceneError: an unknown scene, or a start at which the robot does not fit.
        TaskError: an unknown task or option, a value out of range, or no scene.
        RobotError: the robot cannot be read.
    """
    if task not in TASKS:
        raise TaskError(f'There is no task "{task}"; choose one of {", ".join(TASKS)}.')
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise TaskError(f"The seed is {seed!r}; give a whole number from 0 up.")
    config = explore_config(**options)
    names = [scene] if isinstance(scene, str | Path) else list(scene)
    if not names:
        raise TaskError("The list of scenes is empty; give at least one.")
    loaded = [load_scene(name) for name in names]
    scenes = tuple(_shared_scene(one.folder.resolve(), one.hash) for one in loaded)
    simulation = config.simulation
    return ExploreEnvironment(RobotPhysics(simulation), ExploreTask(scenes, config, footprint_of(simulation), seed))


@functools.lru_cache(maxsize=64)
def _shared_scene(folder: Path, content_hash: str) -> Scene:
    """One object per scene for all environments of a process: caches of derived data use it as their key."""
    return load_scene(folder)
