"""Which images count as found in the map of a run, and which heights and tilts they are looked for with."""

from pathlib import Path

import numpy as np
import pytest

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import Run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.localisation.localiser import PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.localise_images import ImagePose, _tilts
from anm_mj.types import Intrinsics, Pose2
from tests.mapping.ray_room import Room, camera_pose


def estimate(*, usable: bool = True, guessed: bool = False) -> PoseEstimate:
    seen, quality = Room().observe(1.0, 1.0, 0.0), RegistrationQuality(0.0, 0.0, 0)
    return PoseEstimate(seen, 1e-6 * np.eye(6), quality, TrackingState.TRACKING, usable, guessed=guessed)


def test_an_image_whose_pose_nothing_tells_is_not_found() -> None:
    assert ImagePose.of(estimate()).T_world_camera is not None
    assert ImagePose.of(estimate(guessed=True)).T_world_camera is None
    assert ImagePose.of(estimate(usable=False)).T_world_camera is None


def run_of(heights_m: list[float], lost: tuple[int, ...] = ()) -> Run:
    """A run whose camera had these heights, and was lost in some frames."""
    poses = [camera_pose(0.1 * k, 0.0, height_m, 0.3 * k) for k, height_m in enumerate(heights_m)]
    flat = Pose2(0.0, 0.0, 0.0)
    frames = [FrameRecord(k, 0.1 * k, flat, T, flat, T, is_lost=k in lost) for k, T in enumerate(poses)]
    camera = Intrinsics.from_fov(8, 8, 1.0)
    return Run(RunFolder(Path("runs/lost")), camera, (8, 8), tuple(frames), (), (), {}, {})


def test_images_are_looked_for_with_the_most_frequent_tilts_of_the_map_s_camera() -> None:
    rare = [float(k) for k in range(1, 9)]
    found = _tilts(run_of([*rare, 9.0, 9.0, 5.0]))
    np.testing.assert_allclose([T[2, 3] for T in found], [5.0, 9.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0])


def test_a_tilt_of_a_lost_camera_is_none() -> None:
    found = _tilts(run_of([1.0, 7.0, 7.0, 1.0], lost=(1, 2)))
    np.testing.assert_allclose([T[2, 3] for T in found], [1.0])
    with pytest.raises(RunFolderError, match=r"runs/lost holds no frame whose pose was known; give the folder of a"):
        _tilts(run_of([1.0], lost=(0,)))
