"""Poses that somebody else measured, such as by motion capture, and how far a tracked camera is from them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.trajectory_error import TrajectoryError, of_all_frames, trajectory_error
from anm_mj.io.bag_poses import Track
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence_poses import base_pose
from anm_mj.utils.read_file import read_table

_FEWEST = 3
"""Fewer poses cannot be aligned."""


def read_reference(path: Path) -> Track:
    """Camera poses of a TUM file, in a world of their own. Raises RunFolderError if it cannot be read as such."""
    try:
        lines = read_table(path)
        if lines.ndim != 2 or lines.shape[1] != 8 or not np.isfinite(lines).all():
            raise ValueError("it needs eight numbers in every line: time, position, quaternion")
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read as poses in TUM format ({err}).") from err
    track = Track(str(path))
    for line in lines:
        track.add(float(line[0]), line[1:])
    return track


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
    error = trajectory_error(placed)
    return None if error is None else replace(error, **of_all_frames(frames))
