"""Checks a COLLADA file before it is read: how much its scene holds, and what of it cannot be read.

The library that reads COLLADA leaves out what it cannot read without a word.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from anm_mj.scene.importing.readers.collada_polygons import cut_collada
from anm_mj.scene.importing.readers.import_limits import MAX_MESH_MIB, check_parts, check_triangles
from anm_mj.scene.importing.readers.import_report import LEFT_OUT, ImportReport, MeshFacts, damaged
from anm_mj.utils.read_file import read_bytes

_NOT_SHOWN = (
    "Left out, because they stand in a visual scene that the file does not show: the geometries {names}; export them "
    "in the scene that its <scene> names."
)
_SHADERS = ("constant", "lambert", "phong", "blinn")
_SURFACES = ("triangles", "tristrips", "trifans", "polylist", "polygons")


def check_collada(src: Path, report: ImportReport) -> MeshFacts:
    """Count what the scene of a COLLADA file holds, and note what of it is known not to be read. Raises SceneError if
    the file is no XML, a node stands in itself or is not there, or there is too much in it.
    """
    try:
        text = read_bytes(src, MAX_MESH_MIB)
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError, OSError, RecursionError) as err:
        raise damaged(src, err) from err
    count = _Count(src, root, report)
    try:
        shown, hidden = _visual_scenes(root)
        placed = [count.of(scene, ()) for scene in shown]
        geometries = tuple(count.shown)
        for scene in hidden:
            count.of(scene, ())
    except RecursionError:
        raise damaged(src, "its nodes are nested too deeply") from None
    check_parts(src, sum(parts for parts, _ in placed))
    check_triangles(src, sum(triangles for _, triangles in placed))
    for name in list(count.shown)[len(geometries) :]:
        report.add(_NOT_SHOWN, f"{name!r} of {src.name}")
    # The library takes a comment for an element.
    uneven = b"<!--" in text or text.count(b"<?") > 1
    uneven = show_light(root) or uneven
    return MeshFacts(geometries=geometries, uneven=cut_collada(root) or uneven)


def even_collada(src: Path) -> bytes:
    """A COLLADA file without comments, processing instructions, and polygons that a fan does not cover, and with the
    light of surfaces that are black for their colour.
    """
    root = ET.fromstring(read_bytes(src, MAX_MESH_MIB))
    show_light(root)
    cut_collada(root)
    return ET.tostring(root)


def show_light(root: ET.Element) -> bool:
    """Give the surfaces of a COLLADA file that are black, or have no colour, that of their own light, which others
    lose, and tell whether any give light.
    """
    is_changed = False
    for shader in [own for own in root.iter() if _kind(own) in _SHADERS]:
        light, colour = (next((own for own in shader if _kind(own) == kind), None) for kind in ("emission", "diffuse"))
        if light is None or _is_black(light):
            continue
        # The library looks for the picture of the light where it has that of the colour.
        shader.remove(light)
        if colour is None:
            colour = ET.SubElement(shader, light.tag.replace("emission", "diffuse"))
        if not len(colour) or _is_black(colour):
            colour[:] = list(light)
        is_changed = True
    return is_changed


def _is_black(element: ET.Element) -> bool:
    """Whether a shader's property is a colour without red, green and blue; a texture is none."""
    words = [word for own in element if _kind(own) == "color" for word in (own.text or "").split()[:3]]
    try:
        return bool(words) and not any(float(word) for word in words)
    except ValueError:
        return False


def collada_nodes(src: Path) -> dict[str, set[str]]:
    """The ids of the geometries that the nodes of a COLLADA file place themselves, by the names of the nodes. Raises
    OSError or ValueError if it cannot be read.
    """
    try:
        root = ET.fromstring(read_bytes(src, MAX_MESH_MIB))
    except (ET.ParseError, RecursionError) as err:
        raise ValueError(str(err)) from err
    found: dict[str, set[str]] = {}
    for node in _all(root, "node"):
        ids = {own.get("url", "").removeprefix("#") for own in node if _kind(own) == "instance_geometry"}
        found.setdefault(node.get("name", node.get("id", "")), set()).update(ids)
    return found


