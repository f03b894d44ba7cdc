"""Puts the models that an SDF world includes in their places, wherever their files are."""

import re
import xml.etree.ElementTree as ET
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers.import_limits import check_includes
from anm_mj.scene.importing.readers.import_report import NO_SHAPE, ImportReport
from anm_mj.scene.importing.readers.model_path import XACRO, Places, expanded, find_uri, model_file, uri_name
from anm_mj.scene.importing.readers.sdf_pose import FRAMED, Scope, is_true, relative_to, text_of
from anm_mj.utils.read_file import read_bytes

FOLDER = "anm_mj_folder"
"""Attribute of a model: the folder of its file, from which relative paths start."""
_MAX_DEPTH = 16
_NO_MODEL = (
    "Not found: the models {names}, which are left out; give the folders that hold them with --model-path, "
    "or in GZ_SIM_RESOURCE_PATH or GAZEBO_MODEL_PATH."
)
_NO_WORLD = "Of several worlds the first is taken; left out: {names}."
_GROUND_PLANE = (
    '<model name="ground_plane"><link name="link"><visual name="visual"><geometry><plane><normal>0 0 1</normal>'
    "<size>100 100</size></plane></geometry></visual></link></model>"
)
"""Gazebo's own ground plane, for where Gazebo is not installed."""


def read_world(file: Path, places: Places, report: ImportReport) -> tuple[ET.Element, set[str]]:
    """The first world of an SDF file, or its models if it has none, and the names of the model folders that it uses.

    Models that a saved state inserts are among the world's own. Raises SceneError if the file is no SDF, or models
    include themselves.
    """
    root = _parse(file)
    if root.tag != "sdf":
        raise SceneError(f"{file} is no SDF file: it begins with <{root.tag}>, not <sdf>.")
    worlds = root.findall("world")
    for other in worlds[1:]:
        report.add(_NO_WORLD, other.get("name", "without a name"))
    world = worlds[0] if worlds else root
    world.extend(deepcopy(list(world.findall("state/insertions/model"))))
    includes = _Includes(file, places, report)
    for child in list(world):
        includes.expand(world, child, file.absolute().parent, 0)
    return world, includes.models


@dataclass
class _Includes:
    _file: Path
    _places: Places
    _report: ImportReport
    models: set[str] = field(default_factory=set)
    _number: int = 0
    """Includes so far: a few models that include one another may make any number."""

    def expand(self, parent: ET.Element, child: ET.Element, folder: Path, depth: int) -> None:
        """Put the model that an <include> names in its place, and mark models with the folder they came from."""
        if depth > _MAX_DEPTH:
            raise SceneError(
                f"Models are included in one another more than {_MAX_DEPTH} deep: does one include itself?"
            )
        if child.tag == "include":
            self._include(parent, child, folder, depth)
        elif child.tag == "model":
            child.set(FOLDER, str(folder))
            for inner in list(child):
                self.expand(child, inner, folder, depth + 1)

    def _include(self, parent: ET.Element, include: ET.Element, folder: Path, depth: int) -> None:
        self._number += 1
        check_includes(self._file, self._number)
        at = list(parent).index(include)
        parent.remove(include)
        uri = text_of(include, "uri")
        name = uri_name(uri)
        # Gazebo's own come under several names; Fuel's "Ground Plane" is "ground_plane" of the former model database.
        standard = name.lower().replace(" ", "_")
        found = find_uri(uri, folder, self._places, self._report)
        file = None if found is None else model_file(found)
        # The file may be linked from elsewhere.
        file = None if file is None else self._places.first([file], folder, self._report)
        if file is None:
            if standard == "ground_plane":
                parent.insert(at, ET.fromstring(_GROUND_PLANE))
            # Gazebo's sun is a light.
            elif standard != "sun":
                self._report.add(_NO_MODEL, name)
            return
        if file.samefile(self._file):
            raise SceneError(f"{file} includes itself: remove that <include>.")
        root = _parse(file)
        model = next((root.find(tag) for tag in ("model", "world/model") if root.find(tag) is not None), None)
        if model is None:
            # A light has no surface.
            others = [root.tag] if root.tag != "sdf" else [child.tag for child in root if child.tag != "light"]
            for kind in others:
                self._report.add(NO_SHAPE, f"<{kind}> of {file.name}")
            return
        self.models.add(file.parent.name)
        if include.findtext("name"):
            model.set("name", text_of(include, "name"))
        if include.get("placement_frame") or include.findtext("placement_frame"):
            model.set("placement_frame", include.get("placement_frame") or include.findtext("placement_frame") or "")
        pose, stated = include.find("pose"), model.find("pose")
        if pose is not None:
            if stated is not None:
                model.remove(stated)
            model.append(pose)
        parent.insert(at, model)
        self.expand(parent, model, file.absolute().parent, depth + 1)
        if parent.tag == "model" and is_true(include.get("merge")):
            _merge(parent, model)


