import io
import json
import logging
import struct
import tomllib

import numpy as np
import pytest
import trimesh
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.import_scene import import_scene
from tests.scene.shapes import room, table, to_y_up
from tests.scene.view import is_shade_of, look

RED, GREEN, BLUE, YELLOW = (200, 30, 30), (30, 180, 30), (40, 40, 220), (230, 220, 30)


def _poster(uv_shift: float = 0.0) -> trimesh.Trimesh:
    """A picture on the wall at y = 3.99 m: seen from the room, red and green on top, blue and yellow below."""
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32], image[:32, 32:], image[32:, :32], image[32:, 32:] = RED, GREEN, BLUE, YELLOW
    corners = np.array([[2.0, 3.99, 0.5], [4.0, 3.99, 0.5], [4.0, 3.99, 2.5], [2.0, 3.99, 2.5]])
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) + uv_shift
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(image))
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def _export(path, *meshes, y_up: bool = False, unit: float = 1.0):
    placed = [to_y_up(mesh) if y_up else mesh.copy() for mesh in meshes]
    for mesh in placed:
        mesh.apply_scale(1.0 / unit)
    trimesh.Scene(placed).export(path)
    return path


def _quadrants(picture) -> list[list[int]]:
    """Colours left and right above, left and right below the middle."""
    return [picture[row, col].tolist() for row in (22, 42) for col in (22, 42)]


def _close(colours, expected) -> bool:
    return np.abs(np.array(colours, dtype=int) - np.array(expected)).max() <= 6


def test_a_z_up_glb_in_metres_comes_out_as_it_went_in(tmp_path):
    scene = import_scene(_export(tmp_path / "a.glb", room(), table(2.0, 1.0)), tmp_path / "out")
    assert np.allclose(scene.bounds_m, [[-0.1, -0.1, -0.1], [6.1, 4.1, 2.6]], atol=1e-3)
    assert scene.has_ceiling
    assert len(scene.starts) >= 3


def test_a_y_up_glb_in_centimetres_comes_out_in_metres_and_z_up(tmp_path, caplog):
    src = _export(tmp_path / "a.glb", room(), table(2.0, 1.0), y_up=True, unit=0.01)
    with caplog.at_level(logging.INFO, logger="anm_mj.scene.importing.import_scene"):
        scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, [[-0.1, -0.1, -0.1], [6.1, 4.1, 2.6]], atol=1e-3)
    assert "y is up (found), 1 unit is 0.01 m (cm, found)" in caplog.text
    entries = tomllib.loads((tmp_path / "out" / "scene.toml").read_text())
    assert (entries["up"], entries["up_how"], entries["scale"], entries["scale_how"]) == ("y", "found", 0.01, "found")


def test_what_is_given_goes_before_what_is_found(tmp_path):
    src = _export(tmp_path / "a.glb", room(), unit=0.01)
    scene = import_scene(src, tmp_path / "out", up="z", scale=0.02, name="big", licence="CC0", source="made up")
    assert np.allclose(scene.bounds_m[1], [12.2, 8.2, 5.2], atol=1e-3)
    assert (scene.name, scene.licence, scene.source) == ("big", "CC0", "made up")
    entries = tomllib.loads((tmp_path / "out" / "scene.toml").read_text())
    assert (entries["up_how"], entries["scale_how"]) == ("given", "given")


def test_a_building_in_inches_says_which_scale_helps(tmp_path, caplog):
    src = _export(tmp_path / "a.glb", room(), y_up=True, unit=0.0254)
    import_scene(src, tmp_path / "found")
    assert "only 1.1 m high: if its source has another unit give --scale 0.0254 (inches)" in caplog.text
    caplog.clear()
    import_scene(src, tmp_path / "given", scale=0.0254)
    assert "m high" not in caplog.text


