import json

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.read_mesh import read_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")


def write_gltf(path, change=lambda header: None):
    (path.parent / "data.bin").write_bytes(CORNERS.tobytes() + b"junk")
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 4},
        ],
        "buffers": [{"byteLength": 40, "uri": "data.bin"}],
    }
    change(header)
    path.write_text(json.dumps(header))
    return path


def _primitive(**entries):
    return lambda header: header["meshes"][0]["primitives"][0].update(entries)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_primitive(mode=6), "triangle fan"),
        (_primitive(mode=7), "mode 7"),
        (_primitive(material=4), "entry 4 of its 0 materials"),
        (lambda header: header["accessors"][0].update(sparse={"count": 1}), "sparse accessor"),
        (lambda header: header["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {}}), "node for each copy"),
        (lambda header: header.update(extensionsRequired=["VENDOR_own"]), "requires VENDOR_own"),
        (lambda header: header["nodes"][0].update(mesh=9), "entry 9 of its 1 meshes"),
        (lambda header: header["nodes"][0].update(mesh=-1), "entry -1 of its 1 meshes"),
        (
            lambda header: header.update(
                nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}]
            ),
            "node 2 stands in several",
        ),
        (lambda header: header["nodes"][0].update(children=[0]), "node 0 stands in several others, or in itself"),
        (lambda header: header["accessors"][0].update(count=-3), "count or an offset of -3"),
        (lambda header: header["accessors"][0].update(count=2.5), "count or an offset of 2.5"),
        (lambda header: header["bufferViews"][0].update(byteOffset=-12), "offset of -12"),
        (lambda header: header["bufferViews"][0].update(byteStride=4), "elements of 12 bytes are stored every 4 bytes"),
    ],
)
def test_a_gltf_with_triangles_that_are_not_read_is_refused(tmp_path, change, said):
    assert len(read_mesh(write_gltf(tmp_path / "a.gltf"), ImportReport())) == 1
    with pytest.raises(SceneError, match=said):
        read_mesh(write_gltf(tmp_path / "a.gltf", change), ImportReport())


def test_draco_triangles_that_cannot_be_decoded_are_refused(tmp_path):
    def compress(header):
        draco = {"KHR_draco_mesh_compression": {"bufferView": 1, "attributes": {"POSITION": 0}}}
        header.update(extensionsUsed=list(draco), extensionsRequired=list(draco))
        header["accessors"] = [{"componentType": 5126, "count": 3, "type": "VEC3"}]
        header["meshes"][0]["primitives"][0]["extensions"] = draco

    with pytest.raises(SceneError, match="Draco"):
        read_mesh(write_gltf(tmp_path / "a.gltf", compress), ImportReport())


def test_an_embedded_picture_that_cannot_be_decoded_is_reported(tmp_path):
    def paint(header):
        header["images"] = [{"bufferView": 1, "mimeType": "image/png", "name": "wall"}]
        header["textures"] = [{"source": 0}]
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    report = ImportReport()
    read_mesh(write_gltf(tmp_path / "a.gltf", paint), report)
    assert "wall of a.gltf" in report.sentences()[0]


def test_copies_of_a_gltf_mesh_count_before_they_are_made(tmp_path, monkeypatch):
    def copy(header):
        header["nodes"] *= 9
        header["scenes"][0]["nodes"] = list(range(9))

    src = write_gltf(tmp_path / "a.gltf", copy)
    assert len(read_mesh(src, ImportReport())) == 9
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 8)
    with pytest.raises(SceneError, match="ANM_MJ_MAX_TRIANGLES"):
        read_mesh(src, ImportReport())
    monkeypatch.setattr(limits, "MAX_PARTS", 8)
    with pytest.raises(SceneError, match="ANM_MJ_MAX_PARTS"):
        read_mesh(src, ImportReport())