def _visual_scenes(root: ET.Element) -> tuple[list[ET.Element], list[ET.Element]]:
    """The scene that the file shows, and its others; all of them where it shows none of its own."""
    scenes = list(_all(root, "visual_scene"))
    named = [own.get("url", "").removeprefix("#") for own in _all(root, "instance_visual_scene")]
    shown = [scene for scene in scenes if scene.get("id", "") in named]
    return (shown, [scene for scene in scenes if scene not in shown]) if shown else (scenes, [])


class _Count:
    """Counts meshes and triangles below an element; nodes may stand in other nodes, each several times."""

    def __init__(self, src: Path, root: ET.Element, report: ImportReport) -> None:
        self.shown: dict[str, None] = {}
        """Ids of the geometries that were met, without those of lines alone."""
        self._src = src
        self._report = report
        self._nodes = {node.get("id", ""): node for node in _all(root, "node")}
        self._geometries = {geometry.get("id", ""): geometry for geometry in _all(root, "geometry")}
        self._triangles = {name: _triangles(geometry) for name, geometry in self._geometries.items()}
        self._below: dict[str, tuple[int, int]] = {}

    def of(self, element: ET.Element, above: tuple[str, ...]) -> tuple[int, int]:
        """Meshes and triangles below an element that stands in the nodes ``above``."""
        parts, triangles = 0, 0
        for inner in element.iter():
            kind, url = _kind(inner), inner.get("url", "").removeprefix("#")
            if kind == "instance_geometry":
                parts, triangles = parts + 1, triangles + self._triangles.get(url, 0)
                self._show(url)
            elif kind == "instance_controller":
                parts += 1
                self._leave_out("animated mesh", url)
            elif kind == "instance_node" and url in self._nodes:
                if url in above:
                    raise damaged(self._src, f"node {url!r} stands in itself")
                if url not in self._below:
                    self._below[url] = self.of(self._nodes[url], (*above, url))
                parts, triangles = parts + self._below[url][0], triangles + self._below[url][1]
            elif kind == "instance_node":
                raise damaged(self._src, f"it names node {url!r}, which is not there")
        return parts, triangles

    def _show(self, name: str) -> None:
        if name in self.shown:
            return
        geometry = self._geometries.get(name)
        if geometry is None or next(_all(geometry, "mesh"), None) is None or self._triangles[name]:
            self.shown[name] = None
        if geometry is not None and next(_all(geometry, "ph"), None) is not None:
            self._leave_out("polygons with holes in geometry", name)

    def _leave_out(self, kind: str, name: str) -> None:
        self._report.add(LEFT_OUT, f"{kind} {name!r} of {self._src.name}")


def _kind(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _all(element: ET.Element, kind: str) -> Iterator[ET.Element]:
    return (inner for inner in element.iter() if _kind(inner) == kind)


def _triangles(geometry: ET.Element) -> int:
    """About how many triangles a geometry has; none only if it has none."""
    total = 0
    for surface in geometry.iter():
        if _kind(surface) not in _SURFACES:
            continue
        offsets = [int(text) for own in _all(surface, "input") if (text := own.get("offset", "0")).isdecimal()]
        lists = [words for own in _all(surface, "p") if (words := _words(own))]
        corners = sum(lists) // (1 + max(offsets, default=0))
        faces = sum(_words(own) for own in _all(surface, "vcount")) or len(lists)
        if lists:
            total += max(1, corners // 3 if _kind(surface) == "triangles" else corners - 2 * faces)
    return total


def _words(element: ET.Element) -> int:
    """About how many numbers an element holds, without making a list of them all."""
    text = (element.text or "").strip()
    return sum(text.count(space) for space in " \n\t\r") + 1 if text else 0