def test_the_floor_is_lowered_to_zero(tmp_path):
    mesh = room()
    mesh.apply_translation([0.0, 0.0, 3.2])
    scene = import_scene(_export(tmp_path / "a.glb", mesh), tmp_path / "out")
    assert np.allclose(scene.bounds_m[:, 2], [-0.1, 2.6], atol=1e-3)


def test_a_texture_is_neither_mirrored_nor_upside_down(tmp_path):
    scene = import_scene(_export(tmp_path / "a.glb", room(), _poster(), y_up=True), tmp_path / "out")
    assert _close(_quadrants(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))), [RED, GREEN, BLUE, YELLOW])


def test_texture_coordinates_beyond_one_repeat(tmp_path):
    scene = import_scene(_export(tmp_path / "a.glb", room(), _poster(uv_shift=-2.5)), tmp_path / "out", up="z")
    # Half an image to the left and down: each quadrant shows its diagonal opposite.
    assert _close(_quadrants(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))), [YELLOW, BLUE, GREEN, RED])


def _write_obj(folder):
    """The room in plain blue and the poster, with a material library and its picture."""
    poster = _poster()
    lines = ["mtllib a.mtl"]
    lines += [f"v {x} {y} {z}" for x, y, z in np.concatenate([room().vertices, poster.vertices])]
    lines += [f"vt {u} {v}" for u, v in poster.visual.uv]
    lines += ["usemtl paint"] + [f"f {a} {b} {c}" for a, b, c in room().faces + 1]
    first = len(room().vertices)
    lines += ["usemtl poster"] + ["f " + " ".join(f"{first + i}/{i}" for i in face) for face in poster.faces + 1]
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    (folder / "a.mtl").write_text("newmtl paint\nKd 0 0.4 1\nnewmtl poster\nKd 0.4 0.4 0.4\nmap_Kd poster.png\n")
    poster.visual.material.baseColorTexture.save(folder / "poster.png")


def test_an_obj_with_its_material_library_keeps_texture_and_colour(tmp_path):
    _write_obj(tmp_path)
    scene = import_scene(tmp_path / "a.obj", tmp_path / "out", up="z")
    assert _close(_quadrants(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))), [RED, GREEN, BLUE, YELLOW])
    assert _close(look(scene, (3.0, 1.5, 1.5), (-1.0, 0.0, 0.0))[32, 32], (0, 102, 255))


def test_a_missing_texture_of_an_obj_is_named_and_survived(tmp_path, caplog):
    _write_obj(tmp_path)
    (tmp_path / "poster.png").unlink()
    scene = import_scene(tmp_path / "a.obj", tmp_path / "out")
    assert "poster.png" in caplog.text
    assert scene.num_triangles == len(room().faces) + 2


def test_a_large_jpeg_texture_is_reduced_and_kept(tmp_path):
    image = Image.fromarray(np.full((1500, 2000, 3), RED, dtype=np.uint8))
    stored = io.BytesIO()
    image.save(stored, "JPEG")
    poster = _poster()
    poster.visual.material.baseColorTexture = Image.open(stored)
    scene = import_scene(_export(tmp_path / "a.glb", room(), poster), tmp_path / "out")
    (png,) = (scene.folder / "assets").glob("*.png")
    with Image.open(png) as written:
        assert written.size == (1024, 768)
    assert _close(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0))[32, 32], RED)


def test_a_colour_factor_colours_plain_parts_and_tints_textures(tmp_path):
    plain, tinted = room(), _poster()
    plain.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[0, 102, 255, 255])
    )
    tinted.visual.material.baseColorFactor = [255, 127, 0, 255]
    scene = import_scene(_export(tmp_path / "a.glb", plain, tinted), tmp_path / "out", up="z")
    assert _close(look(scene, (3.0, 1.5, 1.5), (-1.0, 0.0, 0.0))[32, 32], (0, 102, 255))
    red, _, _, yellow = _quadrants(look(scene, (3.0, 2.9, 1.5), (1.0, 0.0, 0.0)))
    assert _close(red, (200, 15, 0))
    assert _close(yellow, (230, 110, 0))


