"""Good inputs of every kind, small, to be damaged."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from tests.corpus.killed import TINY
from tests.corpus.recordings import write_recordings

BENCH = """scenes = ["flat"]
policies = ["random"]
seeds = [0]
starts = 1
steps = 2
"""
WORLD = """<?xml version="1.0"?>
<sdf version="1.6"><world name="w">
  <model name="ground"><link name="l"><visual name="v"><geometry><plane><size>8 8</size></plane></geometry></visual></link></model>
  <include><uri>model://table</uri><pose>1.5 0.5 0 0 0 0.3</pose></include>
  <model name="north"><pose>0 2 1.25 0 0 0</pose><link name="l"><visual name="v"><geometry><box><size>6 0.1 2.5</size></box>
  </geometry><material><diffuse>0.8 0.2 0.2 1</diffuse></material></visual></link></model>
  <model name="south"><pose>0 -2 1.25 0 0 0</pose><link name="l"><visual name="v"><geometry><box><size>6 0.1 2.5</size></box>
  </geometry></visual></link></model>
</world></sdf>
"""
TABLE = """<?xml version="1.0"?>
<sdf version="1.6"><model name="table"><link name="l"><visual name="v"><pose>0 0 0.4 0 0 0</pose>
<geometry><mesh><uri>model://table/meshes/table.obj</uri><scale>1 1 1</scale></mesh></geometry></visual></link></model></sdf>
"""
URDF = """<?xml version="1.0"?>
<robot name="room"><link name="base"><visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry><mesh filename="room.obj"/></geometry>
</visual></link></robot>
"""
MJCF = """<mujoco model="room">
  <compiler meshdir="." texturedir="."/>
  <asset>
    <mesh name="room" file="room.obj"/>
    <texture name="wood" type="2d" file="wood.png"/>
    <texture name="plain" type="2d" builtin="flat" width="32" height="32" rgb1="0.5 0.5 0.5"/>
    <material name="wood" texture="wood"/>
    <hfield name="hill" nrow="8" ncol="8" size="0.5 0.5 0.2 0.1"/>
  </asset>
  <worldbody>
    <geom type="mesh" mesh="room"/>
    <geom type="hfield" hfield="hill" pos="-2 1 0"/>
    <include file="table.xml"/>
    <replicate count="3" offset="0.5 0 0"><geom type="box" size="0.1 0.1 0.2" pos="-1 -1.5 0.2"/></replicate>
  </worldbody>
