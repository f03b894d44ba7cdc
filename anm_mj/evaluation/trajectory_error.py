"""How far the believed trajectory of a run is from the true one, or from poses that somebody else measured, such as by
motion capture: ATE, RPE, what is left at the end.

Sturm, Engelhard, Endres, Burgard and Cremers, A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012. Beside
the ATE after alignment stands the same without: a map that is consistent and stands askew in the world has an aligned
error of nothing.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.errors import RunFolderError
from anm_mj.frames import wrap_angle
from anm_mj.io.bag_poses import GAP_S, Track
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import FRAME_S
from anm_mj.io.sequence_poses import base_pose
from anm_mj.io.sequence_text import pose_rows

_logger = logging.getLogger(__name__)

RPE_M = 1.0
"""Driven distance over which drift is measured [m]."""
RPE_RAD = math.pi / 2
"""Rotation over which drift is measured [rad]."""
_ROUNDING = 1e-9
"""Nine turns by 10 degrees add up to a quarter turn but for this, and steps to a metre [rad, m]."""
_LEVER_M = 0.02
"""Positions that spread by less about a line, or a point, do not tell how they are turned about it [m]."""
_FEWEST = 3
"""Fewer poses cannot be aligned."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryError:
    """Errors of the camera's believed poses; the fields are those of ``metrics.json``.

    Frames whose pose was not known count in the two shares alone; without any other, errors are None.
    """

    position_rmse_cm: float | None = None
    """Root mean square of the position error in the world, without alignment [cm]."""
    ate_rmse_cm: float | None = None
    """Root mean square of the position error after the rigid alignment that makes it smallest (absolute trajectory
    error) [cm]."""
    rpe_cm_per_m: float | None = None
    """Root mean square of the drift of position over each metre driven [cm]; None for a shorter path."""
    rpe_deg_per_m: float | None = None
    """Root mean square of the drift of rotation over each metre driven [deg]; None for a shorter path."""
    rpe_deg_per_quarter_turn: float | None = None
    """Root mean square of the drift of rotation over each 90 degrees turned [deg]; None for less."""
    final_position_error_cm: float | None = None
    """Error of the last known position [cm]."""
    final_heading_error_deg: float | None = None
    """Error of the heading there [deg]."""
    lost_percent: float
    """Share of the frames whose pose was not known [%]."""
    unmapped_percent: float
    """Share of the frames whose pose was not good enough for the map, the lost ones included [%]."""
    loops_closed: int
    """How often earlier keyframes were moved, because a place was seen again."""


def is_exact(frames: Sequence[FrameRecord]) -> bool:
    """Whether a run knew the true pose of its camera at every frame."""
    return all(not frame.is_lost and np.array_equal(frame.T_world_camera, frame.T_true_camera) for frame in frames)


def trajectory_error(frames: Sequence[FrameRecord]) -> TrajectoryError:
    """The error of a run's trajectory. There is one frame at least."""
    known = [frame for frame in frames if not frame.is_lost]
    if not known:
        return TrajectoryError(**of_all_frames(frames))
    believed = np.array([frame.T_world_camera for frame in known])
    true = np.array([frame.T_true_camera for frame in known])
    error_m = np.linalg.norm(believed[:, :3, 3] - true[:, :3, 3], axis=1)
    T_true_believed = alignment(believed[:, :3, 3], true[:, :3, 3])
    aligned = believed[:, :3, 3] @ T_true_believed[:3, :3].T + T_true_believed[:3, 3]
    # What was driven while the robot was lost counts as driven.
    every, is_known = np.array([frame.T_true_camera for frame in frames]), [not frame.is_lost for frame in frames]
    path = np.cumsum(np.linalg.norm(np.diff(every[:, :3, 3], axis=0, prepend=every[:1, :3, 3]), axis=1))[is_known]
    steps = [every[max(k - 1, 0), :3, :3].T @ every[k, :3, :3] for k in range(len(every))]
    turned = np.cumsum([_angle(step) for step in steps])[is_known]
    over_path, over_turn = _drift(believed, true, path, RPE_M), _drift(believed, true, turned, RPE_RAD)
    last = known[-1]
    heading = wrap_angle(last.pose.yaw_rad - last.true_pose.yaw_rad)
    return TrajectoryError(
        position_rmse_cm=100.0 * _rms(error_m),
        ate_rmse_cm=100.0 * _rms(np.linalg.norm(aligned - true[:, :3, 3], axis=1)),
        rpe_cm_per_m=100.0 * _rms(over_path[:, 0]) if len(over_path) else None,
        rpe_deg_per_m=math.degrees(_rms(over_path[:, 1])) if len(over_path) else None,
        rpe_deg_per_quarter_turn=math.degrees(_rms(over_turn[:, 1])) if len(over_turn) else None,
        final_position_error_cm=100.0 * float(error_m[-1]),
        final_heading_error_deg=math.degrees(abs(heading)),
        **of_all_frames(frames),
    )


