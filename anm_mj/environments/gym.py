"""Gymnasium interface of the exploration environment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from dm_env import specs
from gymnasium import spaces
from jaxtyping import UInt8

from anm_mj.environments.environment_config import require_start
from anm_mj.environments.load import load_environment
from anm_mj.errors import TaskError


class ExploreEnv(gymnasium.Env[dict[str, Any], Any]):
    """Wraps :class:`~anm_mj.environments.load.ExploreEnvironment`: same observations, actions and rewards.

    STOP or a robot that can no longer drive terminates an episode, the number of steps truncates it. ``info`` contains
    the ``coverage`` so far (in [0, 1]), whether the last action ``collided``, why the robot can no longer drive
    (``fault``, such as "TOPPLED", else ""), the true ``pose`` in the world (x [m], y [m], yaw [rad]), the name of the
    ``scene``, and the distance to the nearest person (``people_m`` [m], infinite among nobody).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  Gymnasium declares it this way.

    def __init__(
        self,
        scene: str | Path | Sequence[str | Path],
        render_mode: str | None = None,
        *,
        seed: int | None = None,
        **options: Any,
    ) -> None:
        """Load the environment; the first ``reset`` creates simulator and renderer.

        Args:
            scene: name from the catalogue, or path of a scene folder; of several, every episode draws one.
            render_mode: with "rgb_array", ``render`` returns the robot's view.
            seed: of the first ``reset``, where that is given none; None = another one every time.
            **options: fields of :class:`~anm_mj.environments.environment_config.EnvironmentConfig`.

        Raises:
            SceneError: an unknown scene, or a start at which the robot does not fit.
            TaskError: an unknown option or render mode, or a value out of range.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise TaskError(f'There is no render mode "{render_mode}"; choose "rgb_array" or None.')
        self.render_mode = render_mode
        self._first_seed = seed
        self._environment = load_environment(scene, "explore", seed=0 if seed is None else seed, **options)
        self.observation_space = spaces.Dict(
            {
                name: spaces.Box(
                    np.broadcast_to(spec.minimum, spec.shape),
                    np.broadcast_to(spec.maximum, spec.shape),
                    dtype=spec.dtype,
                )
                for name, spec in self._environment.observation_spec().items()
            }
        )
        taken = self._environment.action_spec()
        if isinstance(taken, specs.DiscreteArray):
            self.action_space = spaces.Discrete(taken.num_values)
        else:
            self.action_space = spaces.Box(-1.0, 1.0, taken.shape, np.float32)
        self._begun = self._running = self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: of scenes, starts and the sensor's errors from this episode on; None = continue the present sequence.
            options: ``{"start": (x [m], y [m], yaw [deg])}`` sets the start of this episode.

        Raises:
            TaskError: an unknown option, or an invalid start.
            SceneError: if the scene cannot be built, or the robot does not fit at the start.
            RenderError: if no GL back-end works.
        """
        if seed is None and not self._seeded:
            seed = self._first_seed
        super().reset(seed=seed)
        options = options or {}
        unknown = sorted(set(options) - {"start"})
        if unknown:
            raise TaskError(f'reset has no option "{unknown[0]}"; it has start.')
        task = self._environment.task
        if "start" in options:
            require_start(options["start"])
            task.start_next_at(task.require_clear_start(options["start"]))
        if seed is not None or not self._seeded:
            self._seeded = True
            task.seed(seed if seed is not None else int(self.np_random.integers(1 << 31)), self.np_random)
        timestep = self._environment.reset()
        self._begun = self._running = True
        return dict(timestep.observation), self._info()

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Execute an action. Raises TaskError for an invalid action, and gymnasium.error.ResetNeeded before the first
        ``reset`` and after the end of an episode.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("No episode is running; call reset() first.")
        timestep = self._environment.step(action)
        self._running = not timestep.last()
        terminated = timestep.last() and timestep.discount == 0.0
        truncated = timestep.last() and not terminated
        return dict(timestep.observation), timestep.reward, terminated, truncated, self._info()

    def render(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """The robot's view; None without a render mode. Raises gymnasium.error.ResetNeeded before a ``reset``."""
        if not self._begun:
            raise gymnasium.error.ResetNeeded("There is nothing to see before the first episode; call reset() first.")
        return self._environment.task.view.rgb.copy() if self.render_mode else None

    def close(self) -> None:
        """Free the GL context; may be called again."""
        self._running = False
        self._environment.close()

    def _info(self) -> dict[str, Any]:
        task, result = self._environment.task, self._environment.physics.result
        pose = task.true.pose
        return {
            "coverage": task.coverage,
            "collided": result is not None and result.collided,
            "fault": "" if result is None or result.fault is None else str(result.fault),
            "pose": np.array([pose.x_m, pose.y_m, pose.yaw_rad]),
            "scene": task.scene.name,
            "people_m": task.people_m,
        }