</mujoco>
"""
MJCF_TABLE = """<mujocoinclude><body name="table" pos="1 0 0.4"><freejoint/>
<geom type="box" size="0.4 0.3 0.4" material="wood"/></body></mujocoinclude>
"""
ROBOT_MESH = '<asset><mesh name="hull" file="hull.stl"/></asset><worldbody>'
PROCTHOR = {
    "proceduralParameters": {"ceilingMaterial": {}},
    "rooms": [
        {
            "id": f"room|{k}",
            "roomType": kind,
            "floorPolygon": [{"x": x, "y": 0, "z": z} for x, z in ((x0, 0), (x0, 4), (x0 + 3, 4), (x0 + 3, 0))],
        }
        for k, kind, x0 in ((1, "Bedroom", 0.0), (2, "LivingRoom", 3.0))
    ],
    "walls": [],
    "doors": [],
    "windows": [],
    "metadata": {},
}
_OUTLINE = (0, 0, 4, 0, 4, 1.5, 4.15, 1.5, 4.15, 0, 8, 0, 8, 4, 4.15, 4, 4.15, 2.4, 4, 2.4, 4, 4, 0, 4)
HOUSEEXPO = {
    "id": "x",
    "room_num": 2,
    "bbox": {"min": [0, 0], "max": [8, 4]},
    "verts": [list(point) for point in zip(_OUTLINE[::2], _OUTLINE[1::2], strict=True)],
    "room_category": {"Kitchen": [[0, 0, 4, 4]], "Bedroom": [[4.15, 0, 8, 4]]},
}


def room_mesh() -> trimesh.Trimesh:
    """A furnished room of 6 x 4 m, z up."""
    boxes = [
        ((6.0, 4.0, 0.1), (0.0, 0.0, -0.05)),
        ((6.0, 0.1, 2.5), (0.0, 2.0, 1.25)),
        ((6.0, 0.1, 2.5), (0.0, -2.0, 1.25)),
        ((0.1, 4.0, 2.5), (3.0, 0.0, 1.25)),
        ((0.1, 4.0, 2.5), (-3.0, 0.0, 1.25)),
        ((1.0, 0.6, 0.7), (1.5, 1.2, 0.35)),
    ]
    return trimesh.util.concatenate(
        [trimesh.creation.box(size, trimesh.transformations.translation_matrix(middle)) for size, middle in boxes]
    )


def textured_room() -> trimesh.Trimesh:
    """The room with a picture on it."""
    mesh = room_mesh()
    image = Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8))
    material = trimesh.visual.material.SimpleMaterial(image=image)
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2] / 6.0, material=material)
    return mesh


def write_sources(folder: Path, robot: Path, with_run: bool = True) -> dict[str, Path]:
    """One good input of each kind; the file that is damaged, by kind. Companions lie beside it.

    Without a run there is no run folder, and the scene takes a second instead of ten.
    """
    paths = {}
    for suffix in ("obj", "glb", "gltf", "ply", "stl", "dae"):
        below = folder / suffix
        below.mkdir(parents=True)
        paths[suffix] = below / f"room.{suffix}"
        if suffix == "gltf":
            _write_gltf(below)
        else:
            textured_room().export(paths[suffix])
    for name, text in (("world", WORLD), ("urdf", URDF)):
        paths[name] = _written(folder / name / f"room.{name}", text)
        room_mesh().export(folder / name / "room.obj")
    table = folder / "world" / "models" / "table"
    (table / "meshes").mkdir(parents=True)
    (table / "model.config").write_text('<model><sdf version="1.6">model.sdf</sdf></model>')
    (table / "model.sdf").write_text(TABLE)
    trimesh.creation.box((1.0, 0.6, 0.8)).export(table / "meshes" / "table.obj")
    for name, plan in (("procthor", PROCTHOR), ("houseexpo", HOUSEEXPO)):
        paths[name] = _written(folder / name / "plan.json", json.dumps(plan))
    paths["mjcf"] = _written(folder / "mjcf" / "room.xml", MJCF)
    (folder / "mjcf" / "table.xml").write_text(MJCF_TABLE)
    room_mesh().export(folder / "mjcf" / "room.obj")
    Image.fromarray(np.full((16, 16, 3), 120, np.uint8)).save(folder / "mjcf" / "wood.png")
    body = '<geom type="box" size="0.10 0.13 0.04"/>'
    text = robot.read_text().replace("<worldbody>", ROBOT_MESH, 1)
    text = text.replace(body, body + '<geom type="mesh" mesh="hull" mass="0.1"/>', 1)
    paths["robot"] = _written(folder / "robot" / "rover.xml", text)
    trimesh.creation.box((0.1, 0.1, 0.05)).export(folder / "robot" / "hull.stl")
    paths |= write_recordings(folder)
    paths["bench"] = _written(folder / "bench" / "bench.toml", BENCH)
    paths["scene"] = folder / "scene" / "room"
    _anm_mj("scene", "import", paths["obj"], paths["scene"], "--up", "z")
    if with_run:
        settings = [word for setting in TINY for word in ("--set", setting)]
        explore = ("explore", paths["scene"], "--preset", "quick", *settings)
        paths["run"] = folder / "run" / "run"
        _anm_mj(*explore, "--steps", "6", "--out", paths["run"])
        paths["benched"] = folder / "benched" / "run"
        shutil.copytree(folder / "bench", folder / "benched")
        _anm_mj("bench", folder / "benched" / "bench.toml", "--out", paths["benched"])
        paths["killed"] = folder / "killed" / "run"
        words = [sys.executable, "-m", "tests.corpus.killed", str(paths["scene"]), str(paths["killed"])]
        subprocess.run(words, check=True, capture_output=True, cwd=Path(__file__).resolve().parents[2])
    return paths


def _anm_mj(*words: object) -> None:
    # In a process of its own: what is forked later must not inherit a GL context or threads.
    subprocess.run([sys.executable, "-m", "anm_mj.cli", *map(str, words)], check=True, capture_output=True)


def _write_gltf(folder: Path) -> None:
    from trimesh.exchange.gltf import export_gltf

    for name, content in export_gltf(trimesh.Scene(textured_room())).items():
        (folder / ("room.gltf" if name == "model.gltf" else name)).write_bytes(content)


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True)
    path.write_text(text)
    return path
