"""The exploration task: cover as much surface as possible within a number of steps, and what an action is worth."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs
from jaxtyping import Float32

from anm_mj.environments.actions import action_spec, read_action
from anm_mj.environments.environment_config import REACH_M, EnvironmentConfig
from anm_mj.environments.local_map import CELLS, MAX_DISTANCE_M, LocalMap
from anm_mj.environments.physics import RobotPhysics
from anm_mj.environments.surface_coverage import IncrementalCoverage, SampleGrid, observable_surface
from anm_mj.frames import relative_pose, wrap_angle
from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M, back_project_reduced, reduce_depth
from anm_mj.scene.budget import default_steps
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import require_clear, sample_start
from anm_mj.types import OCCUPIED, UNKNOWN, Action, Footprint, Pose2


def sensed_depth(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Depth in the convention of depth cameras [m]: 0, not NaN or infinite, where nothing was measured in range."""
    # NaN and infinity fail the comparison.
    return np.where(depth_m <= MAX_DEPTH_M, depth_m, np.float32(0.0))


class ExploreTask(control.Task):
    """Rewards the growth, from view to view, of what is known.

    ``surface``: the newly covered fraction of the observable surface, in [0, 1]. ``area``: newly observed area of the
    top-down map [m2]. ``information``: what the occupancy grid gained [bits]; less than zero where a view contradicts
    it. STOP or a robot that can no longer drive terminates an episode, the number of steps truncates it.
    """

    def __init__(self, scenes: Sequence[Scene], config: EnvironmentConfig, footprint: Footprint, seed: int) -> None:
        """Set up the task; of several scenes, every episode draws one. Raises SceneError if the robot does not fit at
        the start of the configuration.
        """
        self.seed(seed)
        self._scenes = scenes
        self.scene = scenes[0]
        """The scene of the present episode."""
        self._config = config
        self._footprint = footprint
        self._fixed_start = None if config.start is None else self.require_clear_start(config.start)
        self._next_start: Pose2 | None = None
        self._surfaces: dict[tuple[int, Pose2 | None], SampleGrid] = {}
        self._stopped = False
        self._steps = 0

    def seed(self, seed: int, random: np.random.Generator | None = None) -> None:
        """Begin the sequence of episodes of a seed, that of the sensor's errors, which differ from episode to episode.
        ``random`` draws scenes and starts; None = from the seed.
        """
        self.random = np.random.default_rng(seed) if random is None else random
        """Draws scenes and starts."""
        self._noise = np.random.default_rng([seed, 13])

    @property
    def num_steps(self) -> int:
        """Steps until truncation, in the scene of the present episode."""
        return self._config.num_steps or min(default_steps(self.scene), self._config.max_steps)

    @property
    def coverage(self) -> float:
        """Fraction of the observable surface covered in this episode, in [0, 1]; the first view counts."""
        return self._covered.fraction

    @property
    def people_m(self) -> float:
        """Distance between the robot's body and the nearest person's [m]; infinite among nobody."""
        people = self.true.people
        return math.inf if people is None else people.nearest_m

    def require_clear_start(self, start: tuple[float, float, float]) -> Pose2:
        """The start x [m], y [m], yaw [deg] as a pose. Raises SceneError if the robot does not fit at the pose."""
        pose = Pose2(float(start[0]), float(start[1]), wrap_angle(math.radians(start[2])))
        for scene in self._scenes:
            require_clear(scene, pose, self._footprint)
        return pose

    def start_next_at(self, start: Pose2 | None) -> None:
        """Set the start of the next episode only; None = as configured."""
        self._next_start = start

    def initialize_episode(self, physics: RobotPhysics) -> None:
        """Place the robot at its start and take the first view."""
        given = self._next_start or self._fixed_start
        self._next_start = None
        which = int(self.random.integers(len(self._scenes))) if len(self._scenes) > 1 else 0
        self.scene = self._scenes[which]
        self._start = given or sample_start(self.scene, self._footprint, self.random)
        self._stopped, self._steps = False, 0
        physics.place(self.scene, self._start, int(self._noise.integers(1 << 31)))
        self._look(physics)
        # All random starts lie in one connected area, so they share its observable surface.
        key = which, given
        if key not in self._surfaces:
            if given is not None:  # Starts that were given may differ in every episode.
                self._surfaces = {key: grid for key, grid in self._surfaces.items() if key[1] is None}
            self._surfaces[key] = observable_surface(self.scene, self._footprint, self.view, self._start)
        self._covered = IncrementalCoverage(self._surfaces[key])
        config = self._config
        needs_map = config.topdown or config.distance or config.reward != "surface"
        self._map = LocalMap(self._footprint) if needs_map else None
        self.known = 0.0
        """What the map knows so far, in the unit of the reward."""
        self._add_view()

    def before_step(self, action: Any, physics: RobotPhysics) -> None:
        """Set the action of the next step. Raises TaskError for an invalid action."""
        chosen = read_action(action, self._config.actions, self._config.stop)
        physics.set_control(chosen)
        self._stopped = chosen is Action.STOP

    def after_step(self, physics: RobotPhysics) -> None:
        """Take a view after the action."""
        self._steps += not self._stopped
        self._look(physics)
        self._add_view()

    def get_reward(self, physics: RobotPhysics) -> float:
        """What the last step brought."""
        return self._last_reward

    def reward_spec(self) -> specs.Array:
        """Bounds of the reward."""
        if self._config.reward == "information":
            return specs.Array((), float, name="reward")
        most = 1.0 if self._config.reward == "surface" else np.inf
        return specs.BoundedArray((), float, 0.0, most, name="reward")

    def get_termination(self, physics: RobotPhysics) -> float | None:
        """Discount 0 after STOP and where the robot can no longer drive, 1 at truncation, None within an episode."""
        if self._stopped or (physics.result is not None and physics.result.fault is not None):
            return 0.0
        return 1.0 if self._steps >= self.num_steps else None

    def action_spec(self, physics: RobotPhysics) -> specs.Array:
        """A value of :class:`anm_mj.types.Action`, one of its moves, or a velocity as shares of the highest one."""
        return action_spec(self._config.actions, self._config.stop)

    def get_observation(self, physics: RobotPhysics) -> OrderedDict[str, np.ndarray]:
        """The learner's observation; see ``observation_spec``."""
        here = relative_pose(self._start, self.view.pose)
        observation = OrderedDict(
            rgb=self.view.rgb,
            depth=sensed_depth(self.view.depth_m),
            pose=np.array([here.x_m, here.y_m, here.yaw_rad], np.float32),
        )
        if self._map is not None and self._config.topdown:
            observation["topdown"] = self._map.crop(self.view.pose)
        if self._map is not None and self._config.distance:
            observation["distance"] = self._map.distance(self.view.pose)
        return observation

    def observation_spec(self, physics: RobotPhysics) -> OrderedDict[str, specs.BoundedArray]:
        """Shapes and bounds of the learner's observation.

        rgb: (px, px, 3) uint8. depth: (px, px) float32, planar z [m], 0 where nothing was measured within 10 m.
        pose: (3,) float32, x forward [m], y left [m] and yaw [rad] relative to the start of the episode.
        topdown: (192, 192) int8, cells of 5 cm around the robot, row 0 ahead, column 0 to the left; -1 unknown, 0 free,
        1 occupied. distance: (192, 192) float32, signed distance to the nearest obstacle in the same cells [m], limited
        to 2 m.
        """
        px = self._config.image_px
        reach = np.array([REACH_M, REACH_M, math.pi], np.float32)
        spec = OrderedDict(
            rgb=specs.BoundedArray((px, px, 3), np.uint8, 0, 255, name="rgb"),
            depth=specs.BoundedArray((px, px), np.float32, 0.0, MAX_DEPTH_M, name="depth"),
            pose=specs.BoundedArray((3,), np.float32, -reach, reach, name="pose"),
        )
        if self._config.topdown:
            spec["topdown"] = specs.BoundedArray((CELLS, CELLS), np.int8, UNKNOWN, OCCUPIED, name="topdown")
        if self._config.distance:
            limit = MAX_DISTANCE_M
            spec["distance"] = specs.BoundedArray((CELLS, CELLS), np.float32, -limit, limit, name="distance")
        return spec

    def _look(self, physics: RobotPhysics) -> None:
        self.view = physics.robot.observe()
        """The last observation, with the poses that the robot believes; hidden from the learner."""
        self.true = physics.robot.true_view()
        """What it was truly made of; hidden from the learner."""

    def _add_view(self) -> None:
        depth = reduce_depth(self.true.depth_m)
        new = self._covered.add(back_project_reduced(depth, self.view.intrinsics, self.true.T_world_camera))
        if self._map is not None:
            self._map.add(self.view)
        kind, before = self._config.reward, self.known
        if self._map is None or kind == "surface":
            self._last_reward = new
        else:
            self.known = self._map.area_m2 if kind == "area" else self._map.information_bits
            self._last_reward = self.known - before
