import numpy as np
import pytest

from anm_mj.evaluation import fixed_views as module
from anm_mj.evaluation.fixed_views import fixed_views
from anm_mj.evaluation.view_quality import compare_views
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.scene.navigable import is_clear
from anm_mj.sim import camera_factory
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.ray_camera import MujocoRayCamera
from anm_mj.types import DEFAULT_FOOTPRINT
from tests.scene.small import make_small_scene

NUM = 12


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_small_scene(tmp_path_factory.mktemp("scene") / "small")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "anm_mj" / "fixed_views"


class Renders(NeuralMap):
    """A map that answers with given images, one after the other."""

    def __init__(self, images):
        self.images = iter(images)

    def render(self, intrinsics, T_world_camera, max_depth_m):
        return next(self.images)


def test_views_depend_on_the_scene_alone_and_are_rendered_once(scene, cache, monkeypatch):
    first = fixed_views(scene, NUM)
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setattr(module, "observe_at", None)
    again = fixed_views(scene, NUM)
    for one, other in zip(first, again, strict=True):
        for name, values in vars(one).items():
            np.testing.assert_array_equal(getattr(other, name), values)
    poses = [view.pose for view in first]
    assert all(is_clear(scene, pose, DEFAULT_FOOTPRINT) for pose in poses)
    # Both rooms, and all directions.
    assert min(pose.x_m for pose in poses) < 2.94
    assert max(pose.x_m for pose in poses) > 3.06
    assert np.ptp([pose.yaw_rad for pose in poses]) > np.pi


def test_each_kind_of_camera_has_views_of_its_own(scene, cache, monkeypatch):
    for count, kind in enumerate((GlCamera.kind, MujocoRayCamera.kind), start=1):
        monkeypatch.setattr(camera_factory, "camera_kind", lambda *_, kind=kind: kind)
        fixed_views(scene, 2)
        assert len(list(cache.iterdir())) == count


def test_a_damaged_cache_is_rendered_again(scene, cache):
    first = fixed_views(scene, NUM)
    next(cache.iterdir()).write_bytes(b"half a file")
    for one, other in zip(first, fixed_views(scene, NUM), strict=True):
        np.testing.assert_array_equal(other.depth_m, one.depth_m)


def test_what_a_map_lacks_counts_as_wrong(scene, cache):
    views = fixed_views(scene, NUM)
    perfect = [(view.rgb, view.depth_m) for view in views]
    nothing = [(rgb, np.full_like(depth, np.nan)) for rgb, depth in perfect]
    for rendered, error_cm in ((perfect, 0.0), (nothing, 100.0)):
        found = [quality for _, _, _, quality in compare_views(Renders(rendered), views, NUM)]
        assert len(found) == NUM
        assert {quality.depth_error_cm for quality in found} == {error_cm}
