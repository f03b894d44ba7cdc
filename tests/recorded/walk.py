"""A short walk with a camera through a box room whose walls are painted, and how its map is judged."""

import math

import numpy as np

from anm_mj.frames import pixel_directions
from anm_mj.types import Intrinsics, Observation, Pose2
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, camera_pose, room_depth

CAMERA = Intrinsics.from_fov(64, 64, math.radians(90.0))
PINHOLE = "32,32,32,32"
STEP_S = 0.4
"""From one frame to the next."""


def painted(T_world_camera, depth_m, directions):
    """A colour for each place on the walls."""
    points = (directions * depth_m[..., None]) @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    shade = 0.5 + 0.22 * np.sin(points @ [5.0, 3.0, 4.0]) + 0.22 * np.sin(points @ [-3.0, 6.0, 2.0])
    return np.repeat((255 * shade).astype(np.uint8)[..., None], 3, axis=2)


def walk(camera=CAMERA, count=12, directions=None):
    """Once around while going ahead; what the pixels look along, (h, w, 3) with z = 1, where it is no pinhole."""
    seen = []
    directions = pixel_directions(camera) if directions is None else directions
    for step in range(count):
        pose = Pose2(-0.9 + 0.15 * step, 0.3 * math.sin(step), step * math.pi / 6.0)
        T = camera_pose(pose)
        depth_m = room_depth(T, directions)
        seen.append(Observation(step, STEP_S * step, painted(T, depth_m, directions), depth_m, camera, T, pose))
    return seen


def to_walls_m(points):
    """Distances of points from the walls [m]."""
    return np.abs(np.minimum(points - ROOM_LOW_M, ROOM_HIGH_M - points)).min(axis=-1)
