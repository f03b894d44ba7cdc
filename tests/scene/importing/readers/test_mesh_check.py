import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.import_limits import LimitError
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.mesh_check import check_mesh_file
from anm_mj.scene.importing.readers.read_mesh import read_mesh
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from tests.scene.importing.readers.test_gltf_check import write_gltf

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
TEXT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def test_large_triangles_over_one_another_end_somewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MAX_SPREAD_KM", 0.01)
    small = np.full((100_000, 3, 3), CORNERS * 0.04)
    limits.check_spread(tmp_path, small)
    with pytest.raises(LimitError, match=r"11 triangles.*0\.01045 km.*ANM_MJ_MAX_SPREAD_KM"):
        limits.check_spread(tmp_path, np.full((11, 3, 3), CORNERS))
    src = write_gltf(tmp_path / "a.gltf", lambda header: header["scenes"][0].update(nodes=[0] * 3))
    monkeypatch.setattr(limits, "MAX_SPREAD_KM", 0)
    with pytest.raises(LimitError, match="ANM_MJ_MAX_SPREAD_KM"):
        import_scene(src, tmp_path / "out")


def test_copies_in_a_world_and_pixels_of_textures_end_somewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 1200)
    budget = limits.TriangleBudget(tmp_path)
    submesh = Submesh("a", CORNERS, np.array([[0, 1, 2]]))
    budget.spend(submesh)
    budget.spend(submesh)
    with pytest.raises(SceneError, match="ANM_MJ_MAX_TRIANGLES"):
        budget.spend(submesh)
    monkeypatch.setattr(limits, "MAX_TEXTURE_MEGAPIXELS", 3)
    limits.check_textures(tmp_path, [(2048, 2048)], 1024)
    with pytest.raises(SceneError, match="ANM_MJ_MAX_TEXTURE_MEGAPIXELS"):
        limits.check_textures(tmp_path, [(2048, 2048)] * 2, 1024)


@pytest.mark.parametrize(
    "text",
    ["\ufeff" + TEXT, TEXT.replace("f 1 2 3", "f\t1\t2\t3"), TEXT.replace("f ", "  f "), TEXT.replace("v", " v")],
)
def test_an_obj_may_be_indented_and_begin_with_a_byte_order_mark(tmp_path, text):
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    (part,) = read_mesh(tmp_path / "a.obj", ImportReport())
    assert part.vertices_m.shape == part.faces.repeat(3, axis=0).shape


@pytest.mark.parametrize(
    ("line", "said"), [("f 0 1 2", "line 5: a face names vertex 0"), ("v 1 2", "line 5: a vertex has 2 numbers")]
)
def test_a_line_of_an_obj_that_means_nothing_is_named(tmp_path, line, said):
    (tmp_path / "a.obj").write_text(TEXT + line + "\n")
    with pytest.raises(SceneError, match=said):
        read_mesh(tmp_path / "a.obj", ImportReport())


def test_a_ply_with_faces_of_another_name_is_refused(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int own\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    with pytest.raises(SceneError, match="faces with own, but none with vertex_indices"):
        read_mesh(tmp_path / "a.ply", ImportReport())


def _dae_geometry(name, corners="0 1 2"):
    return (
        f'<geometry id="{name}"><mesh><source id="{name}p"><float_array id="{name}a" count="9">0 0 0 1 0 0 0 1 0'
        f'</float_array><technique_common><accessor source="#{name}a" count="3" stride="3"><param name="X" '
        'type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>'
        f'</source><vertices id="{name}v"><input semantic="POSITION" source="#{name}p"/></vertices><triangles '
        f'count="1"><input offset="0" semantic="VERTEX" source="#{name}v"/><p>{corners}</p>'
        "</triangles></mesh></geometry>"
    )


@pytest.mark.parametrize(
    ("other", "instance", "said"),
    [
        (_dae_geometry("h"), "geometry", ""),
        (_dae_geometry("h", "0 1 77"), "geometry", "geometry 'h' of a.dae"),
        ("", "geometry", "geometry 'h' of a.dae"),
        ('<geometry id="h"><convex_mesh/></geometry>', "geometry", "geometry 'h' of a.dae"),
        ("", "controller", "animated mesh 'h' of a.dae"),
    ],
)
def test_what_of_a_collada_scene_is_not_read_is_named(tmp_path, other, instance, said):
    (tmp_path / "a.dae").write_text(
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<library_geometries>{_dae_geometry('g')}{other}</library_geometries><library_visual_scenes><visual_scene "
        f'id="s"><node><instance_geometry url="#g"/></node><node><instance_{instance} url="#h"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    report = ImportReport()
    read_mesh(tmp_path / "a.dae", report)
    assert report.sentences() == ([f"Left out, because they cannot be read: {said}."] if said else [])


@pytest.mark.parametrize("note", ["<!-- a note -->", "<?tool a note?>"])
def test_notes_in_a_collada_mesh_change_nothing(tmp_path, note):
    geometry = _dae_geometry("g").replace("<triangles", f"{note}<triangles")
    (tmp_path / "a.dae").write_text(
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<library_geometries>{geometry}</library_geometries><library_visual_scenes><visual_scene "
        'id="s"><node><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    report = ImportReport()
    assert len(read_mesh(tmp_path / "a.dae", report)[0].faces) == 1
    assert not report.sentences()


def test_a_collada_scene_that_the_file_does_not_show_is_named(tmp_path):
    (tmp_path / "a.dae").write_text(
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<library_geometries>{_dae_geometry('g')}{_dae_geometry('h')}</library_geometries><library_visual_scenes>"
        '<visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>'
        '<visual_scene id="t"><node><instance_geometry url="#g"/><instance_geometry url="#h"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    report = ImportReport()
    assert len(read_mesh(tmp_path / "a.dae", report)) == 1
    assert report.sentences() == [
        "Left out, because they stand in a visual scene that the file does not show: the geometries 'h' of a.dae; "
        "export them in the scene that its <scene> names."
    ]


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("a.ifc", "`IfcConvert a.ifc a.glb`"),
        ("a.usdz", "import it in Blender"),
        ("a.blend", "File, Export, glTF 2.0"),
        ("a.sh3d", "Export to OBJ format"),
        ("a.SVG", "draw its walls up"),
    ],
)
def test_files_of_other_known_kinds_name_the_way_to_convert_them(tmp_path, name, way):
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(SceneError, match="and import that") as raised:
        import_scene(tmp_path / name, tmp_path / "out")
    assert way in str(raised.value)


def test_a_face_of_too_many_corners_is_refused(tmp_path):
    corners = "".join(f"v {number} 0 0\n" for number in range(10_001))
    (tmp_path / "a.obj").write_text(f"{corners}f {' '.join(str(number + 1) for number in range(10_001))}\n")
    with pytest.raises(SceneError, match="line 10002: a face has 10001 corners, but faces end at 10000"):
        read_mesh(tmp_path / "a.obj", ImportReport())


def test_a_gltf_that_states_elements_and_holds_none_is_refused(tmp_path):
    def state(header):
        header["accessors"][0] = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
        header["meshes"][0]["primitives"][0]["mode"] = 0

    with pytest.raises(SceneError, match="an accessor states 1000000000 elements, and no buffer view holds them"):
        read_mesh(write_gltf(tmp_path / "a.gltf", state), ImportReport())


def test_a_mesh_without_area_is_named(tmp_path, caplog):
    flat = Submesh("flat", np.zeros((3, 3)), np.array([[0, 1, 2]]))
    floor = np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]])
    room = Submesh("room", floor, np.array([[0, 1, 2], [0, 2, 3]]))
    info = SceneInfo("a", "own", "none")
    write_scene([room, flat], info, tmp_path / "out")
    assert "none of their triangles has an area: flat." in caplog.text


