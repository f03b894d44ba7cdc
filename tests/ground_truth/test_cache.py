import functools
import math

import numpy as np
import pytest

from anm_mj.frames import pose_matrix
from anm_mj.ground_truth import cache as module
from anm_mj.ground_truth.cache import reachable_area
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.scene.folder import Scene
from anm_mj.types import Footprint, Intrinsics, Pose2
from anm_mj.utils.files import cache_folder
from tests.ground_truth.test_observable import CAMERA, T_BASE_CAMERA, box, joined

FOOTPRINT = Footprint(radius_m=0.2, z_min_m=0.05, z_max_m=1.35)
START = Pose2(-1.0, 0.0, 0.0)
cached_ground_truth = functools.partial(module.cached_ground_truth, num_samples=2_000)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Two rooms without a door between them, and a crate whose inside nobody sees."""
    folder = tmp_path_factory.mktemp("rooms")
    vertices, faces = joined(
        box((-2.0, -1.5, 0.0), (2.0, 1.5, 2.5)),
        box((0.45, -1.5, 0.0), (0.55, 1.5, 2.5)),
        box((-1.9, 0.8, 0.1), (-1.3, 1.4, 0.8)),
    )
    np.savez(folder / "geometry.npz", vertices=vertices, faces=faces)
    bounds = np.array([[-2.0, -1.5, 0.0], [2.0, 1.5, 2.5]])
    return Scene("rooms", folder, bounds, len(faces), (START,), True, False, "MIT", "a test", 2, None, "h" * 64)


def test_only_the_room_of_the_start_is_observable(scene):
    truth = cached_ground_truth(scene, FOOTPRINT, CameraExtrinsics(CAMERA, T_BASE_CAMERA), START)

    assert truth.observable is not None
    here = truth.samples[:, 0] < 0.44
    assert truth.observable[here].mean() > 0.9
    assert not truth.observable[~here & (truth.samples[:, 0] > 0.56)].any()


def test_a_start_beyond_the_wall_reaches_the_other_room(scene):
    here = reachable_area(scene, FOOTPRINT, START)
    there = reachable_area(scene, FOOTPRINT, Pose2(1.2, 0.0, 0.0))

    assert not (here.reachable & there.reachable).any()
    assert there.centres(np.flatnonzero(there.reachable.ravel()).astype(np.int32))[:, 0].min() > 0.5


def test_the_second_call_reads_the_cache(scene):
    told = []
    camera = CameraExtrinsics(CAMERA, T_BASE_CAMERA)
    first = cached_ground_truth(scene, FOOTPRINT, camera, START, lambda done, total: told.append(done))
    computed = len(told)

    again = cached_ground_truth(scene, FOOTPRINT, camera, START, lambda done, total: told.append(done))

    assert computed > 0
    assert len(told) == computed
    assert np.array_equal(first.observable, again.observable)
    assert len(list(cache_folder("observable").iterdir())) == 1


@pytest.mark.parametrize("damage", [lambda whole: whole[:100], lambda whole: b"PK\x03\x04" + whole[4:]])
def test_a_damaged_cache_file_is_replaced(scene, damage):
    camera = CameraExtrinsics(CAMERA, T_BASE_CAMERA)
    first = cached_ground_truth(scene, FOOTPRINT, camera, START)
    (kept,) = cache_folder("observable").iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(damage(whole))

    again = cached_ground_truth(scene, FOOTPRINT, camera, START)

    assert np.array_equal(first.observable, again.observable)
    assert kept.read_bytes() == whole


def test_camera_and_start_are_part_of_the_key(scene):
    area = reachable_area(scene, FOOTPRINT, START)
    samples = np.zeros((5, 3), np.float32)
    low = T_BASE_CAMERA.copy()
    low[2, 3] = 0.4
    small = Intrinsics.from_fov(64, 64, math.pi / 2.0)
    other = reachable_area(scene, FOOTPRINT, Pose2(1.2, 0.0, 0.0))
    keys = {
        module.cache_key(scene, samples, area, CameraExtrinsics(CAMERA, T_BASE_CAMERA)),
        module.cache_key(scene, samples, area, CameraExtrinsics(CAMERA, low)),
        module.cache_key(scene, samples, area, CameraExtrinsics(small, T_BASE_CAMERA)),
        module.cache_key(scene, samples, other, CameraExtrinsics(CAMERA, low)),
    }

    assert len(keys) == 4


def test_extrinsics_do_not_depend_on_the_pose(scene):
    area = reachable_area(scene, FOOTPRINT, START)
    samples = np.zeros((5, 3), np.float32)
    poses = (Pose2(0.0, 0.0, 0.0), Pose2(1.3, -0.7, 2.1), Pose2(-20.0, 3.0, -3.0))
    cameras = [CameraExtrinsics.of_view(CAMERA, pose_matrix(pose) @ T_BASE_CAMERA, pose) for pose in poses]

    assert np.allclose(cameras[1].T_base_camera, T_BASE_CAMERA)
    assert len({module.cache_key(scene, samples, area, camera) for camera in cameras}) == 1


def test_without_embree_a_warning_is_logged(scene, monkeypatch, caplog):
    monkeypatch.setattr(module, "embree_installed", lambda: False)

    truth = cached_ground_truth(scene, FOOTPRINT, CameraExtrinsics(CAMERA, T_BASE_CAMERA), START)

    assert truth.observable is None
    assert "embreex" in caplog.text