def test_a_node_transform_is_applied(tmp_path):
    scene = trimesh.Scene([room()])
    scene.add_geometry(table(0.0, 0.0), transform=trimesh.transformations.translation_matrix([4.0, 1.0, 0.0]))
    scene.export(tmp_path / "a.glb")
    vertices, _ = import_scene(tmp_path / "a.glb", tmp_path / "out", up="z").triangles()
    tops = vertices[np.isclose(vertices[:, 2], 0.75)]
    assert np.allclose(tops[:, :2].min(axis=0), [4.0, 1.0], atol=1e-5)


def test_colours_per_vertex_of_a_ply_show(tmp_path):
    mesh = room().subdivide().subdivide().subdivide()
    # Red grows along x, blue along z.
    share = np.clip(mesh.vertices / [6.0, 1.0, 2.5], 0.0, 1.0)
    rgb = np.stack([255 * share[:, 0], np.full(len(share), 60.0), 255 * share[:, 2]], axis=1).astype(np.uint8)
    mesh.visual.vertex_colors = rgb
    mesh.export(tmp_path / "a.ply")
    scene = import_scene(tmp_path / "a.ply", tmp_path / "out")
    picture = look(scene, (3.0, 3.0, 1.25), (1.0, 0.0, 0.0)).astype(int)
    # The wall is 1 m away: half an image is 1 m.
    for du, dv in ((-20, 0), (0, 0), (20, 0), (0, 20), (20, -20)):
        x, z = 3.0 + du / 32.5, 1.25 - dv / 32.5
        assert np.abs(picture[32 + dv, 32 + du] - [255 * x / 6.0, 60, 255 * z / 2.5]).max() <= 5


