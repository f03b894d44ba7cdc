"""Writes the faces of an OBJ file as the library reads them right: vertices counted from 1, polygons that a fan covers.

The library counts negative indices from the end of the file, where OBJ counts them from the line that they stand in,
and cuts every polygon into a fan about its first corner, which reaches beyond one that is not convex.
"""

from __future__ import annotations

import mapbox_earcut
import numpy as np
from jaxtyping import Bool, Float64, Int64

_BEYOND = 1e-6
"""A triangle of a fan is turned around by more than this share of the polygon where the fan reaches beyond it."""


def is_plain_face(line: bytes) -> bool:
    """Whether a face is a triangle that names its vertices from 1 and has no comment behind it."""
    return b"-" not in line and b"#" not in line and len(line.split()) <= 4


def with_plain_faces(text: bytes) -> bytes:
    """An OBJ file with faces that are read as they are meant."""
    lines = text.split(b"\n")
    vertices: list[bytes] = []
    others = {b"vt": 0, b"vn": 0}
    polygons: dict[int, list[int]] = {}
    for number, line in enumerate(lines):
        if line.startswith(b"v "):
            vertices.append(line)
        elif line.startswith((b"vt ", b"vn ")):
            others[line[:2]] += 1
        elif line.startswith(b"f ") and not is_plain_face(line):
            corners = line.partition(b"#")[0].split()[1:]
            seen = (len(vertices), others[b"vt"], others[b"vn"])
            lines[number] = b"f " + b" ".join(
                _from_one(corner, seen) if b"-" in corner else corner for corner in corners
            )
            if len(corners) > 3:
                polygons.setdefault(len(corners), []).append(number)
    if polygons:
        points = np.array([line.split()[1:4] for line in vertices], dtype=np.float64)
        for numbers in polygons.values():
            _cut(lines, numbers, points)
    return b"\n".join(lines)


def _from_one(corner: bytes, seen: tuple[int, int, int]) -> bytes:
    """A corner such as -1/-1 with indices from 1, where so many vertices, texture coordinates and normals stand above.

    Raises:
        ValueError: It counts back beyond the first.
    """
    words = []
    for word, number in zip(corner.split(b"/"), seen, strict=False):
        index = int(word) if word else 0
        if number + index < 0:
            raise ValueError(f"a face names entry {index}, but {number} stand above it")
        words.append(b"%d" % (number + index + 1) if index < 0 else word)
    return b"/".join(words)


def _cut(lines: list[bytes], numbers: list[int], points: Float64[np.ndarray, "v 3"]) -> None:
    """Cut those of the polygons in the lines ``numbers``, of as many corners each, that a fan does not cover."""
    corners = [lines[number].split()[1:] for number in numbers]
    index = np.array([[int(corner.partition(b"/")[0]) for corner in own] for own in corners]) - 1
    if index.min() < 0 or index.max() >= len(points):
        return  # The library refuses it.
    outlines = points[index]
    normals = np.cross(outlines, np.roll(outlines, -1, axis=1)).sum(axis=1)
    for own in np.flatnonzero(_exceeded_by_fan(outlines, normals)):
        triangles = _ears(outlines[own], normals[own])
        if len(triangles):
            lines[numbers[own]] = b"\n".join(
                b"f " + b" ".join(corners[own][corner] for corner in triangle) for triangle in triangles
            )


def _exceeded_by_fan(
    outlines: Float64[np.ndarray, "n k 3"], normals: Float64[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether a fan about the first corner of a polygon has a triangle that lies the other way round."""
    spokes = outlines[:, 1:] - outlines[:, :1]
    turned = np.cross(spokes[:, :-1], spokes[:, 1:])
    return (np.einsum("nki,ni->nk", turned, normals) < -_BEYOND * np.sum(normals**2, axis=1)[:, None]).any(axis=1)


def _ears(outline: Float64[np.ndarray, "k 3"], normal: Float64[np.ndarray, "3"]) -> Int64[np.ndarray, "t 3"]:
    """Triangles of a polygon by ear clipping in the plane of two axes, turned as its outline; none if it has none."""
    flat = np.delete(outline, int(np.argmax(np.abs(normal))), axis=1)
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32))
    triangles = found.reshape(-1, 3).astype(np.int64)
    corners = outline[triangles]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal
    triangles[turned < 0.0] = triangles[turned < 0.0][:, ::-1]
    return triangles
