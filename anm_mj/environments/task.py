"""The exploration task: cover as much surface as possible within a number of steps."""

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
from anm_mj.environments.local_map import CELLS, LocalMap
from anm_mj.environments.physics import RobotPhysics
from anm_mj.environments.reward import IncrementalCoverage, SampleGrid, observable_surface
from anm_mj.environments.starts import sample_start
from anm_mj.errors import TaskError
from anm_mj.evaluation.depth import MAX_DEPTH_M
from anm_mj.frames import wrap_angle
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import require_clear
from anm_mj.sim.make_robot import FOOTPRINT
from anm_mj.types import OCCUPIED, UNKNOWN, Action, Observation, Pose2


def sensed_depth(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Depth in the convention of depth cameras [m]: 0, not NaN or infinite, where nothing was measured in range."""
    # NaN and infinity fail the comparison.
    return np.where(depth_m <= MAX_DEPTH_M, depth_m, np.float32(0.0))


def relative_pose(start: Pose2, pose: Pose2) -> Float32[np.ndarray, "3"]:
    """A pose in the frame of ``start``: x [m], y [m], yaw [rad]."""
    c, s = math.cos(start.yaw_rad), math.sin(start.yaw_rad)
    dx, dy = pose.x_m - start.x_m, pose.y_m - start.y_m
    return np.array([c * dx + s * dy, c * dy - s * dx, wrap_angle(pose.yaw_rad - start.yaw_rad)], np.float32)


class ExploreTask(control.Task):
    """Rewards newly covered surface; STOP terminates an episode, the number of steps truncates it."""

    def __init__(self, scene: Scene, config: ExploreConfig, random: np.random.Generator) -> None:
        """Set up the task.

        Args:
            scene: the world.
            config: of the episodes.
            random: draws the starts.

        Raises:
            SceneError: if the robot does not fit at the start of the configuration.
        """
        self.random = random
        """Draws the starts; set it again to repeat an episode."""
        self.num_steps = config.num_steps or scene.budget_steps or default_steps(scene.rooms)
        """Steps until truncation."""
        self._scene = scene
        self._config = config
        self._fixed_start = None if config.start is None else self.require_clear_start(config.start)
        self._next_start: Pose2 | None = None
        self._surfaces: dict[Pose2 | None, SampleGrid] = {}
        self._stopped = False

    @property
    def coverage(self) -> float:
        """Fraction of the observable surface covered in this episode, in [0, 1]; the first view counts."""
        return self._covered.fraction

    @property
    def view(self) -> Observation:
        """The last observation with true poses; hidden from the learner."""
        return self._view

    def require_clear_start(self, start: tuple[float, float, float]) -> Pose2:
        """The start x [m], y [m], yaw [deg] as a pose.

        Raises:
            SceneError: if the robot does not fit at the pose.
        """
        pose = Pose2(float(start[0]), float(start[1]), wrap_angle(math.radians(start[2])))
        require_clear(self._scene, pose, FOOTPRINT)
        return pose

    def start_next_at(self, start: Pose2 | None) -> None:
        """Set the start of the next episode only; None = as configured."""
        self._next_start = start

    def initialize_episode(self, physics: RobotPhysics) -> None:
        """Place the robot at its start and take the first view."""
        given = self._next_start or self._fixed_start
        self._next_start = None
        self._start = given or sample_start(self._scene, FOOTPRINT, self.random)
        self._stopped = False
        physics.place(self._start)
        self._view = physics.observe()
        if given not in self._surfaces:
            # All random starts lie in one connected area, so they share its observable surface.
            self._surfaces = {given: observable_surface(self._scene, FOOTPRINT, self._view, self._start)}
        self._covered = IncrementalCoverage(self._surfaces[given])
        self._map = LocalMap(FOOTPRINT) if self._config.topdown else None
        self._add_view(physics)

    def before_step(self, action: Any, physics: RobotPhysics) -> None:
        """Set the action of the next step.

        Raises:
            TaskError: an invalid action.
        """
        try:
            chosen = Action(int(action))
        except (TypeError, ValueError) as err:
            choices = ", ".join(f"{choice.value} {choice.name}" for choice in Action)
            raise TaskError(f"{action!r} is no action; give one of {choices}.") from err
        physics.set_control(chosen)
        self._stopped = chosen is Action.STOP

    def after_step(self, physics: RobotPhysics) -> None:
        """Take a view after the action."""
        self._view = physics.observe()
        self._add_view(physics)

    def get_reward(self, physics: RobotPhysics) -> float:
        """Fraction of the observable surface that the last step newly covered, in [0, 1]."""
        del physics
        return self._reward

    def get_termination(self, physics: RobotPhysics) -> float | None:
        """Discount 0 after STOP, 1 at truncation, None within an episode."""
        if self._stopped:
            return 0.0
        return 1.0 if physics.robot.step >= self.num_steps else None

    def action_spec(self, physics: RobotPhysics) -> specs.DiscreteArray:
        """One of the values of :class:`anm_mj.types.Action`."""
        del physics
        return specs.DiscreteArray(len(Action), name="action")

    def get_observation(self, physics: RobotPhysics) -> OrderedDict[str, np.ndarray]:
        """The learner's observation; see ``observation_spec``."""
        del physics
        observation = OrderedDict(
            rgb=self._view.rgb,
            depth=sensed_depth(self._view.depth_m),
            pose=relative_pose(self._start, self._view.pose),
        )
        if self._map is not None:
            observation["topdown"] = self._map.crop(self._view.pose)
        return observation

    def observation_spec(self, physics: RobotPhysics) -> OrderedDict[str, specs.BoundedArray]:
        """Shapes and bounds of the learner's observation.

        rgb: (px, px, 3) uint8. depth: (px, px) float32, planar z [m], 0 where nothing was measured within 10 m.
        pose: (3,) float32, x forward [m], y left [m] and yaw [rad] relative to the start of the episode.
        topdown: (192, 192) int8, cells of 5 cm around the robot, row 0 ahead, column 0 to the left; -1 unknown, 0 free,
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

    def _add_view(self, physics: RobotPhysics) -> None:
        view, true = self._view, physics.robot.true_view()
        self._reward = self._covered.add(true.depth_m, view.intrinsics, true.T_world_camera)
        if self._map is not None:
            self._map.add(view)
