"""Poses of cameras: in the TUM format, as those of a robot's base, and between the times that are stated."""

import math
from bisect import bisect_left

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation, Slerp

from anm_mj.frames import rigid_transform
from anm_mj.types import Pose2

MATCH_S = 0.02
"""Images and poses with times of their own belong together up to this difference [s]."""


def base_pose(T_world_camera: Float[np.ndarray, "4 4"]) -> Pose2:
    """Pose of a base below a camera: heading of the camera's axis, or of its upper edge if it looks straight down."""
    ahead = T_world_camera[:3, 2] if abs(T_world_camera[2, 2]) < 0.99 else -T_world_camera[:3, 1]
    x, y = T_world_camera[:2, 3].tolist()
    return Pose2(x, y, math.atan2(ahead[1], ahead[0]))


def camera_line(time_s: float, T_world_camera: Float[np.ndarray, "4 4"]) -> str:
    """A camera pose in the TUM format: seconds, position [m], quaternion with the scalar last."""
    return _line(time_s, *T_world_camera[:3, 3], *Rotation.from_matrix(T_world_camera[:3, :3]).as_quat())


def base_line(time_s: float, pose: Pose2) -> str:
    """A base pose in the TUM format, as :func:`camera_line`."""
    half = pose.yaw_rad / 2.0
    return _line(time_s, pose.x_m, pose.y_m, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))


def _line(time_s: float, *values: float) -> str:
    # To the microsecond also where a time is counted from 1970.
    time = f"{time_s:.9g}" if abs(time_s) < 1e4 else f"{time_s:.6f}"
    return " ".join((time, *(f"{value:.9g}" for value in values)))


def bridged(
    times_s: list[float], poses: list[Float[np.ndarray, "4 4"] | None]
) -> tuple[list[Float[np.ndarray, "4 4"]], tuple[int, ...]]:
    """Poses without gaps, and the frames that had none: in a gap they lie between those before and after it.

    Where no frame has any, all are at the origin.
    """
    known = [k for k, pose in enumerate(poses) if pose is not None]
    missing = [k for k, pose in enumerate(poses) if pose is None]
    if not known:
        return [np.eye(4)] * len(poses), tuple(missing)
    filled = [np.eye(4) if pose is None else pose for pose in poses]
    if missing:
        times = np.array(times_s)
        between = at_times(np.array([poses[k] for k in known]), times[known], times[missing])
        for k, pose in zip(missing, between, strict=True):
            filled[k] = pose
    return filled, tuple(missing)


def at_times(
    poses: Float64[np.ndarray, "n 4 4"], times_s: Float64[np.ndarray, " n"], wanted_s: Float64[np.ndarray, " m"]
) -> Float64[np.ndarray, "m 4 4"]:
    """Poses between those of ascending times; before the first and after the last these two."""
    times, first = np.unique(times_s, return_index=True)
    found = np.tile(np.eye(4), (len(wanted_s), 1, 1))
    if len(times) < 2:
        found[:] = poses[0]
        return found
    wanted = np.clip(wanted_s, times[0], times[-1])
    # Only poses about the wanted ones are turned into quaternions.
    low = np.clip(np.searchsorted(times, wanted, "right") - 1, 0, len(times) - 2)
    used = np.unique(np.concatenate((low, low + 1)))
    near, at = poses[first[used]], times[used]
    found[:, :3, :3] = Slerp(at, Rotation.from_matrix(near[:, :3, :3]))(wanted).as_matrix()
    found[:, :3, 3] = np.stack([np.interp(wanted, at, near[:, axis, 3]) for axis in range(3)], axis=1)
    return found


def tum_matrix(xyz_m: Float[np.ndarray, "3"], quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 4"]:
    """A pose from a position [m] and a quaternion with the scalar last; raises ValueError if it is zero."""
    return rigid_transform(Rotation.from_quat(quaternion).as_matrix().ravel(), xyz_m)


def nearest_index(times_s: list[float], time_s: float, within_s: float = MATCH_S) -> int | None:
    """Index of the nearest of times in ascending order; None if it is more than ``within_s`` away."""
    after = bisect_left(times_s, time_s)
    near = range(max(0, after - 1), min(after + 1, len(times_s)))
    nearest = min(near, key=lambda index: abs(times_s[index] - time_s), default=None)
    return None if nearest is None or not abs(times_s[nearest] - time_s) <= within_s else nearest
