"""A camera in a hand, in a box room whose walls are painted."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anm_mj.frames import pixel_directions
from anm_mj.io.sequence import Frame, Sequence
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import camera_pose, room_depth
from tests.recorded.walk import painted

CAMERA = Intrinsics.from_fov(80, 60, math.radians(60.0))


def pose_at(time_s: float) -> np.ndarray:
    yaw = 0.9 * math.sin(1.5 * time_s) + 0.8
    T = camera_pose(Pose2(-0.7 + 0.4 * time_s, 0.5 * math.sin(1.1 * time_s), yaw))
    T[:3, :3] = T[:3, :3] @ Rotation.from_euler("xz", (-0.35 + 0.2 * math.sin(2.3 * time_s), 0.1)).as_matrix()
    return T


def frame(time_s: float, colour_s: float | None = None) -> Frame:
    T, C = pose_at(time_s), pose_at(time_s if colour_s is None else colour_s)
    depth = room_depth(T, CAMERA).astype(np.float32)
    rgb = painted(C, room_depth(C, CAMERA), pixel_directions(CAMERA))
    return Frame(time_s, lambda: rgb, lambda: depth, T)


@pytest.fixture(scope="session")
def walk() -> Sequence:
    return Sequence(Path("walk"), CAMERA, 0.001, tuple(frame(k / 15.0) for k in range(45)))
