"""The camera against scenes whose picture can be computed by hand."""

import math
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RenderError
from anm_mj.frames import back_project, transform_points
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.types import Intrinsics
from tests.sim.evenly_lit import HEADER

_SCENE = """
<mujoco>
  {header}
  <worldbody>
    <camera name="camera" pos="0.3 -0.2 1.25" xyaxes="{axes}" fovy="{fovy}"/>
    {geoms}
  </worldbody>
</mujoco>
"""
_LOOKING_ALONG_X = "0 -1 0 0 0 1"


def _compile(geoms: str, axes: str = _LOOKING_ALONG_X, fovy: float = 90.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(_SCENE.format(header=HEADER, geoms=geoms, axes=axes, fovy=fovy))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _render(geoms: str, width: int = 256, height: int = 256, **kwargs):
    model, data = _compile(geoms, **kwargs)
    with GlCamera(model, "camera", width, height) as camera:
        rgb, depth_m = camera.render(data)
        return rgb, depth_m, camera.intrinsics, camera.T_world_camera(data)


def _project(point_world: list[float], intrinsics: Intrinsics, T_world_camera: np.ndarray) -> tuple[float, float]:
    x, y, z = transform_points(np.linalg.inv(T_world_camera), np.array([point_world]))[0]
    return intrinsics.fx * x / z + intrinsics.cx, intrinsics.fy * y / z + intrinsics.cy


def test_planar_depth():
    _, depth_m, _, _ = _render('<geom type="box" pos="2.8 0 0" size="0.5 9 9"/>')
    np.testing.assert_allclose(depth_m, 2.0, atol=1e-4)


@pytest.mark.parametrize("znear_zfar", [(0.001, 1000.0), (0.1, 20.0)])
def test_clipping_planes(znear_zfar):
    model, data = _compile('<geom type="box" pos="10.3 0 0" size="0.5 20 20"/>')
    model.vis.map.znear, model.vis.map.zfar = znear_zfar
    with GlCamera(model, "camera", 64, 64) as camera:
        np.testing.assert_allclose(camera.render(data)[1], 9.5, atol=1e-3)


@pytest.mark.parametrize("euler", ["0 0 30", "0 25 0", "0 20 -40"])
def test_slanted_wall(euler):
    model, data = _compile(f'<geom name="wall" type="box" pos="3 0 1.25" size="0.1 9 9" euler="{euler}"/>')
    with GlCamera(model, "camera", 256, 256) as camera:
        _, depth_m = camera.render(data)
        points = back_project(depth_m, camera.intrinsics, camera.T_world_camera(data))
    wall = data.geom("wall")
    heights_m = (points - wall.xpos) @ wall.xmat.reshape(3, 3)[:, 0]
    assert np.isfinite(depth_m).mean() > 0.5
    np.testing.assert_allclose(heights_m, -0.1, atol=1e-3)


@pytest.mark.parametrize("axes", [_LOOKING_ALONG_X, "1 0 0 0 0 1", "0.6 -0.8 0 0 0 1", "0 -1 0 -0.28 0 0.96"])
@pytest.mark.parametrize(("width", "height", "fovy"), [(256, 256, 90.0), (320, 240, 60.0), (65, 47, 75.0)])
def test_projection_of_markers(axes, width, height, fovy):
    model, data = _compile("", axes, fovy)
    with GlCamera(model, "camera", width, height) as camera:
        intrinsics, T_world_camera = camera.intrinsics, camera.T_world_camera(data)
    # One marker per quadrant, none of them symmetric to another: a flip, a mirror or a transpose would show.
    half = 0.5 * math.tan(math.radians(fovy) / 2.0)
    places_camera = np.array([[0.7, 0.3, 2.0], [-0.5, 0.85, 2.0], [-0.8, -0.2, 2.0], [0.2, -0.6, 2.0]])
    places_camera[:, :2] *= 2.0 * 2.0 * half
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
    places_world = transform_points(T_world_camera, places_camera)
    spheres = "".join(
        f'<geom type="sphere" size="0.12" pos="{x} {y} {z}" rgba="{r / 255} {g / 255} {b / 255} 1"/>'
        for (x, y, z), (r, g, b) in zip(places_world, colours, strict=True)
    )
    rgb, depth_m, _, _ = _render(spheres, width, height, axes=axes, fovy=fovy)
    for place_camera, place_world, colour in zip(places_camera, places_world, colours, strict=True):
        rows, cols = np.nonzero((rgb == colour).all(axis=2))
        u, v = _project(list(place_world), intrinsics, T_world_camera)
        # A sphere's outline is an ellipse whose centre lies a little outwards of the projected centre.
        outwards = 1.0 / (1.0 - (0.12 / place_camera[2]) ** 2)
        assert cols.mean() + 0.5 == pytest.approx(intrinsics.cx + (u - intrinsics.cx) * outwards, abs=0.4)
        assert rows.mean() + 0.5 == pytest.approx(intrinsics.cy + (v - intrinsics.cy) * outwards, abs=0.4)
        assert np.isfinite(depth_m[rows, cols]).all()
    assert np.isfinite(depth_m).sum() == sum(int((rgb == colour).all(axis=2).sum()) for colour in colours)


def test_projection_of_edges():
    # A plate 2 m ahead: its edges are projected to u = 128 +- 64 * 0.501 and so on, between two pixel centres.
    rgb, _, intrinsics, T_world_camera = _render(
        '<geom type="box" pos="2.35 0.1 1.5" size="0.05 0.501 0.252" rgba="1 0 0 1"/>'
    )
    inside = (rgb == (255, 0, 0)).all(axis=2)
    rows, cols = np.nonzero(inside)
    left, top = _project([2.3, 0.1 + 0.501, 1.5 + 0.252], intrinsics, T_world_camera)
    right, bottom = _project([2.3, 0.1 - 0.501, 1.5 - 0.252], intrinsics, T_world_camera)
    centres = np.arange(256) + 0.5
    assert (cols.min(), cols.max()) == tuple(np.flatnonzero((centres > left) & (centres < right))[[0, -1]])
    assert (rows.min(), rows.max()) == tuple(np.flatnonzero((centres > top) & (centres < bottom))[[0, -1]])


def test_pixels_without_depth():
    _, depth_m, _, _ = _render('<geom type="box" pos="2.3 0 0" size="0.1 9 1.25"/>')
    assert np.isnan(depth_m[:127]).all()
    assert np.isfinite(depth_m[128:]).all()
    _, depth_m, _, _ = _render('<geom type="box" pos="60 0 0" size="0.1 90 90"/>')
    assert np.isnan(depth_m).all()


def test_unlit_colours_are_exact():
    rgb, _, _, _ = _render('<geom type="box" pos="2.3 0 0" size="0.1 9 9" rgba="0.2 0.4 0.6 1"/>')
    assert np.unique(rgb.reshape(-1, 3), axis=0).tolist() == [[51, 102, 153]]


def test_visible_groups():
    geoms = "".join(
        f'<geom type="box" pos="{2 + 0.1 * group} 0 0" size="0.04 9 9" group="{group}"/>' for group in (1, 3, 2)
    )
    _, depth_m, _, _ = _render(geoms)
    np.testing.assert_allclose(depth_m, 2.2 - 0.04 - 0.3, atol=1e-4)


def test_sites_are_invisible():
    _, depth_m, _, _ = _render('<site type="sphere" pos="2 0 1.25" size="0.5" group="0"/>')
    assert np.isnan(depth_m).all()


def test_backface_culling():
    # The camera stands inside the box, which is seen from within.
    model, data = _compile('<geom type="box" pos="0.3 -0.2 1.25" size="1 1 1"/>')
    with GlCamera(model, "camera", 32, 32, cull_face=True) as camera:
        assert np.isnan(camera.render(data)[1]).all()
    with GlCamera(model, "camera", 32, 32, cull_face=False) as camera:
        np.testing.assert_allclose(camera.render(data)[1], 1.0, atol=1e-4)


def test_alternating_cameras():
    model, data = _compile('<geom name="wall" type="box" pos="2.8 0 0" size="0.5 9 9"/>')
    with GlCamera(model, "camera", 64, 64) as first, GlCamera(model, "camera", 32, 48) as second:
        _, before = first.render(data)
        model.geom("wall").pos[0] += 1.0
        mujoco.mj_forward(model, data)
        assert second.render(data)[1].shape == (48, 32)
        _, after = first.render(data)
    np.testing.assert_allclose(before, 2.0, atol=1e-4)
    np.testing.assert_allclose(after, 3.0, atol=1e-4)


def test_a_model_is_left_as_it_was():
    model, _ = _compile('<geom type="box" pos="2.8 0 0" size="0.5 9 9"/>')
    quality = model.vis.quality
    before = quality.offsamples, quality.shadowsize, model.vis.global_.offwidth
    GlCamera(model, "camera", 700, 700).close()
    assert (quality.offsamples, quality.shadowsize, model.vis.global_.offwidth) == before


def test_unknown_camera():
    model, _ = _compile("")
    with pytest.raises(RenderError, match=r'no camera "eye"; it has \[\'camera\'\]'):
        GlCamera(model, "eye", 64, 64)


def test_a_closed_camera_says_so():
    model, data = _compile("")
    camera = GlCamera(model, "camera", 16, 16)
    camera.close()
    camera.close()
    with pytest.raises(RenderError, match="is closed"):
        camera.render(data)


@pytest.mark.slow
def test_a_camera_that_nobody_closed_ends_silently():
    program = "import anm_mj; robot = anm_mj.make_robot(anm_mj.load_scene('room'), image_px=16); robot.observe()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_without_gl_the_other_cameras_can_be_had():
    program = "from anm_mj.sim.camera_factory import make_camera"
    env = {**os.environ, "MUJOCO_GL": "off"}
    done = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
