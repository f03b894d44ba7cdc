"""Faults of a camera and of its localisation, put on exact or noisy observations from a frame on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anm_mj.errors import RobotError
from anm_mj.frames import pose_matrix
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Observation, Pose2

OUTLIERS_M = 0.2, 10.0
"""Outliers have any depth in this range [m]."""
JUMP_M = 0.2
"""Length of a jump of the pose, to the robot's left [m]."""


class SensorFaults:
    """Puts the fault that the settings name on every frame from ``fault_step`` on."""

    def __init__(self, config: SensorConfig, seed: int) -> None:
        """Start before the first frame.

        Args:
            config: names the fault.
            seed: of what is drawn.
        """
        self._config = config
        self._seed = seed
        self._frozen: Observation | None = None
        self._jump: np.ndarray | None = None

    def put_on(self, seen: Observation) -> Observation:
        """The observation with the fault.

        Raises:
            RobotError: the fault is a camera that fails.
        """
        fault = self._config.fault
        if fault == "none" or seen.step < self._config.fault_step:
            self._frozen = seen
            return seen
        generator = np.random.default_rng([self._seed, 11, seen.step])
        share = self._config.usual_fault_share
        if fault in ("nan", "zero", "infinite"):
            value = {"nan": np.nan, "zero": 0.0, "infinite": np.inf}[fault]
            return replace(seen, depth_m=np.full_like(seen.depth_m, value))
        if fault == "black":
            return replace(seen, rgb=np.zeros_like(seen.rgb))
        if fault == "frozen":
            last = self._frozen or seen
            self._frozen = last
            return replace(seen, rgb=last.rgb, depth_m=last.depth_m)
        if fault == "lost":
            if generator.random() >= share:
                return seen
            return replace(seen, rgb=np.zeros_like(seen.rgb), depth_m=np.full_like(seen.depth_m, np.nan))
        if fault == "outliers":
            hit = generator.random(seen.depth_m.shape) < share
            wrong = generator.uniform(*OUTLIERS_M, seen.depth_m.shape).astype(np.float32)
            return replace(seen, depth_m=np.where(hit, wrong, seen.depth_m))
        if fault == "pose-jump":
            return self._jumped(seen)
        if fault == "pose-nan":
            nowhere = Pose2(float("nan"), float("nan"), float("nan"))
            return replace(seen, pose=nowhere, T_world_camera=np.full((4, 4), np.nan))
        if fault == "resized":
            half = replace(seen.intrinsics, width=seen.intrinsics.width // 2, height=seen.intrinsics.height // 2)
            rows, cols = half.height, half.width
            return replace(seen, rgb=seen.rgb[:rows, :cols], depth_m=seen.depth_m[:rows, :cols], intrinsics=half)
        raise RobotError("The camera does not answer.")

    def is_stale(self, seen: Observation) -> bool:
        """Whether the image of a frame is an older one's."""
        return self._config.fault == "frozen" and seen.step >= self._config.fault_step

    def _jumped(self, seen: Observation) -> Observation:
        if self._jump is None:
            T_base_jumped = np.eye(4)
            T_base_jumped[1, 3] = JUMP_M
            T_world_base = pose_matrix(seen.pose)
            self._jump = T_world_base @ T_base_jumped @ np.linalg.inv(T_world_base)
        x, y, _ = self._jump[:3, :3] @ np.array([seen.pose.x_m, seen.pose.y_m, 0.0]) + self._jump[:3, 3]
        pose = Pose2(float(x), float(y), seen.pose.yaw_rad)
        return replace(seen, pose=pose, T_world_camera=self._jump @ seen.T_world_camera)