def _merge(parent: ET.Element, model: ET.Element) -> None:
    """Put what an included model holds in its place; a frame of its name stands for the model's own (SDFormat 1.9)."""
    name = f"_merged__{model.get('name', '')}__model__"
    frame = ET.Element("frame", name=name)
    frame.extend(model.findall("pose"))
    frames, placed = [frame], model.get("placement_frame")
    if placed:
        # The pose is that of the placement frame, and the model's own follows from it.
        T = np.linalg.inv(Scope(model, np.eye(4), {}, "").frame(placed))
        numbers = (*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
        frame.set("name", f"{name}placement")
        frames.append(ET.Element("frame", name=name))
        pose = ET.SubElement(frames[-1], "pose", relative_to=f"{name}placement", rotation_format="quat_xyzw")
        pose.text = " ".join(map(repr, map(float, numbers)))
    at = list(parent).index(model)
    parent.remove(model)
    parts = [child for child in model if child.tag in FRAMED]
    for part in parts:
        if part.tag != "model":
            part.set(FOLDER, model.get(FOLDER, ""))
        # What a nested model holds is relative to that model.
        for element in (part,) if part.tag == "model" else part.iter():
            for child in (element, *element.findall("pose"), *element.findall("xyz")):
                for key in ("relative_to", "attached_to", "expressed_in"):
                    if child.get(key) == "__model__":
                        child.set(key, name)
        if part.tag != "joint" and not (relative_to(part) or part.get("attached_to")):
            pose = part.find("pose")
            (ET.SubElement(part, "pose") if pose is None else pose).set("relative_to", name)
    parent[at:at] = [*frames, *parts]


def _parse(file: Path) -> ET.Element:
    try:
        # Gazebo reads a file with blank lines before its declaration too.
        content = (expanded(file) if file.suffix.lower() == XACRO else read_bytes(file)).lstrip()
        try:
            return _with_axes(ET.fromstring(content))
        except ET.ParseError:
            # Gazebo takes comments that XML forbids, those with two hyphens in them.
            return _with_axes(ET.fromstring(_without_comments(content)))
    except ET.ParseError as err:
        raise SceneError(f"{file} is damaged or no SDF file ({err}): fix it or save the world again.") from err
    except (OSError, ValueError, LookupError) as err:
        raise SceneError(f"{file} cannot be read ({err}): check its permissions and its encoding.") from err


def _with_axes(root: ET.Element) -> ET.Element:
    """The SDF of a file, with what holds up to version 1.4 said in each joint: that its axis is one of the model's
    frame.
    """
    if re.fullmatch(r"(?:0|1\.[0-4])(?:\..*)?", root.get("version", "")):
        for axis in root.iter("axis"):
            if axis.find("use_parent_model_frame") is None:
                ET.SubElement(axis, "use_parent_model_frame").text = "true"
    return root


def _without_comments(content: bytes) -> bytes:
    """An XML file with the lines of its comments left blank, up to the first one that does not end."""
    kept, at = [], 0
    while (start := content.find(b"<!--", at)) >= 0 and (end := content.find(b"-->", start + 4)) >= 0:
        kept += [content[at:start], b"\n" * content.count(b"\n", start, end)]
        at = end + 3
    return b"".join([*kept, content[at:]])


def part_path(part: str, element: ET.Element, default: str) -> str:
    """The part that a model or link is, within another."""
    name = (element.get("name") or default).replace("/", "_")
    return f"{part}/{name}" if part else name
