import math

import numpy as np

from anm_mj.frames import move_pose, pose_matrix
from anm_mj.types import Action, ActionResult, Observation, WheelSpeeds
from anm_mj.utils.raycast import RayCaster
from tests.ground_truth.test_observable import CAMERA, T_BASE_CAMERA


def cast_depth(caster: RayCaster, T_world_camera):
    """Planar depth of ``CAMERA`` at a pose [m]."""
    u, v = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    directions = (rays.reshape(-1, 3) @ T_world_camera[:3, :3].T).astype(np.float32)
    origins = np.tile(T_world_camera[:3, 3].astype(np.float32), (len(directions), 1))
    return caster.lengths(origins, directions).reshape(CAMERA.height, CAMERA.width)


class RayRobot:
    """Drives on the area's cells and sees by ray casting."""

    def __init__(self, truth, area, pose):
        self._rays = RayCaster(truth.vertices, truth.faces)
        self._floor = area
        self.pose = pose
        self._step = 0

    def observe(self):
        T_world_camera = pose_matrix(self.pose) @ T_BASE_CAMERA
        depth_m = cast_depth(self._rays, T_world_camera)
        rgb = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
        return Observation(self._step, 0.1 * self._step, rgb, depth_m, CAMERA, T_world_camera, self.pose)

    def act(self, action):
        self._step += 1
        turn = {Action.TURN_LEFT: 10.0, Action.TURN_RIGHT: -10.0}.get(action, 0.0)
        forward = 0.065 if action is Action.MOVE_FORWARD else 0.0
        pose = move_pose(self.pose, forward, math.radians(turn))
        collided = bool(self._floor.cells(pose.xy_m[None].astype(np.float32))[0] < 0)
        self.pose = self.pose if collided else pose
        return ActionResult(action, collided, WheelSpeeds(0.0, 0.0), 0.0 if collided else forward)
