"""Reads Habitat scenes of a stage and objects: ReplicaCAD, HSSD and other datasets.

A .scene_instance.json places templates, y up and in metres. A template is a .glb, found by name in the folder of the
dataset, or a .json beside it that names the .glb and its axes. Articulated objects stand in their rest pose.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import LimitError, TriangleBudget
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport
from anm_mj.scene.importing.readers.model_path import places_of
from anm_mj.scene.importing.readers.parsed_scene import UNKNOWN_LICENCE, ParsedScene
from anm_mj.scene.importing.readers.read_mesh import read_mesh
from anm_mj.scene.importing.readers.sdf_pose import quaternion_matrix
from anm_mj.scene.importing.readers.urdf import read_urdf
from anm_mj.scene.submesh import Submesh, middle_of, transformed
from anm_mj.utils.read_file import read_json

_SCENE_SUFFIX = ".scene_instance.json"
_DATASET_SUFFIX = ".scene_dataset_config.json"
_TEMPLATE_SUFFIXES = (".stage_config.json", ".object_config.json", ".ao_config.json", ".glb", ".gltf", ".urdf")
"""What a template's file may end with, most telling first."""

_NO_TEMPLATE = "Not found in the dataset's folder: {names}, which are left out."


@dataclass(frozen=True)
class Dataset:
    """A dataset whose scenes are composed."""

    name: str
    title: str
    licence: str
    prefix: str
    """How the name of its .scene_dataset_config.json begins, in small letters."""


DATASETS = (
    Dataset("hssd", "Habitat Synthetic Scenes Dataset (HSSD)", "CC BY-NC 4.0", "hssd"),
    Dataset("replicacad", "ReplicaCAD", "CC BY 4.0", "replicacad"),
    Dataset("habitat", "Habitat dataset", UNKNOWN_LICENCE, ""),
)
"""The last one takes all others."""


def is_scene_instance(src: Path, dataset: Dataset) -> bool:
    """Whether a file is a scene of a dataset."""
    if not (os.path.isfile(src) and src.name.endswith(_SCENE_SUFFIX)):
        return False
    config = _dataset_config(src)
    return not dataset.prefix or (config is not None and config.name.lower().startswith(dataset.prefix))


def read_scene_instance(dataset: Dataset, src: Path, model_paths: Sequence[Path], report: ImportReport) -> ParsedScene:
    """The stage and objects of one scene, each where it stands. Raises SceneError if the file is no scene, or lies
    outside a dataset's folder, or nothing of it is there.
    """
    if not (os.path.isfile(src) and src.name.endswith(_SCENE_SUFFIX)):
        raise SceneError(f"{src} is no scene of a {dataset.title}: give one of its *{_SCENE_SUFFIX} files.")
    config = _dataset_config(src)
    if config is None and not model_paths:
        raise SceneError(
            f"{src} lies in no dataset: give a file below the folder that holds *{_DATASET_SUFFIX}, or name that "
            "folder with --model-path."
        )
    folders = [*model_paths, *([] if config is None else [config.parent])]
    scene = _read_json(src)
    try:
        placements = _placements(scene)
    except (TypeError, ValueError, KeyError, AttributeError) as err:
        raise SceneError(f"{src} is damaged or no Habitat scene ({err}): download it again.") from err
    names = {placement.template for placement in placements}
    templates = _Templates(src, folders, names, report)
    submeshes = [submesh for placement in placements for submesh in templates.placed(placement)]
    if not submeshes:
        raise SceneError(f"Nothing that {src} names is in {folders[0]}: download the dataset's stages and objects.")
    title = (
        dataset.title if config is None or dataset.prefix else f"dataset {config.name.removesuffix(_DATASET_SUFFIX)}"
    )
    return ParsedScene(
        submeshes,
        source=f"{title}, scene {src.name.removesuffix(_SCENE_SUFFIX)}",
        licence=dataset.licence,
        up="y",
        up_certainty=float("inf"),
        scale=1.0,
    )


def _dataset_config(src: Path) -> Path | None:
    for folder in src.absolute().parents:
        found = sorted(folder.glob(f"*{_DATASET_SUFFIX}"))
        if found:
            return found[0]
    return None


def _read_json(path: Path) -> dict[str, Any]:
    try:
        entries = read_json(path)
    except (OSError, ValueError) as err:
        raise SceneError(f"{path} cannot be read ({err}): download it again.") from err
    if not isinstance(entries, dict):
        raise SceneError(f"{path} is no Habitat scene: its JSON is not an object.")
    return entries


@dataclass(frozen=True, eq=False)
class _Placement:
    template: str
    """The template's name, without folders."""
    rotation: Float64[np.ndarray, "3 3"]
    translation_m: Float64[np.ndarray, "3"]
    scale: Float64[np.ndarray, "3"]
    by_centre: bool
    """Whether ``translation_m`` is where the object's centre of mass is, rather than its origin."""


