"""Good inputs of every kind, small, to be damaged."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

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
    paths["robot"] = _written(folder / "robot" / "rover.xml", robot.read_text())
    paths["bench"] = _written(folder / "bench" / "bench.toml", BENCH)
    paths["scene"] = folder / "scene" / "room"
    _anm_mj("scene", "import", paths["obj"], paths["scene"], "--up", "z")
    if with_run:
        paths["run"] = folder / "run" / "run"
        _anm_mj("explore", paths["scene"], "--steps", "6", "--out", paths["run"])
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
