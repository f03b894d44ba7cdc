import mujoco
import numpy as np
import pytest

from anm_mj.scene import model_cache
from anm_mj.scene.build import build_model
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from tests.scene.shapes import room

ROBOT = '<mujoco><worldbody><body name="base"><freejoint/><geom size="0.1" mass="1"/></body></worldbody></mujoco>'


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    part = Submesh("walls", room().vertices.astype(np.float32), room().faces.astype(np.int32))
    return write_scene([part], SceneInfo("room", "tests", "CC0"), tmp_path_factory.mktemp("scene") / "room")


@pytest.fixture
def robot():
    return mujoco.MjSpec.from_string(ROBOT)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache that keeps models of scenes of any size."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(model_cache, "MIN_TRIANGLES", 0)
    return tmp_path / "cache" / "anm_mj" / "models"


def _no_compiling(monkeypatch):
    def refuse(*_args, **_kwargs):
        raise AssertionError("compiled although the model was kept")

    monkeypatch.setattr("anm_mj.scene.build.build_spec", refuse)


def test_a_kept_model_is_the_compiled_one(scene, robot, cache, monkeypatch):
    compiled = build_model(scene, robot)
    assert len(list(cache.iterdir())) == 1
    _no_compiling(monkeypatch)
    kept = build_model(scene, robot)
    assert (kept.nbody, kept.ngeom, kept.nq) == (compiled.nbody, compiled.ngeom, compiled.nq)
    assert np.array_equal(kept.geom_pos, compiled.geom_pos)
    assert np.array_equal(kept.mesh_vert, compiled.mesh_vert)
    assert kept.body("robot/base").id == compiled.body("robot/base").id


def test_another_robot_prefix_or_scene_is_another_model(scene, robot, cache):
    build_model(scene, robot)
    build_model(scene, robot, prefix="r2/")
    robot.geoms[0].size[0] = 0.2
    assert build_model(scene, robot, robot_hash="larger").geom_size[-1, 0] == 0.2
    assert build_model(scene, robot).geom_size[-1, 0] == 0.1
    assert len(list(cache.iterdir())) == 3


@pytest.mark.parametrize("damage", [lambda data: data[:1000], lambda data: data[:500] + b"\xff" + data[501:]])
def test_a_damaged_file_is_made_again(scene, robot, cache, monkeypatch, damage):
    build_model(scene, robot)
    (path,) = cache.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    build_model(scene, robot)
    _no_compiling(monkeypatch)
    build_model(scene, robot)


def test_a_cache_that_cannot_be_written_does_no_harm(scene, robot, cache):
    cache.parent.mkdir(parents=True)
    cache.write_text("a file where the folder should be")
    assert build_model(scene, robot).nbody == 2


def test_only_the_models_used_last_are_kept(scene, robot, cache):
    for i in range(model_cache.MAX_MODELS + 2):
        build_model(scene, robot, prefix=f"r{i}/")
    assert len(list(cache.iterdir())) == model_cache.MAX_MODELS


def test_small_scenes_are_not_kept(scene, robot, cache, monkeypatch):
    monkeypatch.setattr(model_cache, "MIN_TRIANGLES", scene.num_triangles + 1)
    build_model(scene, robot)
    assert not cache.exists()
