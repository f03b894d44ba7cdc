"""Cuts the polygons of a COLLADA file that are not convex, in its XML."""

import xml.etree.ElementTree as ET

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.scene.importing.readers.polygons import cut_polygons


def cut_collada(root: ET.Element) -> bool:
    """Write the polygons of a COLLADA file that a fan about their first corner does not cover as triangles, and tell
    whether there are any. What names nothing, or is no number, stays for the library to judge.
    """
    by_id = {own.get("id", ""): own for own in root.iter() if own.get("id")}
    is_cut = False
    for surface in root.iter():
        kind = _kind(surface)
        if kind not in ("polylist", "polygons"):
            continue
        try:
            is_cut = (_cut_polylist if kind == "polylist" else _cut_polygons)(surface, by_id) or is_cut
        # Next finds nothing.
        except (ValueError, LookupError, StopIteration):
            continue
    return is_cut


def _cut_polylist(surface: ET.Element, by_id: dict[str, ET.Element]) -> bool:
    vcount, p = (next(own for own in surface if _kind(own) == kind) for kind in ("vcount", "p"))
    cut = _cut(_whole(p).reshape(-1, _stride(surface)), _whole(vcount), surface, by_id)
    if cut:
        vcount.text = " ".join(str(len(own)) for own in cut)
        p.text = _text(np.concatenate(cut))
    return bool(cut)


def _cut_polygons(surface: ET.Element, by_id: dict[str, ET.Element]) -> bool:
    """The same for <polygons>, which have a <p> for each."""
    lists = [own for own in surface if _kind(own) == "p"]
    rows = [_whole(own).reshape(-1, _stride(surface)) for own in lists]
    counts = np.array([len(own) for own in rows], dtype=np.int64)
    cut = _cut(np.concatenate(rows), counts, surface, by_id)
    for own in lists if cut else ():
        surface.remove(own)
    for own in cut:
        ET.SubElement(surface, lists[0].tag).text = _text(own)
    return bool(cut)


def _cut(
    rows: Int64[np.ndarray, "c i"], counts: Int64[np.ndarray, " n"], surface: ET.Element, by_id: dict[str, ET.Element]
) -> list[Int64[np.ndarray, "_ i"]]:
    """Polygons of ``counts`` corners, whose indices are the rows, with triangles in the place of some; none if all are
    to stay.
    """
    if not len(counts) or counts.min() < 1 or counts.sum() != len(rows) or counts.max() < 4:
        return []
    points, column = _points(surface, by_id)
    ends = np.cumsum(counts)
    triangles: dict[int, Int64[np.ndarray, "t 3"]] = {}
    for count in np.unique(counts):
        numbers = np.flatnonzero(counts == count)
        corners = rows[(ends[numbers] - count)[:, None] + np.arange(count), column]
        triangles.update((int(numbers[row]), own) for row, own in cut_polygons(points, corners))
    if not triangles:
        return []
    return [
        part
        for number, own in enumerate(np.split(rows, ends[:-1]))
        for part in ([own[corners] for corners in triangles[number]] if number in triangles else [own])
    ]


def _points(surface: ET.Element, by_id: dict[str, ET.Element]) -> tuple[Float64[np.ndarray, "v 3"], int]:
    """The positions of a surface's vertices, and the column of its indices that names them."""
    vertex = _input(surface, "VERTEX")
    source = by_id[_input(by_id[vertex.get("source", "")[1:]], "POSITION").get("source", "")[1:]]
    numbers = next(own for own in source if _kind(own) == "float_array")
    accessor = next(own for own in source.iter() if _kind(own) == "accessor")
    stride, offset = (int(accessor.get(key, default)) for key, default in (("stride", "1"), ("offset", "0")))
    values = np.array((numbers.text or "").split(), dtype=np.float64)[offset:]
    if stride < 3 or not np.isfinite(values).all():
        raise ValueError("its positions are none")
    return values[: len(values) // stride * stride].reshape(-1, stride)[:, :3], int(vertex.get("offset", "0"))


def _input(element: ET.Element, semantic: str) -> ET.Element:
    return next(own for own in element if _kind(own) == "input" and own.get("semantic") == semantic)


def _stride(surface: ET.Element) -> int:
    """Indices of a corner."""
    return 1 + max(int(own.get("offset", "0")) for own in surface if _kind(own) == "input")


def _whole(element: ET.Element) -> Int64[np.ndarray, " n"]:
    return np.array((element.text or "").split(), dtype=np.int64)


def _text(indices: Int64[np.ndarray, "_ i"]) -> str:
    return " ".join(map(str, indices.ravel().tolist()))


def _kind(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]
