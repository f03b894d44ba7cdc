"""Materials that OBJ files name, and what .mtl files say of them."""

import numpy as np
import pytest
from PIL import Image

from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.read_mesh import read_mesh

_CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


def _read(folder, obj: bytes, mtl: bytes):
    (folder / "a.mtl").write_bytes(mtl)
    (folder / "a.obj").write_bytes(b"mtllib a.mtl\n" + _CORNERS.encode() + obj + b"f 1/1 2/2 3/3\n")
    report = ImportReport()
    (submesh,) = read_mesh(folder / "a.obj", report)
    return submesh, report.sentences()


@pytest.mark.parametrize("codecs", [("cp1252", "cp1252"), ("utf-8", "cp1252"), ("cp1252", "utf-8"), ("utf-8", "utf-8")])
@pytest.mark.parametrize("name", ["Fußboden", "Tür außen", "Möbel"])
def test_materials_are_found_in_whatever_encoding_their_names_are(tmp_path, codecs, name):
    # What stands before the name is what an encoding is guessed from.
    obj = (f"# {name}\n" * 30 + f"usemtl {name}\n").encode(codecs[0])
    mtl = ("# Blender MTL File: None\n" * 40 + f"newmtl {name}\nKd 1 0 0\n").encode(codecs[1])
    submesh, said = _read(tmp_path, obj, mtl)
    assert submesh.rgb == (1.0, 0.0, 0.0)
    assert not said


def test_a_picture_is_found_whose_name_is_no_utf_8(tmp_path):
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / "Tür.png")
    submesh, said = _read(tmp_path, b"usemtl wall\n", "# a note\nnewmtl wall\nmap_Kd Tür.png\n".encode("cp1252"))
    assert submesh.texture is not None
    assert not said


def test_a_material_that_is_in_no_material_file_is_named(tmp_path):
    _, said = _read(tmp_path, b"usemtl nosuch\n", b"newmtl wall\nKd 1 0 0\n")
    assert said == ["Not in the .mtl files: the materials nosuch of a.obj; surfaces that need them come out grey."]
    # It has no face.
    assert not _read(tmp_path, b"usemtl nosuch\nusemtl wall\n", b"\xef\xbb\xbfnewmtl wall\nKd 1 0 0\n")[1]


@pytest.mark.parametrize(
    ("options", "is_moved"),
    [
        ("-s 2 2 1", True),
        ("-S 1 1 1 -o 0 0", False),
        ("-o 0.5", True),
        ("-t .1 1e-3 +2.", True),
        ("-bm 1.0 -clamp on -blendu off -blendv off", False),
        ("-imfchan m -texres 512 -boost 2 -mm 0 1 -type sphere -cc on", False),
    ],
)
@pytest.mark.parametrize("space", [" ", "\t"])
def test_options_are_no_part_of_the_name_of_a_picture(tmp_path, options, is_moved, space):
    Image.new("RGB", (8, 8), (10, 200, 10)).save(tmp_path / "a wall.png")
    mtl = f"newmtl wall\n  map_Kd {options} a wall.png\n".replace(" -", f"{space}-")
    submesh, said = _read(tmp_path, b"usemtl wall\n", mtl.encode())
    assert submesh.texture is not None
    assert np.array_equal(submesh.texture[0, 0], (10, 200, 10))
    moved = "Texture transforms are not applied, so the textures of a.obj may come out shifted or scaled."
    assert said == ([moved] if is_moved else [])


def test_a_material_file_that_cannot_be_read_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("anm_mj.scene.importing.readers.obj_material.MAX_MESH_MIB", 0)
    submesh, said = _read(tmp_path, b"usemtl wall\n", b"newmtl wall\nKd 1 0 0\n")
    assert len(submesh.faces) == 1
    assert said[0].startswith("Left out, because they cannot be read: the materials of a.obj (its 0 MiB are more than")