def test_a_quad_ply_is_read_with_colours(tmp_path):
    # As Replica lays it out: quads, colours per vertex.
    corners = np.array([(x, y, z) for z in (0.0, 2.5) for y in (0.0, 4.0) for x in (0.0, 5.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["ply", "format ascii 1.0", "element vertex 8"]
    lines += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    lines += ["element face 6", "property list uchar int vertex_indices", "end_header"]
    lines += [f"{x} {y} {z} 200 100 50" for x, y, z in corners]
    lines += ["4 " + " ".join(map(str, quad)) for quad in quads]
    (tmp_path / "mesh.ply").write_text("\n".join(lines) + "\n")
    scene = import_scene(tmp_path / "mesh.ply", tmp_path / "out")
    assert scene.num_triangles == 12
    assert np.allclose(scene.bounds_m, [[0, 0, 0], [5, 4, 2.5]], atol=1e-5)
    assert is_shade_of(look(scene, (2.0, 2.0, 1.0), (1.0, 0.0, 0.0))[32, 32], (200, 100, 50))


def test_the_same_file_gives_the_same_folder(tmp_path):
    src = _export(tmp_path / "a.glb", room(), _poster())
    for out in ("one", "two"):
        import_scene(src, tmp_path / out, name="same")
    ours = {path.relative_to(tmp_path / "one"): path.read_bytes() for path in (tmp_path / "one").rglob("*.*")}
    theirs = {path.relative_to(tmp_path / "two"): path.read_bytes() for path in (tmp_path / "two").rglob("*.*")}
    assert ours == theirs


def _broken_files(folder):
    """Every file that must be refused, with a word of the refusal."""
    whole = _export(folder / "whole.glb", room()).read_bytes()
    (folder / "cut.glb").write_bytes(whole[: len(whole) // 2])
    (folder / "noise.glb").write_bytes(b"\x00\x01 this is no glTF" * 20)
    (folder / "empty.ply").write_bytes(b"")
    (folder / "noise.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n")
    (folder / "noise.obj").write_bytes(b"f 1 2 3\n")
    (folder / "mesh.fbx").write_bytes(b"Kaydara")
    (folder / "no.gltf").write_text("[]")
    trimesh.PointCloud(np.random.default_rng(0).random((50, 3))).export(folder / "points.ply")
    nan = room()
    nan.vertices[3] = np.nan
    (folder / "nan.ply").write_bytes(trimesh.exchange.ply.export_ply(nan))
    yield folder / "cut.glb", "damaged"
    yield folder / "noise.glb", "damaged"
    yield folder / "empty.ply", "0 bytes"
    yield folder / "noise.ply", "damaged"
    yield folder / "noise.obj", "noise.obj"
    yield folder / "mesh.fbx", "glb"
    yield folder / "no.gltf", "damaged"
    yield folder / "points.ply", "no triangles"
    yield folder / "nan.ply", "NaN"
    yield folder / "missing.glb", "does not exist"
    yield folder, "format"


def test_bad_files_are_refused_in_one_sentence_and_leave_nothing_behind(tmp_path):
    for src, reason in _broken_files(tmp_path):
        before = sorted(tmp_path.rglob("*"))
        with pytest.raises(SceneError, match=reason) as caught:
            import_scene(src, tmp_path / "out")
        assert "\n" not in str(caught.value)
        assert sorted(tmp_path.rglob("*")) == before


def test_compressed_glbs_that_cannot_be_read_are_refused(tmp_path):
    whole = _export(tmp_path / "a.glb", room()).read_bytes()
    length = struct.unpack_from("<I", whole, 12)[0]
    header = json.loads(whole[20 : 20 + length])
    header["extensionsUsed"] = ["EXT_meshopt_compression"]
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = whole[20 + length :]
    data = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(body), len(text), b"JSON") + text + body
    (tmp_path / "packed.glb").write_bytes(data)
    with pytest.raises(SceneError, match="meshopt"):
        import_scene(tmp_path / "packed.glb", tmp_path / "out")


def test_a_scene_without_room_for_the_robot_is_refused(tmp_path):
    with pytest.raises(SceneError, match="check the up axis and the scale"):
        import_scene(_export(tmp_path / "a.glb", room()), tmp_path / "out", scale=0.05)
    with pytest.raises(SceneError, match="m large"):
        import_scene(_export(tmp_path / "a.glb", room()), tmp_path / "out", scale=1000.0)
    with pytest.raises(SceneError, match="makes no sense"):
        import_scene(tmp_path / "a.glb", tmp_path / "out", scale=-1.0)
    assert not (tmp_path / "out").exists()


def test_an_existing_folder_is_replaced_only_if_it_is_a_scene(tmp_path):
    src = _export(tmp_path / "a.glb", room())
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("dear")
    with pytest.raises(SceneError, match="not empty and not a scene folder"):
        import_scene(src, tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.txt").read_text() == "dear"
    with pytest.raises(SceneError, match="is a file"):
        import_scene(src, src)

    first = import_scene(src, tmp_path / "out")
    second = import_scene(_export(tmp_path / "b.glb", room(), table(2.0, 1.0)), tmp_path / "out")
    assert second.num_triangles > first.num_triangles
    assert load_scene(tmp_path / "out").triangles()[1].shape[0] == second.num_triangles
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.glb", "b.glb", "out", "thesis"]


def test_a_parent_that_may_not_be_written_is_refused_before_any_work(tmp_path, monkeypatch):
    src = _export(tmp_path / "a.glb", room())
    monkeypatch.setattr("anm_mj.scene.writer.os.access", lambda *_: False)
    with pytest.raises(SceneError, match="not writable"):
        import_scene(src, tmp_path / "out")


def test_a_failing_disk_leaves_the_old_scene_in_place(tmp_path, monkeypatch):
    src = _export(tmp_path / "a.glb", room())
    old = import_scene(src, tmp_path / "out")

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("anm_mj.scene.writer.np.savez_compressed", full)
    with pytest.raises(SceneError, match="No space left"):
        import_scene(src, tmp_path / "out")
    assert load_scene(tmp_path / "out").hash == old.hash
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.glb", "out"]