def _placements(scene: dict[str, Any]) -> list[_Placement]:
    # Habitat's default is the centre of mass, which it takes from the bounding box unless the template states it.
    usual = str(scene.get("translation_origin", "com"))
    objects = scene.get("object_instances", [])
    entries = [(entry, str(entry.get("translation_origin", usual)).lower() == "com") for entry in objects]
    # Instances of a stage or of an articulated object have origins of their own kind.
    entries += [(entry, False) for entry in scene.get("articulated_object_instances", [])]
    if scene.get("stage_instance"):
        entries.insert(0, (scene["stage_instance"], False))
    placements = []
    for entry, by_centre in entries:
        scale = np.ones(3) * float(entry.get("uniform_scale", 1.0))
        scale = scale * np.asarray(entry.get("non_uniform_scale", (1.0, 1.0, 1.0)), dtype=np.float64)
        translation = np.asarray(entry.get("translation", (0.0, 0.0, 0.0)), dtype=np.float64)
        w, x, y, z = (float(value) for value in entry.get("rotation", (1.0, 0.0, 0.0, 0.0)))
        if scale.shape != (3,) or translation.shape != (3,) or not np.isfinite([*scale, *translation]).all():
            raise ValueError(f"{entry['template_name']} has no proper translation or scale")
        name = str(entry["template_name"]).rpartition("/")[2]
        placements.append(_Placement(name, quaternion_matrix((w, x, y, z)), translation, scale, by_centre))
    return placements


class _Templates:
    def __init__(self, src: Path, folders: Sequence[Path], names: set[str], report: ImportReport) -> None:
        self._folders = folders
        self._places = places_of(src, folders)
        self._files = _find_templates(folders, names)
        self._report = report
        self._budget = TriangleBudget(src)
        self._submeshes: dict[str, list[Submesh]] = {}
        self._centres_m: dict[str, Float64[np.ndarray, "3"]] = {}
        """Centres of mass in the axes of the objects, by template; only those that are stated."""

    def placed(self, placement: _Placement) -> list[Submesh]:
        """The submeshes of an instance, in the scene (y up) [m]; none, with a note, where they cannot be had."""
        if placement.template not in self._submeshes:
            self._submeshes[placement.template] = self._read(placement.template)
        submeshes = self._submeshes[placement.template]
        for submesh in submeshes:
            self._budget.spend(submesh)
        shift = placement.translation_m
        matrix = placement.rotation * placement.scale
        if submeshes and placement.by_centre:
            stated = self._centres_m.get(placement.template)
            shift = shift - matrix @ (middle_of(submeshes) if stated is None else stated)
        return [replace(transformed(submesh, matrix, shift), part=placement.template) for submesh in submeshes]

    def _read(self, name: str) -> list[Submesh]:
        path = self._files.get(name)
        if path is None:
            self._report.add(_NO_TEMPLATE, name)
            return []
        # A template may be linked from elsewhere.
        if self._places.first([path], path.parent, self._report) is None:
            return []
        try:
            config = _read_json(path) if path.suffix == ".json" else None
            if config is not None:
                asset = config.get("urdf_filepath") or config.get("render_asset") or ""
                asset_path = self._places.first([path.parent / str(asset)], path.parent, self._report)
                if not asset or asset_path is None or not os.path.isfile(asset_path):
                    self._report.add(_NO_TEMPLATE, Path(str(asset)).name or name)
                    return []
                path = asset_path
            if path.suffix == ".urdf":
                return read_urdf(path, self._report, self._folders)
            if config is None:
                return read_mesh(path, self._report)
            scale = np.asarray(config.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
            turn = _canonical_axes(config) * scale * float(config.get("units_to_meters", 1.0))
            centre_m = _stated_centre(config)
            if centre_m is not None:
                self._centres_m[name] = centre_m * scale
            return [transformed(submesh, turn) for submesh in read_mesh(path, self._report)]
        except LimitError:
            raise
        except (SceneError, TypeError, ValueError) as err:
            self._report.add(LEFT_OUT, f"{name} ({err})")
            return []


def _stated_centre(config: dict[str, Any]) -> Float64[np.ndarray, "3"] | None:
    """The centre of mass that the configuration of an object states [m]; None where it states none."""
    stated = config.get("COM")
    if not isinstance(stated, list) or len(stated) != 3 or any(type(own) not in (int, float) for own in stated):
        return None
    centre_m = np.array(stated, dtype=np.float64)
    return centre_m if np.isfinite(centre_m).all() else None


def _canonical_axes(config: dict[str, Any]) -> Float64[np.ndarray, "3 3"]:
    """Rotation from the axes of an asset, whose ``up`` and ``front`` its configuration states, to y up and -z front."""
    up = np.asarray(config.get("up", (0.0, 1.0, 0.0)), dtype=np.float64)
    front = np.asarray(config.get("front", (0.0, 0.0, -1.0)), dtype=np.float64)
    if up.shape != (3,) or front.shape != (3,) or np.linalg.norm(np.cross(front, up)) < 1e-6:
        raise ValueError("its up and front are no two directions")
    up = up / np.linalg.norm(up)
    right = np.cross(front, up)
    right /= np.linalg.norm(right)
    return np.stack([right, up, np.cross(right, up)])


def _find_templates(folders: Sequence[Path], names: set[str]) -> dict[str, Path]:
    found: dict[str, tuple[int, Path]] = {}
    for folder in folders:
        for parent, below, files in os.walk(folder):
            below.sort()
            for file in sorted(files):
                suffix = next((suffix for suffix in _TEMPLATE_SUFFIXES if file.endswith(suffix)), None)
                name = file.removesuffix(suffix or "")
                if suffix is None or name not in names:
                    continue
                rank = _TEMPLATE_SUFFIXES.index(suffix)
                if name not in found or rank < found[name][0]:
                    found[name] = (rank, Path(parent) / file)
    return {name: path for name, (_, path) in found.items()}
