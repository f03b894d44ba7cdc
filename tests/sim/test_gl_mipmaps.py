"""Where a texture is seen from near and from far."""

import mujoco
import numpy as np
import pytest
from PIL import Image

from anm_mj.sim import gl_camera
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.mipmap import halved

_SIDE_PX, _TILE_PX, _SIDE_M = 1024, 64, 4.0
_TILE_M = _SIDE_M * _TILE_PX / _SIDE_PX
_SCENE = """
<mujoco>
  <compiler meshdir="{folder}" texturedir="{folder}"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset>
    <texture name="tiles" type="2d" file="tiles.png"/>
    <material name="tiles" texture="tiles"/>
    <mesh name="floor" file="floor.obj" inertia="shell"/>
  </asset>
  <worldbody>
    <geom type="mesh" mesh="floor" material="tiles" contype="0" conaffinity="0"/>
    <camera name="camera" pos="0 0 3" fovy="{fovy}"/>
  </worldbody>
</mujoco>
"""
_FLOOR = "v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"


def joint_m(folder, px_m) -> float:
    """Where the joints of a tiled floor are seen along x, from the edge of their tiles on, from above [m]."""
    scene = _SCENE.format(folder=folder, fovy=2.0 * np.degrees(np.arctan(px_m * 128 / 3.0)))
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with GlCamera(model, "camera", 256, 256) as camera:
        rgb, _ = camera.render(data)
    profile = rgb.astype(float).mean(axis=(0, 2))
    wave = np.exp(-2j * np.pi * (np.arange(256) - 127.5) * px_m / _TILE_M)
    # Joints are dark: where the wave of the tiles' length is lowest.
    phase = np.angle(((profile - profile.mean()) * np.hanning(256) * wave).sum()) + np.pi
    return -phase / (2.0 * np.pi) * _TILE_M % _TILE_M


@pytest.fixture
def tiles(tmp_path):
    """A floor whose tiles begin with a joint of four pixels, 1.6 cm."""
    tiles = np.full((_SIDE_PX, _SIDE_PX, 3), 200, np.uint8)
    for begin in range(0, _SIDE_PX, _TILE_PX):
        tiles[begin : begin + 4] = tiles[:, begin : begin + 4] = 60
    Image.fromarray(tiles).save(tmp_path / "tiles.png")
    (tmp_path / "floor.obj").write_text(_FLOOR)
    return tmp_path


def test_joints_stay_where_they_are_from_far_away(tiles, monkeypatch):
    near = joint_m(tiles, 0.004)
    assert near == pytest.approx(0.008, abs=5e-4)
    assert joint_m(tiles, 0.03) == pytest.approx(near, abs=1e-3)
    # What the driver makes moves them by more than a centimetre.
    monkeypatch.setattr(gl_camera, "smooth_mipmaps", lambda context: None)
    assert abs(joint_m(tiles, 0.03) - near) > 5e-3


@pytest.mark.parametrize("shape", [(64, 64), (33, 17), (1, 8), (5, 1)])
def test_levels_keep_the_mean(shape):
    texture = np.random.default_rng(0).integers(100, 140, (*shape, 4)).astype(np.uint8)
    level = halved(texture)
    assert level.shape == (max(1, shape[0] // 2), max(1, shape[1] // 2), 4)
    np.testing.assert_allclose(level.mean(axis=(0, 1)), texture.mean(axis=(0, 1)), atol=4.0)


def test_transparent_texels_keep_their_colour():
    texture = np.zeros((8, 8, 4), np.uint8)
    texture[..., :3] = 90, 120, 150
    np.testing.assert_array_equal(halved(texture), np.broadcast_to([90, 120, 150, 0], (4, 4, 4)))