@pytest.mark.parametrize("word", ["surf 0 1 0 1 1 2 3", "fo 1 2 3", "call other.obj"])
def test_surfaces_of_an_obj_file_that_are_not_read_are_named(tmp_path, word):
    (tmp_path / "a.obj").write_text(f"{TEXT}{word}\n")
    report = ImportReport()
    read_mesh(tmp_path / "a.obj", report)
    assert report.sentences() == [f"Left out, because they cannot be read: '{word.split()[0]}' in line 5 of a.obj."]


def test_strips_in_a_ply_file_are_refused_even_beside_faces(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    lists = [f"element {kind} 1\nproperty list int int vertex_indices\n" for kind in ("face", "tristrips")]
    (tmp_path / "a.ply").write_text(f"{head}{''.join(lists)}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n")
    with pytest.raises(SceneError, match="strips of triangles"):
        read_mesh(tmp_path / "a.ply", ImportReport())


def test_what_is_far_too_small_is_said_with_its_size(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1e-9 0 0\nv 0 1e-9 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"would be 1e-12 m large .*give another scale"):
        import_scene(tmp_path / "a.obj", tmp_path / "out", scale=1e-3)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("3 0 1 2\n2 0 1\n", r"a face that is none \('2 0 1', row 2"),
        ("3 0 1 2\n3 0 1\n", r"a face that is none \('3 0 1', row 2"),
        ("3 0 1 2\n", "states 2 rows of face and holds 1"),
    ],
)
def test_a_ply_whose_rows_are_short_is_refused(tmp_path, rows, said):
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    lists = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(f"{head}{lists}0 0 0\n1 0 0\n0 1 0\n{rows}")
    with pytest.raises(SceneError, match=said):
        read_mesh(tmp_path / "a.ply", ImportReport())


def test_what_a_reader_says_does_not_quote_the_file(tmp_path):
    uri = "data:;base64," + "!" * 9999
    with pytest.raises(SceneError) as caught:
        read_mesh(write_gltf(tmp_path / "a.gltf", lambda header: header["buffers"][0].update(uri=uri)), ImportReport())
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (bytes(80) + b"\3\0\0\0" + bytes(100), "states 3 triangles, which take 234 bytes, and has 184"),
        (bytes(80) + b"\1\0\0\0" + bytes(59), "states 1 triangles, which take 134 bytes, and has 143"),
        (bytes(40), "40 bytes"),
        (b"solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0", "'endsolid' is missing"),
    ],
)
def test_an_stl_file_of_another_length_than_it_states_says_so(tmp_path, content, said):
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(SceneError, match=said):
        read_mesh(tmp_path / "a.stl", ImportReport())


def test_the_triangles_of_an_stl_file_are_counted_before_they_are_read(tmp_path, monkeypatch):
    (tmp_path / "a.stl").write_bytes(bytes(80) + b"\3\0\0\0" + bytes(3 * 50))
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 2)
    with pytest.raises(LimitError, match="has 3 triangles"):
        check_mesh_file(tmp_path / "a.stl", ImportReport())


def test_a_binary_stl_file_may_have_any_words_in_its_header(tmp_path):
    content = trimesh.creation.box().export(file_type="stl")
    (tmp_path / "a.stl").write_bytes(b"solid, 12 facets".ljust(80) + content[80:])
    assert sum(len(part.faces) for part in read_mesh(tmp_path / "a.stl", ImportReport())) == 12