@pytest.mark.parametrize("kind", ["meshes", "nodes"])
def test_a_gltf_whose_weights_move_vertices_is_named(tmp_path, kind):
    def morph(header):
        header["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
        holder = next(one for one in header[kind] if kind == "meshes" or "mesh" in one)
        holder["weights"] = [0.5]

    report = ImportReport()
    read_mesh(write_gltf(tmp_path / "a.gltf", morph), report)
    assert any("Morph targets are not applied: mesh" in said for said in report.sentences())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda header: header["buffers"][0].update(uri="gone.bin"),
            "names the buffer 'gone.bin', which is not beside",
        ),
        (lambda header: header["buffers"][0].update(byteLength=99), "ends after 40 of 99 bytes"),
        (lambda header: header["buffers"][0].update(uri="data:,%00"), "not base64"),
        (lambda header: header.pop("scenes"), "1 meshes and no scene that places one"),
    ],
)
def test_a_gltf_without_its_numbers_or_places_says_so(tmp_path, change, said):
    with pytest.raises(SceneError, match=said):
        read_mesh(write_gltf(tmp_path / "a.gltf", change), ImportReport())


def test_bones_that_are_not_applied_are_named(tmp_path):
    report = ImportReport()
    read_mesh(write_gltf(tmp_path / "a.gltf", lambda header: header["nodes"][0].update(skin=0)), report)
    assert report.sentences() == [
        "Skins are not applied: node 0 of a.gltf stand as they were made, without their bones."
    ]


def _coloured(path, numbers, kind, entries, **primitive):
    """A triangle with one more attribute of a kind for each of its corners."""

    def add(header):
        header["buffers"].append({"byteLength": numbers.nbytes, "uri": "more.bin"})
        header["bufferViews"].append({"buffer": 1, "byteLength": numbers.nbytes})
        kinds = {"<u2": 5123, "<f4": 5126}
        header["accessors"].append(
            {"bufferView": 2, "componentType": kinds[numbers.dtype.str], "count": 3, "type": f"VEC{numbers.shape[1]}"}
        )
        header["meshes"][0]["primitives"][0]["attributes"][kind] = 1
        header["meshes"][0]["primitives"][0].update(primitive)
        header.update(entries)

    numbers.tofile(path.parent / "more.bin")
    return write_gltf(path, add)


def test_colours_of_16_bits_without_a_material_keep_their_value(tmp_path):
    numbers = np.full((3, 4), (65535, 32768, 0, 65535), dtype="<u2")
    (submesh,) = read_mesh(_coloured(tmp_path / "a.gltf", numbers, "COLOR_0", {}), ImportReport())
    assert np.allclose(submesh.rgb, (1.0, 0.5, 0.0), atol=0.01)


@pytest.mark.parametrize("slot", [{"texCoord": 1}, {"extensions": {"KHR_texture_transform": {"texCoord": 1}}}])
def test_a_texture_takes_the_coordinates_that_its_material_names(tmp_path, slot):
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / "wall.png")
    entries = {
        "images": [{"uri": "wall.png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **slot}}}],
    }
    numbers = np.full((3, 2), (0.25, 0.75), dtype="<f4")
    report = ImportReport()
    (submesh,) = read_mesh(_coloured(tmp_path / "a.gltf", numbers, "TEXCOORD_1", entries, material=0), report)
    assert np.allclose(submesh.uv, (0.25, 0.25))
    assert bool(report.sentences()) == ("extensions" in slot)


def test_a_texture_without_a_picture_that_is_read_is_reported(tmp_path):
    def paint(header):
        header["textures"] = [{"extensions": {"EXT_texture_avif": {"source": 0}}}]
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    report = ImportReport()
    read_mesh(write_gltf(tmp_path / "a.gltf", paint), report)
    assert "texture 0 of a.gltf" in report.sentences()[0]


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("camera", [{"mesh": 0, "translation": [1, 0, 0]}, {"children": [1], "translation": [1, 0, 0]}])
def test_a_mesh_at_or_below_a_camera_stands_where_it_should(tmp_path, kind, camera):
    def film(header):
        numbers = {"yfov": 1, "znear": 0.1, "aspectRatio": 1} if kind == "perspective" else {"xmag": 1, "ymag": 1}
        header["cameras"] = [{"type": kind, kind: numbers}]
        header["nodes"] = [{"name": "cam", "camera": 0, **camera}, {"name": "kid", "mesh": 0}]

    (submesh,) = read_mesh(write_gltf(tmp_path / "a.gltf", film), ImportReport())
    assert np.allclose(submesh.vertices_m, CORNERS + np.array([1, 0, 0]))
