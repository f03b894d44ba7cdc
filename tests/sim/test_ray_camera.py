"""Cameras that cast rays, against the one that draws."""

import logging
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RenderError
from anm_mj.scene.build import build_spec
from anm_mj.scene.folder import load_scene
from anm_mj.sim.camera_factory import Camera, camera_kind, make_camera
from anm_mj.sim.gl import GlBackend
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.mipmap import MipmapTextures
from anm_mj.sim.ray_camera import EmbreeCamera, MujocoRayCamera
from anm_mj.utils.raycast import embree_installed

_OFF = GlBackend("off", "", (("egl", "no display"),))
_SOFTWARE = GlBackend("egl", "llvmpipe (LLVM 15)", ())
needs_embree = pytest.mark.skipif(not embree_installed(), reason="embreex is not installed")


@pytest.fixture(scope="module")
def home():
    scene = load_scene("home")
    spec = build_spec(scene)
    pose = scene.starts[0]
    right = [np.sin(pose.yaw_rad), -np.cos(pose.yaw_rad), 0.0]
    spec.worldbody.add_camera(name="camera", fovy=90.0, pos=[pose.x_m, pose.y_m, 1.25], quat=_quat(right))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _quat(right: list[float]) -> np.ndarray:
    up, quat = np.array([0.0, 0.0, 1.0]), np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.stack([right, up, np.cross(right, up)], axis=1).ravel())
    return quat


@pytest.mark.parametrize("kind", [pytest.param(EmbreeCamera, marks=needs_embree), MujocoRayCamera])
def test_depth_matches_gl(home, kind):
    model, data = home
    with GlCamera(model, "camera", 96, 96, cull_face=False) as drawing:
        _, drawn_m = drawing.render(data)
        T_drawn = drawing.T_world_camera(data)
    with kind(model, "camera", 96, 96) as casting:
        rgb, cast_m = casting.render(data)
        assert isinstance(casting, Camera)
        assert np.array_equal(casting.T_world_camera(data), T_drawn)
    assert rgb.shape == (96, 96, 3)
    same = (np.abs(cast_m - drawn_m) < 1e-3) | (np.isnan(cast_m) & np.isnan(drawn_m))
    # A pixel on an outline may fall to either side.
    assert same.mean() > 0.998


@needs_embree
def test_colours_match_gl(home):
    model, data = home
    with GlCamera(model, "camera", 96, 96, cull_face=False) as drawing:
        drawn, _ = drawing.render(data)
    cast, _ = EmbreeCamera(model, "camera", 96, 96).render(data)
    difference = np.abs(drawn.astype(int) - cast)
    assert np.median(difference) <= 2
    assert difference.mean() < 6.0


def test_mean_colours(home):
    model, data = home
    with GlCamera(model, "camera", 96, 96, cull_face=False) as drawing:
        drawn, _ = drawing.render(data)
    cast, _ = MujocoRayCamera(model, "camera", 96, 96).render(data)
    assert abs(drawn.mean() - cast.mean()) < 60.0
    assert len(np.unique(cast.reshape(-1, 3), axis=0)) <= model.ngeom


def test_without_gl_rays_are_cast(home, caplog):
    model, data = home
    with caplog.at_level(logging.WARNING):
        camera = make_camera(model, "camera", 16, 16, cull_face=True, backend=_OFF)
    assert camera.kind == ("embree" if embree_installed() else "mujoco rays")
    assert np.isfinite(camera.render(data)[1]).all()


def test_fallback_without_embree(home, caplog, monkeypatch):
    monkeypatch.setattr("anm_mj.sim.camera_factory.embree_installed", lambda: False)
    with caplog.at_level(logging.WARNING):
        camera = make_camera(home[0], "camera", 16, 16, cull_face=True, backend=_OFF)
    assert camera.kind == "mujoco rays"
    assert "pip install embreex" in caplog.text


@needs_embree
def test_camera_kind(home, monkeypatch):
    model, _ = home
    assert camera_kind(model, _SOFTWARE) == "gl"
    monkeypatch.setattr("anm_mj.sim.camera_factory.EMBREE_FROM_TRIANGLES", 10_000)
    assert camera_kind(model, _SOFTWARE) == "embree"
    assert camera_kind(model, GlBackend("egl", "NVIDIA H100", ())) == "gl"


@needs_embree
def test_embree_refuses_what_it_cannot_see():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size="1"/><camera name="camera"/></worldbody></mujoco>'
    )
    with pytest.raises(RenderError, match="static meshes only"):
        EmbreeCamera(model, "camera", 8, 8)
    assert camera_kind(model, _OFF) == "mujoco rays"


def test_rays_see_what_moves():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><statistic extent="1"/><visual><map znear="0.02" zfar="50"/></visual><worldbody>'
        '<body name="ball" mocap="true"><geom size="1" rgba="1 0 0 1"/></body>'
        '<camera name="camera" pos="0 0 4"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    camera = MujocoRayCamera(model, "camera", 9, 9)
    for z in (0.0, -1.0):
        data.mocap_pos[0, 2] = z
        mujoco.mj_forward(model, data)
        rgb, depth_m = camera.render(data)
        assert depth_m[4, 4] == pytest.approx(3.0 - z, abs=1e-5)
        assert rgb[4, 4].tolist() == [255, 0, 0]
    assert np.isnan(depth_m[0, 0])
    assert rgb[0, 0].tolist() == [0, 0, 0]


def test_texels_are_blended_and_repeat():
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[0, 1], picture[1, 0] = (100, 0, 0), (0, 200, 0)
    texels, which, fine = MipmapTextures((picture,)), np.zeros(4, np.int32), np.ones(4, np.float32)
    places = np.array([[0.75, 0.25], [0.5, 0.25], [1.75, -0.75], [0.25, 0.5]], np.float32)
    np.testing.assert_allclose(texels.sample(which, places, fine), [[100, 0, 0], [50, 0, 0], [100, 0, 0], [0, 100, 0]])
    np.testing.assert_allclose(texels.sample(which, places, 2 * fine), np.tile([25, 50, 0], (4, 1)), atol=1)


@pytest.mark.slow
def test_a_run_completes_without_gl(tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "anm_mj.cli",
            "explore",
            "home",
            "--steps",
            "2",
            "--preset",
            "quick",
            "--policy",
            "random",
            "--out",
            "run",
            "--set",
            "image_px=32",
        ],
        env={**os.environ, "MUJOCO_GL": "off"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    manifest = (tmp_path / "run" / "manifest.json").read_text()
    assert '"camera": "embree"' in manifest or '"camera": "mujoco rays"' in manifest
