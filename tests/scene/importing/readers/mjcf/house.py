"""A house written in MJCF with every feature that the importer knows, in three files and with a robot in it."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from tests.scene.furnished import picture

_SHELL = """
<mujocoinclude>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1" material="checker"/>
    <geom name="wall_s" class="wall" pos="0 -4.05 1.25" size="5 0.05 1.25"/>
    <geom name="wall_n" class="wall" pos="0 4.05 1.25" size="5 0.05 1.25"/>
    <geom name="wall_w" class="wall" pos="-5.05 0 1.25" size="0.05 4.1 1.25"/>
    <geom name="wall_e" class="wall" pos="5.05 0 1.25" size="0.05 4.1 1.25"/>
    <geom name="ceiling" type="plane" pos="0 0 2.5" size="5.1 4.1 1" zaxis="0 0 -1" rgba="0.9 0.9 0.8 1"
     contype="0" conaffinity="0"/>
    <geom name="hidden_hull" type="box" pos="-3.5 3 0.5" size="0.4 0.3 0.5" group="3"/>
  </worldbody>
</mujocoinclude>
"""

_HOUSE = """<?xml version="1.0"?>
<mujoco model="house">
  <compiler angle="degree" meshdir="meshes" texturedir="textures" autolimits="true"/>
  <default>
    <default class="wall"><geom type="box" material="bricks"/></default>
    <default class="decor"><geom contype="0" conaffinity="0" group="1" mass="0.1"/></default>
  </default>
  <asset>
    <texture name="checker" type="2d" builtin="checker" rgb1="0.2 0.3 0.4" rgb2="0.8 0.7 0.2" width="64" height="64"/>
    <texture name="gradient" type="cube" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="64" height="64"/>
    <texture name="flat" type="2d" builtin="flat" rgb1="0 0.6 0" width="16" height="16" mark="cross" markrgb="1 1 1"/>
    <texture name="picture" type="2d" file="picture.png"/>
    <texture name="dice" type="cube" fileright="r.png" fileleft="l.png" fileup="u.png" filedown="d.png"
     filefront="f.png" fileback="b.png"/>
    <material name="checker" texture="checker" texrepeat="2 2" texuniform="true"/>
    <material name="bricks" texture="gradient" rgba="0.9 0.9 0.9 1"/>
    <material name="cross" texture="flat" texrepeat="3 1"/>
    <material name="picture" texture="picture"/>
    <material name="dice" texture="dice"/>
    <material name="red" rgba="0.8 0.1 0.1 1"/>
    <mesh name="board" file="board.obj"/>
    <mesh name="chair" file="chair.stl" scale="0.001 0.001 0.001"/>
    <hfield name="hill" nrow="9" ncol="13" size="0.8 0.6 0.4 0.1"
     elevation="{elevation}"/>
  </asset>
  <include file="parts/shell.xml"/>
  <worldbody>
    <light pos="0 0 2.4"/>
    <camera name="overview" pos="0 0 2.4"/>
    <site name="marker" pos="0 0 1" size="0.1"/>
    <geom name="hill" type="hfield" hfield="hill" pos="3.8 -3 0.1" rgba="0.4 0.5 0.3 1"/>
    <geom name="ball" type="sphere" size="0.3" pos="2 2.5 0.3" material="dice"/>
    <geom name="egg" type="ellipsoid" size="0.2 0.3 0.5" pos="3.5 2.5 0.5" euler="20 0 30" material="red"/>
    <geom name="pillar" type="cylinder" size="0.25 1.25" pos="-1.5 -2.5 1.25" material="cross"/>
    <geom name="bolster" type="capsule" fromto="-4 -3 0.3 -2.5 -3.4 0.5" size="0.2" rgba="0.1 0.2 0.9 1"/>
    <geom name="crate" type="box" size="0.4 0.3 0.5" pos="-3.5 3 0.5" class="decor" material="dice"/>
    <geom name="glass" type="box" size="0.01 0.5 0.6" pos="4 0 0.8" rgba="0.5 0.8 0.9 0.3"/>
    <geom name="ghost" type="box" size="1 1 1" pos="0 0 1" rgba="1 1 1 0" contype="0" conaffinity="0"/>
    <geom name="debug" type="box" size="1 1 1" pos="0 0 1" group="4" contype="0" conaffinity="0"/>
    <geom name="board" type="mesh" mesh="board" class="decor" material="picture"/>
    <body name="chair" pos="1 -2 0">
      <freejoint/>
      <geom type="mesh" mesh="chair" rgba="0.6 0.4 0.2 1" mass="4"/>
    </body>
    <body name="box" pos="-1 2.5 1.5">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.2" material="dice" mass="2"/>
    </body>
    <body name="gate" pos="-2 -0.5 0">
      <joint name="gate" type="hinge" axis="0 0 1" range="0 90"/>
      <geom type="box" size="0.45 0.02 1" pos="0.45 0 1.02" material="red"/>
    </body>
    <body name="rover" pos="0 0.5 0.2">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.1"/>
      <body name="left" pos="0 0.2 0"><joint name="left" axis="0 1 0"/><geom type="sphere" size="0.1"/></body>
      <body name="right" pos="0 -0.2 0"><joint name="right" axis="0 1 0"/><geom type="sphere" size="0.1"/></body>
    </body>
  </worldbody>
  <actuator><velocity joint="left"/><velocity joint="right"/></actuator>
  <keyframe>{key}</keyframe>