def of_all_frames(frames: Sequence[FrameRecord]) -> dict[str, Any]:
    """The fields of :class:`TrajectoryError` in which frames count whose pose was not known."""
    return {
        "lost_percent": 100.0 * float(np.mean([frame.is_lost for frame in frames])),
        "unmapped_percent": 100.0 * float(np.mean([not frame.is_mapped for frame in frames])),
        "loops_closed": sum(frame.closes_loop for frame in frames),
    }


def read_reference(path: Path, max_gap_s: float = GAP_S) -> Track:
    """Camera poses of a TUM file, in a world of their own, read as those of a sequence are; they are interpolated
    between two that lie no farther apart than ``max_gap_s`` [s]. Raises RunFolderError if the file cannot be read, or
    holds no pose.
    """
    try:
        lines = pose_rows(path)
        if not lines:
            raise ValueError("no line holds a time, a position and a quaternion")
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read as poses in TUM format ({err}).") from err
    return Track(str(path), [float(line[0]) for line in lines], [line[1:] for line in lines], gap_s=max_gap_s)


def warn_of_assumed_times(times_s: Sequence[float], reference: Track) -> None:
    """Say so where frames probably have times of the program's [s], because their layout states none, and the reference
    has others.
    """

    def are_counted(values: Sequence[float]) -> bool:
        counts = np.asarray(values) / FRAME_S
        return bool(np.all(np.abs(counts - np.rint(counts)) < 1e-4))

    if are_counted(times_s) and not are_counted(reference.times_s):
        _logger.warning(
            "Frames are whole multiples of 1/30 s apart, as they are where nothing states their times; %s has other "
            "times. If the sequence states none, the errors mean nothing.",
            reference.name,
        )


def reference_error(frames: Sequence[FrameRecord], reference: Track) -> TrajectoryError | None:
    """The error of a tracked trajectory; None where the reference knows fewer than three of its poses.

    The reference is brought into the world of the trajectory by the first pose that both know. Frames whose pose was
    not known count in ``lost_percent`` alone.
    """
    known: list[tuple[FrameRecord, np.ndarray]] = []
    for frame in frames:
        pose = None if frame.is_lost else reference.at(frame.time_s)
        if pose is not None:
            known.append((frame, pose))
    if len(known) < _FEWEST:
        return None
    first, T_reference_first = known[0]
    T_world_reference = first.T_world_camera @ np.linalg.inv(T_reference_first)
    placed = []
    for frame, pose in known:
        T = T_world_reference @ pose
        placed.append(replace(frame, T_true_camera=T, true_pose=base_pose(T)))
    return replace(trajectory_error(placed), **of_all_frames(frames))


def alignment(from_m: Float[np.ndarray, "n 3"], to_m: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, "4 4"]:
    """The rigid motion that brings points as near as possible to others, in the least squares. Where they leave its
    rotation open, as on a line or in one place, that is as small as possible.

    Umeyama, Least-Squares Estimation of Transformation Parameters Between Two Point Patterns, 1991; without scale.
    """
    centre_from, centre_to = from_m.mean(axis=0), to_m.mean(axis=0)
    together = (to_m - centre_to).T @ (from_m - centre_from)
    u, spread, vt = np.linalg.svd(together)
    least = len(from_m) * _LEVER_M**2
    if spread[1] < least:
        # As if a small cross at every point were turned as its counterpart is.
        u, _, vt = np.linalg.svd(together + least * np.eye(3))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    T = np.eye(4)
    T[:3, :3] = u @ mirror @ vt
    T[:3, 3] = centre_to - T[:3, :3] @ centre_from
    return T


def _drift(
    believed: Float[np.ndarray, "n 4 4"], true: Float[np.ndarray, "n 4 4"], along: Float[np.ndarray, " n"], reach: float
) -> Float64[np.ndarray, "k 2"]:
    """Drift in position [m] and rotation [rad] from each frame to the first one that is ``reach`` farther along, if it
    is not as far again: of what lies between, nothing is known.
    """
    ends = np.searchsorted(along, along + (reach - _ROUNDING))
    found = []
    for begin, end in enumerate(ends.tolist()):
        if end >= len(along):
            break
        if along[end] - along[begin] > 2.0 * reach:
            continue
        moved_believed = np.linalg.solve(believed[begin], believed[end])
        moved_true = np.linalg.solve(true[begin], true[end])
        apart = np.linalg.solve(moved_true, moved_believed)
        found.append((float(np.linalg.norm(apart[:3, 3])), _angle(apart[:3, :3])))
    return np.array(found, np.float64).reshape(-1, 2)


def _angle(rotation: Float[np.ndarray, "3 3"]) -> float:
    """Angle of a rotation [rad]."""
    skew = rotation - rotation.T
    sine = 0.5 * math.hypot(skew[2, 1], skew[0, 2], skew[1, 0])
    return math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
