"""Small Gazebo worlds and models, and what is read of them."""

import numpy as np

from anm_mj.scene.importing.readers.gazebo import read_gazebo
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.submesh import merge_geometry
from tests.scene.furnished import picture

WALLS = {"a": (-0.05, 2, 0.1, 4), "b": (6.05, 2, 0.1, 4), "c": (3, -0.05, 6, 0.1), "d": (3, 4.05, 6, 0.1)}
GROUND = (
    "<model name='ground'><link name='l'><visual name='v'><geometry><plane><size>100 100</size></plane></geometry>"
    "<material><diffuse>0 0.5 0 1</diffuse></material></visual></link></model>"
)
ROOM = "".join(
    f"<model name='wall_{name}'><pose>{x} {y} 0 0 0 0</pose><link name='l'><visual name='v'><pose>0 0 1.25 0 0 0</pose>"
    f"<geometry><box><size>{sx} {sy} 2.5</size></box></geometry></visual></link></model>"
    for name, (x, y, sx, sy) in WALLS.items()
)


def write_world(path, content: str, version: str = "1.9"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<?xml version='1.0'?><sdf version='{version}'><world name='w'>{content}</world></sdf>")
    return path


def box(name: str, pose: str = "", size: str = "1 2 3", more: str = "") -> str:
    return (
        f"<model name='{name}'>{pose}<link name='l'><visual name='v'><geometry><box><size>{size}</size></box>"
        f"</geometry>{more}</visual></link></model>"
    )


def write_model(folder, name: str, content: str, files: dict[str, bytes] | None = None):
    (folder / name).mkdir(parents=True)
    (folder / name / "model.config").write_text("<model><sdf version='1.6'>model.sdf</sdf></model>")
    (folder / name / "model.sdf").write_text(f"<sdf version='1.6'><model name='{name}'>{content}</model></sdf>")
    for file, data in (files or {}).items():
        (folder / name / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / name / file).write_bytes(data)


def read_parts(src, *model_paths):
    report = ImportReport()
    return read_gazebo(src, list(model_paths), report).submeshes, report.sentences()


def bounds_of(parts):
    vertices, faces = merge_geometry(parts)
    used = vertices[faces].reshape(-1, 3)
    return np.stack([used.min(axis=0), used.max(axis=0)])


def write_picture(folder):
    folder.mkdir(parents=True, exist_ok=True)
    picture().save(folder / "p.png")