</mujoco>
"""

CHAIR_AT = (1.0, -2.0, 0.0)
"""Where the file has the chair [m]; its key frame has it a metre farther along x."""


def chair() -> trimesh.Trimesh:
    """A chair of five boxes on the floor about the origin [m], one of its legs longer than symmetry asks for."""
    boxes = [((0.0, 0.0, 0.45), (0.45, 0.45, 0.05)), ((-0.2, 0.0, 0.75), (0.04, 0.45, 0.6))]
    boxes += [((x, y, 0.215), (0.05, 0.05, 0.43)) for x in (-0.19, 0.19) for y in (-0.19, 0.19)]
    return trimesh.util.concatenate(
        [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for at, size in boxes]
    )


def write_house(folder: Path) -> Path:
    """Write the house and return its file."""
    for below in ("meshes", "textures", "parts"):
        (folder / below).mkdir(parents=True)
    picture().save(folder / "textures" / "picture.png")
    for i, name in enumerate("rludfb"):
        pixels = np.zeros((16, 16, 3), dtype=np.uint8)
        pixels[:] = np.array([40 * i + 20, 255 - 40 * i, 128])
        pixels[:4, :4] = 255
        Image.fromarray(pixels).save(folder / "textures" / f"{name}.png")
    seat = chair()
    seat.apply_scale(1000.0)
    seat.export(folder / "meshes" / "chair.stl")
    corners = "v -1 3.99 0.5\nv 1 3.99 0.5\nv 1 3.99 2.5\nv -1 3.99 2.5\n"
    back = "v -1 4 0.5\nv 1 4 0.5\nv 1 4 2.5\nv -1 4 2.5\n"
    faces = "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 5/1 7/3 6/2\nf 5/1 8/4 7/3\n"
    (folder / "meshes" / "board.obj").write_text(f"{corners}{back}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{faces}")
    heights = np.random.default_rng(0).random((9, 13))
    elevation = " ".join(f"{value:.3f}" for value in heights.ravel())
    (folder / "parts" / "shell.xml").write_text(_SHELL)
    # Free joints of chair and box, the gate, the rover with its two wheels.
    rest = "1 0 0 0"
    key = f'<key qpos="2 -2 0 {rest} -1 2.5 1.5 {rest} 0.3 0 0.5 0.2 {rest} 0 0"/>'
    src = folder / "house.xml"
    src.write_text(_HOUSE.format(elevation=elevation, key=key))
    return src
