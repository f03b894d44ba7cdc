"""Reads the visual meshes and shapes of a URDF file, with all joints at zero."""

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from anm_mj.errors import SceneError
from anm_mj.frames import rigid_transform
from anm_mj.scene.importing.readers.import_limits import TriangleBudget
from anm_mj.scene.importing.readers.import_report import NO_MESH, NO_SHAPE, ImportReport
from anm_mj.scene.importing.readers.model_path import Places, find_uri, places_of
from anm_mj.scene.importing.readers.read_mesh import PLAIN_RGB, read_mesh
from anm_mj.scene.importing.readers.sdf_pose import rpy_matrix
from anm_mj.scene.importing.readers.sdf_shape import box_submesh, shape_submesh
from anm_mj.scene.submesh import Submesh, transformed
from anm_mj.utils.read_file import read_bytes


def read_urdf(path: Path, report: ImportReport, folders: Sequence[Path] = ()) -> list[Submesh]:
    """Submeshes of an object in the frame of its root link [m].

    Meshes may lie in its own folder, up to three above, and in ``folders``. Raises SceneError if the file is no URDF, a
    joint names a link that is not there, or a mesh cannot be read.
    """
    try:
        robot = ET.fromstring(read_bytes(path).lstrip())
    except (OSError, ValueError, LookupError, ET.ParseError) as err:
        raise SceneError(f"{path} is damaged or no URDF file ({err}): download it again.") from err
    joints = {_named(joint, "child", "link"): joint for joint in robot.findall("joint")}
    # A colour may be given once for all links, or where a link first names it; many exporters leave the name empty.
    colours = {
        name: own for own in robot.iter("material") if (name := own.get("name")) and own.find("color") is not None
    }
    submeshes, places, budget = [], places_of(path, folders), TriangleBudget(path)
    for link in robot.findall("link"):
        T_root_link, name, seen = np.eye(4), link.get("name", ""), set()
        while name in joints and name not in seen:
            seen.add(name)
            T_root_link = _origin(joints[name]) @ T_root_link
            name = _named(joints[name], "parent", "link")
        for visual in link.findall("visual"):
            T_root_visual = T_root_link @ _origin(visual)
            for submesh in _visual_submeshes(visual, colours, path, places, report):
                budget.spend(submesh)
                submeshes.append(transformed(submesh, T_root_visual[:3, :3], T_root_visual[:3, 3]))
    return submeshes


def _named(element: ET.Element, tag: str, attribute: str) -> str:
    child = element.find(tag)
    return "" if child is None else child.get(attribute, "")


def _origin(element: ET.Element) -> Float64[np.ndarray, "4 4"]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    rotation = rpy_matrix(*_numbers(origin.get("rpy", "0 0 0")))
    return rigid_transform(rotation.ravel(), np.array(_numbers(origin.get("xyz", "0 0 0"))))


def _visual_submeshes(
    visual: ET.Element, colours: Mapping[str, ET.Element], path: Path, places: Places, report: ImportReport
) -> list[Submesh]:
    shape = next(iter(visual.findall("geometry/*")), None)
    if shape is None:
        return []
    colour = visual.find("material/color")
    if colour is None and (named := colours.get(_named(visual, "material", "name"))) is not None:
        colour = named.find("color")
    rgb = PLAIN_RGB if colour is None else _numbers(colour.get("rgba", ""))
    if shape.tag == "mesh":
        file = find_uri(shape.get("filename", ""), path.absolute().parent, places, report)
        if file is None or not os.path.isfile(file):
            report.add(NO_MESH, shape.get("filename", ""))
            return []
        scale = np.diag(_numbers(shape.get("scale", "1 1 1")))
        return [transformed(submesh, scale) for submesh in read_mesh(file, report)]
    if shape.tag == "box":
        submesh = box_submesh(_numbers(shape.get("size", "")), path.stem)
    else:
        # URDF keeps in attributes what SDF keeps in elements.
        as_sdf = ET.Element(shape.tag)
        for key, value in shape.items():
            ET.SubElement(as_sdf, key).text = value
        submesh = shape_submesh(as_sdf, path.stem)
    if submesh is None:
        report.add(NO_SHAPE, f"<{shape.tag}> of {path.name}")
        return []
    return [Submesh(submesh.name, submesh.vertices_m, submesh.faces, rgb)]


def _numbers(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(word) for word in text.split()[:3])
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x + y + z):
        raise SceneError(f"{text!r} should be 3 numbers: fix the URDF file.")
    return x, y, z
