"""Compares the pose of every frame with the action before it, and undoes a jump that the map contradicts.

Between two frames the robot moves by one action. A pose that is elsewhere was not driven to: the localisation jumped,
or somebody moved the robot. The map decides which: the depth of the frame fits it from the pose that is said or from
the one that was driven to. A jump that does not fit is undone for this frame and all that follow, so that the map goes
on without a seam.
"""

import logging
import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from anm_mj.control.action_motion import action_motion
from anm_mj.frames import back_project, move_pose, pose_matrix, pose_of_matrix, wrap_angle
from anm_mj.types import Action, Observation, Pose2, SdfQuery

_logger = logging.getLogger(__name__)

JUMP_M = 0.12
"""A pose this far from where the action led has jumped [m]: a refused or short step makes half of it."""
JUMP_RAD = math.radians(15.0)
NUM_POINTS = 512
"""Points of a frame that are held against the map."""
JUDGED_M = 4.0
"""Points farther away than this are not [m]."""


class PoseCheck:
    """Follows the poses of a run and the correction that is in force."""

    def __init__(self) -> None:
        self._last: Pose2 | None = None
        """Of the last frame; None before anybody said where the robot is."""
        self._T_base_camera: Float[np.ndarray, "4 4"] = np.eye(4)
        self._T_fixed_said: Float[np.ndarray, "4 4"] = np.eye(4)

    def without_pose(self, observation: Observation, action: Action | None) -> Observation:
        """A frame with the pose that the action led to which moved the robot since the last frame, None where none did,
        in place of one that is not finite. Before any pose it is a stand-in, see :func:`is_stand_in`.
        """
        there = Pose2(0.0, 0.0, 0.0) if self._last is None else _after(self._last, action)
        # As if it was said: the correction is put on by ``check``.
        said = pose_of_matrix(np.linalg.inv(self._T_fixed_said) @ pose_matrix(there))
        return replace(observation, pose=said, T_world_camera=pose_matrix(said) @ self._T_base_camera)

    def check(
        self, observation: Observation, action: Action | None, sdf_m: SdfQuery | None, *, judges: bool = True
    ) -> Observation:
        """A frame, whose pose is finite, with it as far as it can be believed. ``action`` moved the robot since the
        last frame, None where none did; ``sdf_m`` is the signed distance of the map before this frame [m], None: a jump
        is taken as it is; ``judges`` says whether jumps are looked for.
        """
        last = self._last
        # The first pose that is said is no jump from there, and tells where the camera is mounted.
        if last is None and is_stand_in(observation):
            return observation
        if not np.array_equal(self._T_fixed_said, np.eye(4)):
            observation = moved(observation, self._T_fixed_said)
        self._T_base_camera = np.linalg.inv(pose_matrix(observation.pose)) @ observation.T_world_camera
        if last is not None and judges:
            there, said = _after(last, action), observation.pose
            off_m = math.dist(there.xy_m, said.xy_m)
            off_rad = abs(wrap_angle(said.yaw_rad - there.yaw_rad))
            if off_m > JUMP_M or off_rad > JUMP_RAD:
                T_there_said = pose_matrix(there) @ np.linalg.inv(pose_matrix(said))
                driven = moved(observation, T_there_said)
                undone = sdf_m is not None and _misfit_m(driven, sdf_m) < _misfit_m(observation, sdf_m)
                _logger.warning(
                    "The pose of frame %d lies %.2f m and %.0f degrees from where the last action led; %s.",
                    observation.step,
                    off_m,
                    math.degrees(off_rad),
                    "the map says that the robot is not there, and the jump is undone" if undone else "it is believed",
                )
                if undone:
                    self._T_fixed_said = T_there_said @ self._T_fixed_said
                    observation = driven
        self._last = observation.pose
        return observation


def is_stand_in(observation: Observation) -> bool:
    """Whether the pose of a frame stands for one that nobody has said yet: its camera is at the base, on the floor,
    and looks straight up, as no robot's does.
    """
    return np.array_equal(observation.T_world_camera, pose_matrix(observation.pose))


def moved(observation: Observation, T_new_old: Float[np.ndarray, "4 4"]) -> Observation:
    """A frame whose poses, of base and camera, are carried from an old world frame to a new one."""
    pose = pose_of_matrix(T_new_old @ pose_matrix(observation.pose))
    return replace(observation, pose=pose, T_world_camera=T_new_old @ observation.T_world_camera)


def _after(pose: Pose2, action: Action | None) -> Pose2:
    return pose if action is None else move_pose(pose, *action_motion(action))


def _misfit_m(observation: Observation, sdf_m: SdfQuery) -> float:
    """Mean distance of the frame's points from the surface of the map, as far as the map tells distances [m]."""
    near = np.where(observation.depth_m <= JUDGED_M, observation.depth_m, np.float32(np.nan))
    points = back_project(near, observation.intrinsics, observation.T_world_camera)
    if not len(points):
        return math.inf
    points = points[:: max(len(points) // NUM_POINTS, 1)]
    return float(np.abs(sdf_m(points)).mean())
