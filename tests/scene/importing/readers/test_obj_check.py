import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.import_limits import LimitError
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.obj_check import check_obj
from anm_mj.scene.importing.readers.read_mesh import read_mesh
from anm_mj.scene.submesh import merge_geometry

L_SHAPE = [(4, 5), (0, 5), (0, 0), (6, 0), (6, 3), (4, 3)]
"""A room of 26 m2 whose notch a fan about the first corner would cover."""
U_SHAPE = [(6, 3), (3, 3), (3, 6), (0, 6), (0, 0), (9, 0), (9, 6), (6, 6)]


def _read(path, text):
    path.write_text(text)
    report = ImportReport()
    vertices, faces = merge_geometry(read_mesh(path, report))
    return vertices[faces], report


def _vertices(points):
    return "".join("v " + " ".join(map(str, point)) + "\n" for point in points)


@pytest.mark.parametrize("outline", [L_SHAPE, U_SHAPE, L_SHAPE[::-1], [(0, 0), (4, 1), (0, 2), (1, 1)]])
@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
@pytest.mark.parametrize("corner", ["{0}", "{0}/{0}/1"])
def test_polygons_that_are_not_convex_are_not_reached_beyond(tmp_path, outline, axes, corner):
    points = np.column_stack([outline, np.full(len(outline), 2.0)])[:, axes]
    face = "f " + " ".join(corner.format(k + 1) for k in range(len(points)))
    uv = "".join(f"vt {x} {y}\n" for x, y in outline)
    triangles, _ = _read(tmp_path / "a.obj", _vertices(points) + uv + "vn 0 0 1\n" + face + "\n")
    turned = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    x, y = np.array(outline, dtype=float).T
    area_m2 = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0
    assert np.linalg.norm(turned, axis=1).sum() / 2.0 == pytest.approx(abs(area_m2))
    assert np.argmax(np.abs(turned.sum(axis=0))) == axes.index(2)
    assert turned.sum() / 2.0 == pytest.approx(area_m2)


def test_negative_indices_count_from_their_own_line(tmp_path):
    first, second = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(5, 0, 0), (6, 0, 0), (5, 1, 0)]
    text = "".join(_vertices(own) + "vt 0 0\nf -3/-1 -2/-1 -1/-1\n" for own in (first, second))
    triangles, _ = _read(tmp_path / "a.obj", text)
    assert np.array_equal(triangles, [first, second])


def test_indices_that_count_back_beyond_the_first_are_refused(tmp_path):
    with pytest.raises(SceneError, match="names entry -9, but 3 stand above it"):
        _read(tmp_path / "a.obj", _vertices(np.eye(3)) + "f -3 -2 -9\n")


def test_a_comment_behind_a_face_is_none_of_its_corners(tmp_path):
    triangles, _ = _read(tmp_path / "a.obj", _vertices(np.eye(3)) + "f 1 2 3 # the only one\n")
    assert np.array_equal(triangles, [np.eye(3)])


@pytest.mark.parametrize("named", ["mtllib a.mtl b.mtl\n", "mtllib a.mtl\nmtllib b.mtl\n"])
def test_several_material_files_are_all_read(tmp_path, named):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl green\nKd 0 1 0\n")
    text = named + _vertices([*np.eye(3), *np.eye(3) + 1]) + "usemtl red\nf 1 2 3\nusemtl green\nf 4 5 6\n"
    (tmp_path / "a.obj").write_text(text)
    report = ImportReport()
    assert sorted(submesh.rgb for submesh in read_mesh(tmp_path / "a.obj", report)) == [(0, 1, 0), (1, 0, 0)]
    assert not report.sentences()


def _painted(tmp_path, picture):
    (tmp_path / "a.mtl").write_text(f"newmtl wall\nKd 1 1 1\nmap_Kd {picture}\n")
    text = "mtllib a.mtl\n" + _vertices(np.eye(3)) + "vt 0 0\nusemtl wall\nf 1/1 2/1 3/1\n"
    (tmp_path / "a.obj").write_text(text)
    report = ImportReport()
    (submesh,) = read_mesh(tmp_path / "a.obj", report)
    return submesh, report


