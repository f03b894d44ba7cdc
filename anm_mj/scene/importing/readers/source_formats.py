"""The formats that can be imported, and how the format of a source is found."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from anm_mj.errors import SceneError
from anm_mj.mjcf.read_mjcf import is_mjcf
from anm_mj.scene.importing.readers.gazebo import is_gazebo, read_gazebo
from anm_mj.scene.importing.readers.habitat import DATASETS, is_scene_instance, read_scene_instance
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mesh_check import MESH_SUFFIXES
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.importing.readers.read_mesh import read_mesh_scene
from anm_mj.scene.importing.readers.scans import SCAN_LAYOUTS, read_scan


@dataclass(frozen=True)
class SceneFormat:
    """One format of source."""

    name: str
    """What ``--format`` calls it."""
    matches: Callable[[Path], bool]
    """Whether a file or folder that is there has this format."""
    read: Callable[..., ParsedScene]
    """Reads a source, given folders to look for models in; reports what it must leave out. That of MuJoCo worlds takes
    options."""
    is_whole: bool = False
    """Whether a source holds all its models, or has them beside it."""


_CONVERTERS = {
    (".ifc", ".ifczip"): "a building model: `IfcConvert {name} {stem}.glb` of IfcOpenShell converts it",
    (".usd", ".usda", ".usdc", ".usdz"): "a USD stage: import it in Blender, and export it as {stem}.glb",
    (".blend",): "a Blender file: export it there as {stem}.glb (File, Export, glTF 2.0)",
    (".fbx", ".3ds", ".x3d", ".wrl"): "a model that Blender reads: import it there, and export it as {stem}.glb",
    (".sh3d",): "a Sweet Home 3D file: export it there as {stem}.obj (3D view, Export to OBJ format)",
    (".skp",): "a SketchUp file: export it there as {stem}.dae or {stem}.glb",
    (".step", ".stp", ".iges", ".igs", ".fcstd"): "a CAD model: open it in FreeCAD, and export it as {stem}.glb",
    (".pcd", ".las", ".laz", ".e57", ".pts", ".xyz"): (
        "a point cloud, which has no surface: have MeshLab or CloudCompare reconstruct one, export it as {stem}.ply"
    ),
    (".splat", ".spz", ".ksplat"): (
        "a file of Gaussian splats, which have no surface: take the mesh of the program that made it as {stem}.glb, or "
        "map its depth images by `anm-mj map`"
    ),
    (".svg", ".dxf", ".dwg"): "a drawing: draw its walls up in a modeller such as Blender, and export it as {stem}.glb",
}
"""What files of other formats are, by suffix, and how they are converted."""


def _read_mjcf(src: Path, model_paths: Sequence[Path], report: ImportReport, **options: Any) -> ParsedScene:
    from anm_mj.scene.importing.readers.mjcf.read_world import read_mjcf  # Loads MuJoCo.

    return read_mjcf(src, model_paths, report, **options)


FORMATS = (
    SceneFormat("gazebo", is_gazebo, read_gazebo),
    SceneFormat("mjcf", is_mjcf, _read_mjcf),
    *(
        SceneFormat(data.name, partial(is_scene_instance, dataset=data), partial(read_scene_instance, data))
        for data in DATASETS
    ),
    *(SceneFormat(layout.name, layout.matches, partial(read_scan, layout), is_whole=True) for layout in SCAN_LAYOUTS),
    SceneFormat(
        "mesh", lambda src: src.is_file() and src.suffix.lower() in MESH_SUFFIXES, read_mesh_scene, is_whole=True
    ),
)
"""All formats; the first that matches a source is taken."""


def find_format(src: Path, name: str = "auto") -> SceneFormat:
    """The format of a source, or of that name. Raises SceneError if the source is missing, or there is no format."""
    if not os.path.exists(src):  # Unlike Path.exists, never an error.
        raise SceneError(
            f"{src} does not exist: give the path of a mesh file, a world, a data set's scene or a floor plan."
        )
    if name != "auto":
        named = next((form for form in FORMATS if form.name == name), None)
        if named is None:
            names = ", ".join(form.name for form in FORMATS)
            raise SceneError(f"There is no format {name!r}: give auto, floorplan or one of {names}.")
        return named
    try:
        found = next((form for form in FORMATS if form.matches(src)), None)
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): check its permissions.") from err
    if found is not None:
        return found
    if src.is_dir():
        raise SceneError(
            f"{src} is a folder of no format that can be imported: give a scene's own folder of Gibson, Matterport3D, "
            "HM3D or Replica, or a file in it."
        )
    for suffixes, what in _CONVERTERS.items():
        if src.suffix.lower() in suffixes:
            raise SceneError(f"{src} is {what.format(name=src.name, stem=src.stem)}, and import that.")
    raise SceneError(
        f"{src} is in no format that can be imported: give a mesh file ({', '.join(MESH_SUFFIXES)}), a Gazebo world "
        "(.world, .sdf), a MuJoCo world (.xml), a scene of a Habitat data set (.scene_instance.json) or a floor plan "
        "(.json)."
    )
