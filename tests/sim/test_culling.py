"""What is left out must not show: pictures with and without culling are compared bit by bit."""

import math

import mujoco
import numpy as np
import pytest

from anm_mj.sim.culling import Culling, is_worth_culling
from anm_mj.sim.gl_camera import GlCamera
from tests.sim.evenly_lit import HEADER

_SCENE = """
<mujoco>
  {header}
  <asset>
    <mesh name="crate" vertex="-.3 -.3 0  .3 -.3 0  .3 .3 0  -.3 .3 0  -.3 -.3 .9  .3 -.3 .9  .3 .3 .9  -.3 .3 .9"/>
    <mesh name="wall" vertex="-2 -.1 0  2 -.1 0  2 .1 0  -2 .1 0  -2 -.1 2.5  2 -.1 2.5  2 .1 2.5  -2 .1 2.5"/>
  </asset>
  <worldbody>
    <body name="eye" mocap="true" pos="0 0 1.25"><camera name="camera" xyaxes="0 -1 0 0 0 1" fovy="90"/></body>
    {geoms}
  </worldbody>
</mujoco>
"""


def _maze() -> str:
    """Crates on a lattice between walls that hide most of them."""
    rng = np.random.default_rng(3)
    geoms = []
    for x in range(-4, 5):
        for y in range(-4, 5):
            rgb = " ".join(f"{value:.3f}" for value in rng.uniform(0.2, 1.0, 3))
            mesh = "wall" if (x + 2 * y) % 5 == 0 else "crate"
            yaw_deg = rng.uniform(0, 360) if mesh == "crate" else 90 * (x % 2)
            geoms.append(
                f'<geom type="mesh" mesh="{mesh}" pos="{1.7 * x + 0.8} {1.7 * y + 0.8} 0" euler="0 0 {yaw_deg:.1f}" '
                f'rgba="{rgb} 1" group="2" contype="0" conaffinity="0"/>'
            )
    return "\n".join(geoms)


def _model(geoms: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(_SCENE.format(header=HEADER, geoms=geoms))
    return model, mujoco.MjData(model)


def _look(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float, yaw: float, pitch: float = 0.0) -> None:
    data.mocap_pos[0] = x, y, 1.25
    mujoco.mju_euler2Quat(data.mocap_quat[0], [yaw, pitch, 0.0], "zyx")
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)


def _walk() -> list[tuple[float, float, float, float]]:
    """Small steps and turns, then leaps, so that guesses are mostly right at first and mostly wrong later."""
    steps = [(0.065 * i, 0.1, 0.17 * (i // 3), 0.0) for i in range(40)]
    rng = np.random.default_rng(0)
    leaps = [(*rng.uniform(-6, 6, 2), rng.uniform(0, math.tau), rng.uniform(-0.5, 0.5)) for _ in range(30)]
    return steps + leaps


@pytest.mark.parametrize(("width", "height"), [(96, 96), (130, 71)])
def test_pictures_are_the_same_bit_by_bit(width, height):
    model, data = _model(_maze())
    with (
        GlCamera(model, "camera", width, height, cull_hidden=True) as culled,
        GlCamera(model, "camera", width, height, cull_hidden=False) as everything,
    ):
        for pose in _walk():
            _look(model, data, *pose)
            (rgb, depth_m), (all_rgb, all_depth_m) = culled.render(data), everything.render(data)
            assert rgb.tobytes() == all_rgb.tobytes()
            assert depth_m.tobytes() == all_depth_m.tobytes()


def test_skipped_meshes():
    geoms = """
    <geom name="before" type="mesh" mesh="wall" pos="3 0 0" euler="0 0 90" group="2"/>
    <geom name="hidden" type="mesh" mesh="crate" pos="6 0 0" group="2"/>
    <geom name="behind" type="mesh" mesh="crate" pos="-3 0 0" group="2"/>
    <geom name="beside" type="mesh" mesh="crate" pos="1 5 0" group="2"/>
    """
    model, data = _model(geoms)
    with GlCamera(model, "camera", 256, 256, cull_hidden=True) as camera:
        culling = camera.culling
        assert culling is not None
        _look(model, data, 0.0, 0.0, 0.0)
        camera.render(data)
        assert _names(model, culling) == {"behind", "beside"}
        camera.render(data)
        assert _names(model, culling) == {"behind", "beside", "hidden"}


def test_wrong_prediction_is_corrected():
    geoms = """
    <geom name="before" type="mesh" mesh="wall" pos="3 0 0" euler="0 0 90" group="2"/>
    <geom name="hidden" type="mesh" mesh="crate" pos="6 0 0" group="2" rgba="1 0 0 1"/>
    """
    model, data = _model(geoms)
    with GlCamera(model, "camera", 256, 256, cull_hidden=True) as camera:
        for _ in range(2):
            _look(model, data, 0.0, 0.0, 0.0)
            camera.render(data)
        # The wall goes away, which the camera cannot know.
        data.geom("before").xpos[2] -= 10.0
        rgb, _ = camera.render(data)
    assert (rgb == (255, 0, 0)).all(axis=2).any()


def test_nothing_is_hidden_by_glass():
    geoms = """
    <geom type="mesh" mesh="wall" pos="3 0 0" euler="0 0 90" group="2" rgba="0 0 1 0.5"/>
    <geom type="mesh" mesh="crate" pos="6 0 0" group="2" rgba="1 0 0 1"/>
    """
    model, data = _model(geoms)
    with GlCamera(model, "camera", 64, 64, cull_hidden=True) as camera:
        _look(model, data, 0.0, 0.0, 0.0)
        first, second = camera.render(data)[0], camera.render(data)[0]
    assert np.array_equal(first, second)
    assert (second[..., 0] > 50).any()


def test_a_model_is_left_as_it_was():
    model, data = _model(_maze())
    groups = model.geom_group.copy()
    with GlCamera(model, "camera", 32, 32, cull_hidden=True) as camera:
        _look(model, data, 0.0, 0.0, 0.0)
        camera.render(data)
    assert np.array_equal(model.geom_group, groups)


def test_small_models_are_drawn_whole():
    model, _ = _model(_maze())
    assert not is_worth_culling(model)
    with GlCamera(model, "camera", 32, 32) as camera:
        assert camera.culling is None


def _names(model: mujoco.MjModel, culling: Culling) -> set[str]:
    return {model.geom(geom).name for geom in culling.skipped_geoms()}
