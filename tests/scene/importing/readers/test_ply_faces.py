"""Faces of PLY files, of any number of corners."""

import struct
from itertools import pairwise

import numpy as np
import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.import_limits import LimitError
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.ply_faces import even_ply
from anm_mj.scene.importing.readers.read_mesh import read_mesh
from anm_mj.scene.submesh import merge_geometry
from tests.scene.importing.readers.test_collada_polygons import area_m2
from tests.scene.importing.readers.test_obj_check import L_SHAPE, U_SHAPE

_SQUARE = [(10, 0), (12, 0), (12, 2), (10, 2)]
_TRIANGLE = [(20, 0), (22, 0), (22, 2)]
_FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"]
_KINDS = {"uchar": "B", "int": "i", "float": "f"}


def _write(path, outlines, kind="ascii", vertex=(), face=(), notes=()):
    """Outlines at z = 1. ``vertex`` and ``face`` are more properties, each words and the numbers of every row."""
    points = [(x, y, 1.0) for outline in outlines for x, y in outline]
    vertex = [(f"float {axis}", [[point[k]] for point in points]) for k, axis in enumerate("xyz")] + list(vertex)
    ends = np.cumsum([0, *map(len, outlines)]).tolist()
    corners = [list(range(first, end)) for first, end in pairwise(ends)]
    face = [("list uchar int vertex_indices", corners), *face]
    lines = ["ply", f"format {kind} 1.0", *notes]
    body = b""
    for name, number, columns in (("vertex", len(points), vertex), ("face", len(outlines), face)):
        lines += [f"element {name} {number}", *(f"property {words}" for words, _ in columns)]
        for row in range(number):
            numbers = []
            for words, values in columns:
                types = words.split()
                numbers += [(types[1], len(values[row]))] if types[0] == "list" else []
                numbers += [(types[-2], value) for value in values[row]]
            if kind == "ascii":
                body += " ".join(str(value) for _, value in numbers).encode() + b"\n"
            else:
                order = "<" if "little" in kind else ">"
                body += b"".join(struct.pack(order + _KINDS[type_], value) for type_, value in numbers)
    path.write_bytes("\n".join([*lines, "end_header", ""]).encode() + body)
    return path


def _triangles(src):
    vertices, faces = merge_geometry(read_mesh(src, ImportReport()))
    return vertices[faces]


@pytest.mark.parametrize("kind", _FORMATS)
@pytest.mark.parametrize("others", [[_SQUARE, _TRIANGLE], []])
@pytest.mark.parametrize(("outline", "area"), [(L_SHAPE, 26.0), (U_SHAPE, 45.0), (L_SHAPE[::-1], 26.0)])
def test_polygons_that_are_not_convex_are_not_reached_beyond(tmp_path, kind, others, outline, area):
    flags = [("uchar flag", [[row] for row in range(len(others) + 1)])]
    triangles = _triangles(_write(tmp_path / "a.ply", [*others, outline], kind, face=flags))
    assert area_m2(triangles) == pytest.approx(area + (6.0 if others else 0.0))


@pytest.mark.parametrize("kind", _FORMATS)
def test_faces_of_different_numbers_of_corners_are_all_read(tmp_path, kind):
    outlines = [_SQUARE, _TRIANGLE, _SQUARE, [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2)]]
    assert area_m2(_triangles(_write(tmp_path / "a.ply", outlines, kind))) == pytest.approx(4 + 2 + 4 + 5)


@pytest.mark.parametrize("kind", _FORMATS)
@pytest.mark.parametrize("outlines", [[_TRIANGLE] * 2, [_SQUARE] * 3])
def test_faces_that_the_library_reads_stay_as_they_are_stored(tmp_path, kind, outlines):
    assert even_ply(_write(tmp_path / "a.ply", outlines, kind)) is None


@pytest.mark.parametrize("kind", _FORMATS)
def test_the_coordinates_and_the_colour_of_a_face_go_with_its_triangles(tmp_path, kind):
    outlines = [L_SHAPE, _TRIANGLE]
    colours = [(f"uchar {name}", [[value], [9]]) for name, value in (("red", 250), ("green", 120), ("blue", 30))]
    parts = read_mesh(_write(tmp_path / "a.ply", outlines, kind, face=colours), ImportReport())
    (part,) = parts
    assert len(part.faces) == 5
    uv = [[float(number) for point in outline for number in point] for outline in outlines]
    src = _write(tmp_path / "b.ply", outlines, kind, face=[("list uchar float texcoord", uv)])
    (part,) = read_mesh(src, ImportReport())
    assert np.allclose(part.uv, part.vertices_m[:, :2])


@pytest.mark.parametrize("kind", _FORMATS)
@pytest.mark.parametrize("names", ["st", "uv"])
def test_colours_show_beside_texture_coordinates_without_a_picture(tmp_path, kind, names):
    colours = [(f"uchar {name}", [[value]] * 7) for name, value in (("red", 250), ("green", 120), ("blue", 30))]
    uv = [(f"float {name}", [[0.5 * k] for k in range(7)]) for name in names]
    parts = read_mesh(_write(tmp_path / "a.ply", [_SQUARE, _TRIANGLE], kind, vertex=[*uv, *colours]), ImportReport())
    (part,) = parts
    seen = np.array(part.rgb) if part.texture is None else part.texture[0, 0] / 255.0 * part.rgb
    assert np.allclose(seen, np.array([250, 120, 30]) / 255.0, atol=0.01)


def test_several_pictures_are_refused(tmp_path):
    notes = ["comment TextureFile a.png", "comment TextureFile b.png"]
    with pytest.raises(SceneError, match=r"names 2 pictures \(a.png, b.png\), but not .*: export it as .glb or .obj"):
        read_mesh(_write(tmp_path / "a.ply", [_TRIANGLE], notes=notes), ImportReport())
    read_mesh(_write(tmp_path / "a.ply", [_TRIANGLE], notes=notes[:1] * 2), ImportReport())


@pytest.mark.parametrize("kind", _FORMATS)
def test_triangles_are_counted_before_they_are_read(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 4)
    read_mesh(_write(tmp_path / "a.ply", [L_SHAPE], kind), ImportReport())
    with pytest.raises(LimitError, match="has 5 triangles"):
        read_mesh(_write(tmp_path / "a.ply", [_TRIANGLE, L_SHAPE], kind), ImportReport())
    with pytest.raises(LimitError, match="has 5 triangles"):
        read_mesh(_write(tmp_path / "a.ply", [_TRIANGLE] * 5, kind), ImportReport())


@pytest.mark.parametrize("kind", _FORMATS[1:])
@pytest.mark.parametrize("cut", [1, 12, 30, 60])
def test_a_file_that_ends_early_is_damaged(tmp_path, kind, cut):
    src = _write(tmp_path / "a.ply", [_SQUARE, _TRIANGLE, L_SHAPE], kind)
    src.write_bytes(src.read_bytes()[:-cut])
    with pytest.raises(SceneError, match="is damaged"):
        read_mesh(src, ImportReport())
