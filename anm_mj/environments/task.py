"""Exploration as a task: see as much surface as possible in a number of steps."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs
from jaxtyping import Float32

from anm_mj.config import default_steps
from anm_mj.environments.config import REACH_M, ExploreConfig
from anm_mj.environments.reward import SampleGrid, SeenSurface
from anm_mj.environments.starts import draw_start
from anm_mj.environments.surface import observable_surface
from anm_mj.environments.topdown import CELLS, LocalMap
from anm_mj.environments.world import RobotWorld
from anm_mj.errors import TaskError
from anm_mj.evaluation.depth import MAX_DEPTH_M
from anm_mj.frames import wrap_angle
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import require_clear
from anm_mj.sim.make_robot import FOOTPRINT
from anm_mj.types import OCCUPIED, UNKNOWN, Action, Observation, Pose2


def sensed_depth(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Depth as depth cameras give it: 0 where nothing was hit within the sensor's range, never NaN [m]."""
    # NaN fails the comparison.
    return np.where(depth_m <= MAX_DEPTH_M, depth_m, np.float32(0.0))


def pose_from(start: Pose2, pose: Pose2) -> Float32[np.ndarray, "3"]:
    """A pose in the frame of another: x [m], y [m], yaw [rad]."""
    c, s = math.cos(start.yaw_rad), math.sin(start.yaw_rad)
    dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
    return np.array([c * dx + s * dy, c * dy - s * dx, wrap_angle(pose.yaw_rad - start.yaw_rad)], np.float32)


class ExploreTask(control.Task):
    """Rewards new surface; an episode ends by STOP, or is cut off after a number of steps."""

    def __init__(self, scene: Scene, config: ExploreConfig, random: np.random.Generator) -> None:
        """Set the task up.

        Args:
            scene: the world.
            config: what an episode is like.
            random: draws the starts.

        Raises:
            SceneError: if the robot does not fit at the start that the configuration names.
        """
        self.random = random
        """Draws the starts; set it anew to repeat an episode."""
        self.num_steps = config.num_steps or scene.budget_steps or default_steps(scene.rooms)
        """Steps until an episode is cut off."""
        self._scene = scene
        self._config = config
        self._fixed_start = None if config.start is None else self.clear_start(config.start)
        self._next_start: Pose2 | None = None
        self._surfaces: dict[Pose2 | None, SampleGrid] = {}
        self._stopped = False

    @property
    def coverage(self) -> float:
        """Share of the observable surface seen since the start of the episode, in [0, 1]; the first view counts too."""
        return self._seen.share

    @property
    def view(self) -> Observation:
        """What the robot perceived last, with its true pose in the world; the learner does not see this."""
        return self._view

    def clear_start(self, start: tuple[float, float, float]) -> Pose2:
        """The pose x [m], y [m], yaw [deg].

        Raises:
            SceneError: if the robot does not fit there.
        """
        pose = Pose2(float(start[0]), float(start[1]), wrap_angle(math.radians(start[2])))
        require_clear(self._scene, pose, FOOTPRINT)
        return pose

    def start_next_at(self, start: Pose2 | None) -> None:
        """Where the next episode, and only this, begins; None = where the configuration says."""
        self._next_start = start

    def initialize_episode(self, physics: RobotWorld) -> None:
        """Put the robot at its start and look once."""
        given = self._next_start or self._fixed_start
        self._next_start = None
        self._start = given or draw_start(self._scene, FOOTPRINT, self.random)
        self._stopped = False
        physics.place(self._start)
        self._view = physics.observe()
        if given not in self._surfaces:
            # Starts that are drawn all lie in one area, out of which the same can be seen.
            self._surfaces = {given: observable_surface(self._scene, FOOTPRINT, self._view, self._start)}
        self._seen = SeenSurface(self._surfaces[given])
        self._map = LocalMap(FOOTPRINT) if self._config.topdown else None
        self._take_in_view()

    def before_step(self, action: Any, physics: RobotWorld) -> None:
        """Take an action in.

        Raises:
            TaskError: if it is none.
        """
        try:
            chosen = Action(int(action))
        except (TypeError, ValueError) as err:
            choices = ", ".join(f"{choice.value} {choice.name}" for choice in Action)
            raise TaskError(f"{action!r} is no action; give one of {choices}.") from err
        physics.set_control(chosen)
        self._stopped = chosen is Action.STOP

    def after_step(self, physics: RobotWorld) -> None:
        """Look."""
        self._view = physics.observe()
        self._take_in_view()

    def get_reward(self, physics: RobotWorld) -> float:
        """Share of the observable surface that the last step has brought into view, in [0, 1]."""
        del physics
        return self._new_share

    def get_termination(self, physics: RobotWorld) -> float | None:
        """Discount 0 after STOP, 1 when the episode is cut off, None while it goes on."""
        if self._stopped:
            return 0.0
        return 1.0 if physics.robot.step >= self.num_steps else None

    def action_spec(self, physics: RobotWorld) -> specs.DiscreteArray:
        """One of the values of :class:`anm_mj.types.Action`."""
        del physics
        return specs.DiscreteArray(len(Action), name="action")

    def get_observation(self, physics: RobotWorld) -> OrderedDict[str, np.ndarray]:
        """What the learner sees; see ``observation_spec``."""
        del physics
        observation = OrderedDict(
            rgb=self._view.rgb,
            depth=sensed_depth(self._view.depth_m),
            pose=pose_from(self._start, self._view.pose),
        )
        if self._map is not None:
            observation["topdown"] = self._map.around(self._view.pose)
        return observation

    def observation_spec(self, physics: RobotWorld) -> OrderedDict[str, specs.BoundedArray]:
        """Shapes and bounds of what the learner sees.

        rgb: (px, px, 3) uint8. depth: (px, px) float32, planar z [m], 0 where nothing was hit nearer than 10 m.
        pose: (3,) float32, x forward [m], y left [m] and yaw [rad] relative to the start of the episode.
        topdown: (192, 192) int8, cells of 5 cm about the robot, row 0 ahead, column 0 to the left; -1 unknown, 0 free,
        1 occupied.
        """
        del physics
        px = self._config.image_px
        reach = np.array([REACH_M, REACH_M, math.pi], np.float32)
        spec = OrderedDict(
            rgb=specs.BoundedArray((px, px, 3), np.uint8, 0, 255, name="rgb"),
            depth=specs.BoundedArray((px, px), np.float32, 0.0, MAX_DEPTH_M, name="depth"),
            pose=specs.BoundedArray((3,), np.float32, -reach, reach, name="pose"),
        )
        if self._config.topdown:
            spec["topdown"] = specs.BoundedArray((CELLS, CELLS), np.int8, UNKNOWN, OCCUPIED, name="topdown")
        return spec

    def _take_in_view(self) -> None:
        view = self._view
        self._new_share = self._seen.add(view.depth_m, view.intrinsics, view.T_world_camera)
        if self._map is not None:
            self._map.add(view)
