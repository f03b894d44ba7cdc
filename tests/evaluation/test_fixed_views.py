import numpy as np
import pytest

from anm_mj.evaluation import fixed_views as module
from anm_mj.evaluation.fixed_views import compare_with, fixed_views
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.scene.navigable import is_clear
from anm_mj.sim.make_robot import FOOTPRINT
from anm_mj.types import Pose2
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

    def render(self, intrinsics, T_world_camera):
        return next(self.images)


def test_views_depend_on_the_scene_alone_and_are_rendered_once(scene, cache, monkeypatch):
    first = fixed_views(scene, NUM)
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setattr(module, "observe_at", None)
    again = fixed_views(scene, NUM)
    for name, values in vars(first).items():
        np.testing.assert_array_equal(getattr(again, name), values)
    assert all(is_clear(scene, Pose2(*pose), FOOTPRINT) for pose in first.pose.tolist())
    # Both rooms, and all directions.
    assert (first.pose[:, 0] < 2.94).any()
    assert (first.pose[:, 0] > 3.06).any()
    assert np.ptp(first.pose[:, 2]) > np.pi


def test_a_damaged_cache_is_rendered_anew(scene, cache):
    first = fixed_views(scene, NUM)
    next(cache.iterdir()).write_bytes(b"half a file")
    np.testing.assert_array_equal(fixed_views(scene, NUM).depth_mm, first.depth_mm)


def test_what_a_map_lacks_counts_as_wrong(scene, cache):
    views = fixed_views(scene, NUM)
    perfect = [(rgb, depth.astype(np.float32) / 1000.0) for rgb, depth in zip(views.rgb, views.depth_mm, strict=True)]
    assert {view.depth_error_cm for view in compare_with(Renders(perfect), views)} == {0.0}
    nothing = [(rgb, np.full_like(depth, np.nan)) for rgb, depth in perfect]
    assert {view.depth_error_cm for view in compare_with(Renders(nothing), views)} == {100.0}
