"""The simple shapes of SDF and URDF as submeshes about their own origin [m]: boxes, spheres, cylinders and so on."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float64

from anm_mj.scene.importing.readers.mjcf.geom_triangles import unit_box
from anm_mj.scene.importing.readers.sdf_pose import numbers
from anm_mj.scene.submesh import Submesh

_SECTIONS = 32
"""Faces around a round shape."""
_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_SIZES = {
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
    "cylinder": (("radius", 1),),
    "capsule": (("radius", 1),),
    "cone": (("radius", 1),),
    "polyline": (("height", 1),),
}
"""Measures, and of how many numbers each, without which a shape is none; a disc, a cylinder without length, is one."""


def shape_submesh(shape: ET.Element, name: str, outlines: Sequence[ET.Element] = ()) -> Submesh | None:
    """The submesh of a shape element of SDF (<box>, <sphere>, ...), or None if it is no simple shape or has no size.

    Boxes have texture coordinates from 0 to 1 on every face; ``outlines`` are further <polyline> elements of the same
    geometry. Raises SceneError if its measures are no numbers.
    """
    import trimesh

    if any(min(numbers(shape.find(tag), count, (1.0,) * count)) <= 0.0 for tag, count in _SIZES.get(shape.tag, ())):
        return None

    def number(tag: str, default: float) -> float:
        return numbers(shape.find(tag), 1, (default,))[0]

    if shape.tag == "box":
        x, y, z = numbers(shape.find("size"), 3, (1.0, 1.0, 1.0))
        return box_submesh((x, y, z), name) if min(x, y, z) >= 0.0 else None
    if shape.tag == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=number("radius", 1.0))
    elif shape.tag == "ellipsoid":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
        mesh.apply_scale(numbers(shape.find("radii"), 3, (1.0, 1.0, 1.0)))
    elif shape.tag == "cylinder":
        mesh = trimesh.creation.cylinder(number("radius", 0.5), number("length", 1.0), sections=_SECTIONS)
    elif shape.tag == "capsule":
        mesh = trimesh.creation.capsule(number("length", 1.0), number("radius", 0.5), count=(_SECTIONS, _SECTIONS))
        # SDF's is about its middle.
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    elif shape.tag == "cone":
        length = number("length", 1.0)
        mesh = trimesh.creation.cone(number("radius", 0.5), length, sections=_SECTIONS)
        mesh.apply_translation([0.0, 0.0, -length / 2.0])
    elif shape.tag == "polyline":
        return _extruded([shape, *outlines], name)
    else:
        return None
    return Submesh(name, np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))


def box_submesh(size_m: tuple[float, float, float], name: str) -> Submesh:
    """A box about the origin, each face with its own corners and texture coordinates from 0 to 1."""
    box = unit_box()
    uv = np.tile(_SQUARE, (6, 1))
    # On every wall u runs to the right and v up; the corners of the faces +y and -y begin elsewhere.
    for face, side in ((2, 1.0), (3, -1.0)):
        uv[4 * face : 4 * face + 4] = np.column_stack([-side * _SQUARE[:, 1], side * _SQUARE[:, 0]])
    return Submesh(name, 0.5 * box.unit * size_m, box.faces, uv=uv + 0.5)


def plane_submesh(size_m: tuple[float, float], normal: Float64[np.ndarray, "3"], name: str) -> Submesh:
    """A rectangle about the origin, with texture coordinates from 0 to 1."""
    import trimesh

    corners = np.column_stack([_SQUARE * size_m, np.zeros(4)])
    rotation = np.asarray(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], normal))[:3, :3]
    return Submesh(name, corners @ rotation.T, np.array([[0, 1, 2], [0, 2, 3]]), uv=_SQUARE + 0.5)


def _extruded(outlines: Sequence[ET.Element], name: str) -> Submesh | None:
    """<polyline> elements: outlines pulled up to a height; None if they enclose nothing or one crosses itself.

    As in Gazebo, an outline within another is a hole, and all are as high as the first.
    """
    import trimesh
    from shapely.geometry import Polygon

    points = [[numbers(point, 2, (0.0, 0.0)) for point in outline.findall("point")] for outline in outlines]
    areas = [Polygon(corners) for corners in points if len(corners) >= 3]
    if len(areas) < len(outlines) or not all(area.is_valid for area in areas):
        return None
    enclosed = reduce(lambda one, other: one.symmetric_difference(other), areas)
    height = numbers(outlines[0].find("height"), 1, (1.0,))[0]
    parts = [
        trimesh.creation.extrude_polygon(part, height)
        for part in getattr(enclosed, "geoms", [enclosed])
        if part.geom_type == "Polygon" and part.area > 0.0
    ]
    if not parts:
        return None
    mesh: Any = trimesh.util.concatenate(parts)
    return Submesh(name, np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
