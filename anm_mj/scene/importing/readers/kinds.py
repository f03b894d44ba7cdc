"""The kinds of source that can be imported, and how a source's kind is found."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.content import Content
from anm_mj.scene.importing.readers.gazebo import is_gazebo, read_gazebo
from anm_mj.scene.importing.readers.habitat import DATASETS, dataset_reader, is_scene_instance
from anm_mj.scene.importing.readers.mesh import read_mesh_scene
from anm_mj.scene.importing.readers.mesh_check import MESH_SUFFIXES
from anm_mj.scene.importing.readers.notes import Notes
from anm_mj.scene.importing.readers.scans import SCAN_LAYOUTS, scan_reader


@dataclass(frozen=True)
class Kind:
    """One kind of source."""

    name: str
    """What ``--kind`` calls it."""
    matches: Callable[[Path], bool]
    """Whether a file or folder that is there is of this kind."""
    read: Callable[[Path, Sequence[Path], Notes], Content]
    """Reads a source, given folders to look for models in; notes what it must leave out."""


KINDS = (
    Kind("gazebo", is_gazebo, read_gazebo),
    *(Kind(data.name, lambda src, data=data: is_scene_instance(src, data), dataset_reader(data)) for data in DATASETS),
    *(
        Kind(layout.name, lambda src, layout=layout: layout.find(src) is not None, scan_reader(layout))
        for layout in SCAN_LAYOUTS
    ),
    Kind("mesh", lambda src: src.is_file() and src.suffix.lower() in MESH_SUFFIXES, read_mesh_scene),
)
"""All kinds; the first that matches a source has it."""


def kind_names() -> tuple[str, ...]:
    """What ``--kind`` takes, but for "auto"."""
    return tuple(kind.name for kind in KINDS)


def find_kind(src: Path, name: str = "auto") -> Kind:
    """The kind of a source, or the one of that name.

    Raises:
        SceneError: if the source is missing, no kind has that name, or the source is of no kind.
    """
    if not os.path.exists(src):  # Unlike Path.exists, never an error.
        raise SceneError(
            f"{src} does not exist: give the path of a mesh file, a Gazebo world, a data set's scene or a floor plan."
        )
    if name != "auto":
        named = next((kind for kind in KINDS if kind.name == name), None)
        if named is None:
            raise SceneError(f"There is no kind {name!r}: give auto, floorplan or one of {', '.join(kind_names())}.")
        return named
    try:
        found = next((kind for kind in KINDS if kind.matches(src)), None)
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): check its permissions.") from err
    if found is not None:
        return found
    if src.is_dir():
        raise SceneError(
            f"{src} is a folder of no kind that can be imported: give a scene's own folder of Gibson, Matterport3D, "
            "HM3D or Replica, or a file in it."
        )
    raise SceneError(
        f"{src} is not of a kind that can be imported: give a mesh file ({', '.join(MESH_SUFFIXES)}), a Gazebo world "
        "(.world, .sdf), a scene of a Habitat data set (.scene_instance.json) or a floor plan (.json)."
    )