def test_a_picture_that_cannot_be_decoded_is_named(tmp_path):
    (tmp_path / "wall.dds").write_bytes(b"DDS " + bytes(200))
    submesh, report = _painted(tmp_path, "wall.dds")
    assert "wall.dds of a.obj" in report.sentences()[0]
    assert max(submesh.rgb) < 0.99


def test_a_picture_of_16_bits_keeps_its_grey(tmp_path):
    Image.fromarray(np.full((8, 8), 40000, dtype=np.uint16)).save(tmp_path / "wall.png")
    submesh, _ = _painted(tmp_path, "wall.png")
    assert np.abs(submesh.texture.astype(int) - 156).max() <= 1


@pytest.mark.parametrize(
    ("mapped", "plain"), [("{0}/{0}", "{0}//{0}"), ("{0}/{0}", "{0}"), ("{0}/{0}/{0}", "{0}//{0}"), ("-3/-3", "-1")]
)
@pytest.mark.parametrize(("depth", "note"), [("", ""), (" 0", " # 1/1")])
def test_a_texture_stays_where_some_faces_of_its_material_have_no_coordinates(tmp_path, mapped, plain, depth, note):
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / "wall.png")
    (tmp_path / "a.mtl").write_text("newmtl wall\nmap_Kd wall.png\nnewmtl floor\nKd 1 0 0\n")
    corners = _vertices([*np.eye(3), *np.eye(3) + 1])
    uv = "".join(f"vt {x} 0.5{depth}\n" for x in (0.25, 0.5, 0.75)) + "vn 0 0 1\n" * 6

    def face(corner, first, note=""):
        return "f " + " ".join(corner.format(first + k) for k in range(3)) + note + "\n"

    faces = face(mapped, 1) + "usemtl floor\n" + face(plain, 4) + "usemtl wall\n" + face(plain, 4, note)
    if mapped.startswith("-"):
        faces = "f -6/-3 -5/-2 -4/-1\nusemtl floor\nf -3 -2 -1\nusemtl wall\nf -3 -2 -1\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}{uv}usemtl wall\n{faces}")
    floor, wall = sorted(read_mesh(tmp_path / "a.obj", ImportReport()), key=lambda own: own.texture is not None)
    assert floor.uv is None
    assert np.allclose(floor.vertices_m[floor.faces], np.eye(3) + 1)
    assert wall.texture is not None
    assert wall.uv is not None
    own = wall.faces[np.isclose(wall.vertices_m[wall.faces].sum(axis=(1, 2)), 3.0)]
    assert np.allclose(np.sort(wall.uv[own][..., 0]), [[0.25, 0.5, 0.75]])
    other = wall.faces[np.isclose(wall.vertices_m[wall.faces].sum(axis=(1, 2)), 12.0)]
    assert np.allclose(wall.uv[other], 0.0)


def test_triangles_are_counted_and_materials_once_each_before_they_are_read(tmp_path, monkeypatch):
    text = _vertices([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) + "usemtl a\nf 1 2 3 4\nusemtl b\nf 1 2 3\n" * 3
    (tmp_path / "a.obj").write_text(text)
    monkeypatch.setattr(limits, "MAX_PARTS", 2)
    assert sum(len(own.faces) for own in read_mesh(tmp_path / "a.obj", ImportReport())) == 9
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 8)
    with pytest.raises(LimitError, match="has 9 triangles"):
        check_obj(tmp_path / "a.obj", ImportReport())


def test_a_comment_about_material_files_is_none(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    corners = _vertices([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    (tmp_path / "a.obj").write_text(f"# mtllib old.mtl\nmtllib a.mtl\n{corners}usemtl red\nf 1 2 3\n")
    report = ImportReport()
    (part,) = read_mesh(tmp_path / "a.obj", report)
    assert part.rgb == (1.0, 0.0, 0.0)
    assert not report.sentences()
