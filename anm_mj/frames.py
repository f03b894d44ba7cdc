"""Conversions between frames: SE(2), SE(3), camera axes, world and grid; all of them live here."""

import math

import numpy as np
from jaxtyping import Float, Int

from anm_mj.types import Intrinsics, Pose2

T_GL_CV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes x right, y down, z forward (CV) to x right, y up, z backward (GL, MuJoCo); its own inverse."""


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def move_pose(pose: Pose2, forward_m: float, turn_rad: float) -> Pose2:
    """The pose after moving ``forward_m`` while turning ``turn_rad``: the exact SE(2) exponential of a constant twist.

    Source: Lynch and Park, Modern Robotics, 2017, section 13.4 (odometry).
    """
    half = turn_rad / 2.0
    chord = forward_m * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return Pose2(
        pose.x_m + chord * math.cos(pose.yaw_rad + half),
        pose.y_m + chord * math.sin(pose.yaw_rad + half),
        wrap_angle(pose.yaw_rad + turn_rad),
    )


def pose_matrix(pose: Pose2) -> Float[np.ndarray, "4 4"]:
    """``T_world_base`` of a base on the floor."""
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return np.array([[c, -s, 0.0, pose.x_m], [s, c, 0.0, pose.y_m], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def pose_of_matrix(T_world_base: Float[np.ndarray, "4 4"]) -> Pose2:
    """The pose of a base on the floor: the inverse of :func:`pose_matrix`."""
    yaw = math.atan2(T_world_base[1, 0], T_world_base[0, 0])
    return Pose2(float(T_world_base[0, 3]), float(T_world_base[1, 3]), wrap_angle(yaw))


def relative_pose(origin: Pose2, pose: Pose2) -> Pose2:
    """A pose as a robot at ``origin`` has it: x ahead of it, y to its left."""
    dx, dy = pose.x_m - origin.x_m, pose.y_m - origin.y_m
    c, s = math.cos(origin.yaw_rad), math.sin(origin.yaw_rad)
    return Pose2(c * dx + s * dy, c * dy - s * dx, wrap_angle(pose.yaw_rad - origin.yaw_rad))


def rigid_transform(rotation: Float[np.ndarray, "9"], position_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """A pose of MuJoCo (row-major rotation matrix and position [m]) as a homogeneous transform."""
    T = np.eye(4)
    T[:3, :3] = rotation.reshape(3, 3)
    T[:3, 3] = position_m
    return T


def transform_points(T_a_b: Float[np.ndarray, "4 4"], points_b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Coordinates in frame ``a`` of points in frame ``b``."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def pixel_directions(intrinsics: Intrinsics) -> Float[np.ndarray, "h w 3"]:
    """Rays through all pixel centres in camera axes, scaled to z = 1: planar depth times ray is the point."""
    u = (np.arange(intrinsics.width) + 0.5 - intrinsics.cx) / intrinsics.fx
    v = (np.arange(intrinsics.height) + 0.5 - intrinsics.cy) / intrinsics.fy
    uu, vv = np.meshgrid(u, v)
    return np.stack([uu, vv, np.ones_like(uu)], axis=-1)


def back_project(
    depth_m: Float[np.ndarray, "h w"], intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """World points of all pixels with finite depth, row by row [m]."""
    valid = np.isfinite(depth_m)
    points_camera = pixel_directions(intrinsics)[valid] * depth_m[valid].astype(float)[:, None]
    return transform_points(T_world_camera, points_camera)


def world_to_cell(
    xy_m: Float[np.ndarray, "*n 2"], origin_xy_m: Float[np.ndarray, "2"], resolution_m: float
) -> Int[np.ndarray, "*n 2"]:
    """``[row, col]`` of the cells that contain world points; may lie outside the grid."""
    col_row = np.floor((xy_m - origin_xy_m) / resolution_m).astype(np.int64)
    return col_row[..., ::-1]


def cell_to_world(
    cells: Int[np.ndarray, "n 2"], origin_xy_m: Float[np.ndarray, "2"], resolution_m: float
) -> Float[np.ndarray, "n 2"]:
    """World x, y of the centres of cells ``[row, col]`` [m]."""
    return origin_xy_m + (cells[:, ::-1] + 0.5) * resolution_m
