"""A furnished room in closed form: exact depth, colour and signed distance, without a simulator."""

import math

import numpy as np

from anm_mj.frames import pixel_directions
from anm_mj.types import Intrinsics, Observation, Pose2

ROOM = (np.array([0.0, 0.0, 0.0]), np.array([4.0, 3.0, 2.4]))
TABLE = (np.array([2.6, 1.1, 0.0]), np.array([3.4, 1.9, 0.7]))
LEG = (np.array([1.98, 2.18, 0.0]), np.array([2.02, 2.22, 2.0]))
CAMERA_HEIGHT_M = 1.2


class Room:
    """The inside of a box with boxes standing in it; open to the sky where ``ceiling`` is False."""

    def __init__(self, furniture=(TABLE,), ceiling=True):
        self.furniture = furniture
        self.ceiling = ceiling

    def sdf(self, points):
        low, high = ROOM
        if not self.ceiling:
            high = np.array([high[0], high[1], np.inf])
        distance = np.minimum(points - low, high - points).min(axis=1)
        for box_low, box_high in self.furniture:
            outside = np.maximum(np.maximum(box_low - points, points - box_high), 0.0)
            inside = np.minimum(points - box_low, box_high - points).min(axis=1)
            box = np.where((outside > 0.0).any(axis=1), np.linalg.norm(outside, axis=1), -inside)
            distance = np.minimum(distance, box)
        return distance

    def color(self, points):
        return 0.5 + 0.3 * np.sin(2.0 * points + np.array([0.0, 1.0, 2.0]))

    def cast(self, origin, direction):
        """Ray parameter of the first surface; inf where there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / direction
            low, high = ROOM
            exits = np.maximum((low - origin) * inverse, (high - origin) * inverse)
            if not self.ceiling:
                exits[direction[:, 2] > 0.0, 2] = np.inf
            first = np.nanmin(exits, axis=1)
            above = origin[2] + first * direction[:, 2] > high[2]
            if not self.ceiling:
                # Rays that leave over the walls see the sky.
                first[above] = np.inf
            for box_low, box_high in self.furniture:
                t_low, t_high = (box_low - origin) * inverse, (box_high - origin) * inverse
                enter = np.minimum(t_low, t_high).max(axis=1)
                leave = np.maximum(t_low, t_high).min(axis=1)
                first = np.where((enter < leave) & (enter > 0.0), np.minimum(first, enter), first)
        return first

    def observe(self, x, y, yaw, *, size=64, step=0):
        intrinsics = Intrinsics.from_fov(size, size, math.pi / 2)
        T_world_camera = camera_pose(x, y, CAMERA_HEIGHT_M, yaw)
        direction = pixel_directions(intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T
        t = self.cast(T_world_camera[:3, 3], direction)
        hit = np.isfinite(t)
        rgb = np.full((size * size, 3), 200, np.uint8)
        rgb[hit] = np.rint(255.0 * self.color(T_world_camera[:3, 3] + t[hit, None] * direction[hit])).astype(np.uint8)
        depth = np.where(hit, t, np.inf).astype(np.float32)
        return Observation(
            step,
            0.1 * step,
            rgb.reshape(size, size, 3),
            depth.reshape(size, size),
            intrinsics,
            T_world_camera,
            Pose2(x, y, yaw),
        )

    def turn(self, x, y, count, *, size=64):
        """Views all around from one place."""
        return [self.observe(x, y, math.tau * k / count, size=size, step=k) for k in range(count)]


def camera_pose(x, y, z, yaw):
    """T_world_camera of a level camera that looks along ``yaw``."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[s, 0.0, c, x], [-c, 0.0, s, y], [0.0, -1.0, 0.0, z], [0.0, 0.0, 0.0, 1.0]])
