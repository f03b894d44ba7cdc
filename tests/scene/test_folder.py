import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.build import build_model
from anm_mj.scene.folder import list_scenes, load_scene
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.types import Pose2
from tests.scene.shapes import room


def _part(mesh, name="walls"):
    return Submesh(name, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), (0.5, 0.5, 0.5))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    info = SceneInfo('a "named" room', "tests", "CC0\nfor all", rooms=1, budget_steps=300)
    starts = (Pose2(1.0, 2.0, math.radians(90.0)), Pose2(3.0, 2.0, 0.0), Pose2(5.0, 2.0, 0.0))
    return write_scene([_part(room())], info, tmp_path_factory.mktemp("scenes") / "plain", starts)


def test_what_was_written_is_read_back(written):
    scene = load_scene(written.folder)
    assert (scene.name, scene.source, scene.licence) == ('a "named" room', "tests", "CC0\nfor all")
    assert (scene.rooms, scene.budget_steps, scene.has_ceiling, scene.cull_face) == (1, 300, True, False)
    assert scene.starts[0] == Pose2(1.0, 2.0, math.radians(90.0))
    assert scene.num_triangles == len(room().faces)
    assert scene.hash == written.hash
    assert len(scene.hash) == 64


def test_the_geometry_is_the_source_triangle_for_triangle(written):
    vertices, faces = written.triangles()
    assert np.allclose(vertices[faces], room().vertices[room().faces], atol=1e-6)
    assert vertices is written.triangles()[0]
    with pytest.raises(ValueError, match="read-only"):
        vertices[0] = 0.0


def test_the_hash_changes_with_geometry_and_colour(tmp_path, written):
    info = SceneInfo(written.name, "tests", "CC0")
    moved = room()
    moved.vertices[0, 0] += 1e-3
    red = Submesh("walls", room().vertices.astype(np.float32), room().faces.astype(np.int32), (1.0, 0.0, 0.0))
    hashes = {write_scene(parts, info, tmp_path / "x").hash for parts in ([_part(moved)], [red])}
    assert len(hashes | {written.hash}) == 3


def test_where_all_that_collides_was_left_out_the_robot_meets_what_is_drawn(tmp_path):
    drawn, info = [_part(room())], SceneInfo("a", "tests", "CC0")
    both = [write_scene(drawn, info, tmp_path / name, obstacles=o) for name, o in (("x", None), ("y", []))]
    assert len({(scene.folder / "scene.xml").read_text() for scene in both}) == 1


def test_degenerate_faces_are_left_out(tmp_path):
    mesh = room()
    faces = np.concatenate([mesh.faces, [[0, 0, 1], [5, 5, 5]]]).astype(np.int32)
    line = Submesh("line", np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    part = Submesh("walls", mesh.vertices.astype(np.float32), faces)
    assert write_scene([part, line], SceneInfo("a", "tests", "CC0"), tmp_path / "x").num_triangles == len(mesh.faces)
    with pytest.raises(SceneError, match="no triangles"):
        write_scene([line], SceneInfo("a", "tests", "CC0"), tmp_path / "y")


def test_parts_with_impossible_numbers_are_refused():
    corners = np.zeros((3, 3), np.float32)
    with pytest.raises(SceneError, match="faces that name vertices 0 to 3"):
        Submesh("a", corners, np.array([[0, 1, 3]]))
    with pytest.raises(SceneError, match="1 vertices with NaN"):
        Submesh("a", np.array([[0, 0, np.nan], [0, 0, 1], [1, 0, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(SceneError, match="no texture coordinates"):
        Submesh("a", corners, np.array([[0, 1, 2]]), texture=np.zeros((2, 2, 3), np.uint8))


@pytest.fixture
def copied(written, tmp_path):
    """A copy that a test may spoil."""
    return shutil.copytree(written.folder, tmp_path / "copied")


def test_a_scene_is_found_by_name_in_the_users_folder(copied, monkeypatch):
    monkeypatch.setenv("ANM_MJ_SCENES", str(copied.parent))
    assert load_scene("copied").folder == copied
    assert "copied" in [scene.folder.name for scene in list_scenes()]


def test_an_unknown_name_is_answered_with_the_known_ones(copied, monkeypatch):
    monkeypatch.setenv("ANM_MJ_SCENES", str(copied.parent))
    with pytest.raises(SceneError, match=r"no scene 'castle'; the catalogue holds .*copied"):
        load_scene("castle")


def test_a_broken_scene_does_not_hide_the_others(copied, tmp_path, monkeypatch, caplog):
    (shutil.copytree(copied, tmp_path / "broken") / "scene.xml").unlink()
    monkeypatch.setenv("ANM_MJ_SCENES", str(tmp_path))
    names = [scene.folder.name for scene in list_scenes()]
    assert "copied" in names
    assert "broken" not in names
    assert "broken is left out" in caplog.text


def test_no_users_folder_is_no_error(tmp_path, monkeypatch):
    monkeypatch.setenv("ANM_MJ_SCENES", str(tmp_path / "none"))
    list_scenes()


@pytest.mark.parametrize("part", ["scene.xml", "geometry.npz", "assets"])
def test_an_incomplete_folder_names_what_is_missing(copied, part):
    if (copied / part).is_dir():
        shutil.rmtree(copied / part)
    else:
        (copied / part).unlink()
    with pytest.raises(SceneError, match=f"incomplete: {part} missing"):
        load_scene(copied)


def test_folders_that_are_no_scenes_are_refused(copied, tmp_path):
    with pytest.raises(SceneError, match="does not exist"):
        load_scene(tmp_path / "nowhere")
    with pytest.raises(SceneError, match="is a file, not a scene folder"):
        load_scene(copied / "scene.xml")
    with pytest.raises(SceneError, match=r"not a scene folder: it holds no scene\.toml"):
        load_scene(copied / "assets")


@pytest.mark.parametrize(
    ("text", "reason"),
    [("name = ", "cannot be read"), ('name = "a"', "lacks"), ("bounds = [1, 2]", "lacks or misstates")],
)
def test_a_spoilt_toml_is_said_to_be_so(copied, text, reason):
    (copied / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match=reason):
        load_scene(copied)


@pytest.mark.parametrize(("entry", "wrong"), [("rooms", "-3"), ("rooms", "true"), ("budget_steps", '"many"')])
def test_counts_that_are_none_are_named(copied, entry, wrong):
    text = (copied / "scene.toml").read_text()
    (copied / "scene.toml").write_text(f"{entry} = {wrong}\n{re.sub(rf'(?m)^{entry} = .*$', '', text)}")
    with pytest.raises(SceneError, match=f"{entry}: expected int"):
        load_scene(copied)


@pytest.mark.parametrize(
    ("entry", "value", "said"),
    [
        ("name", '"\\u001b]0;a\\u0007"', "cannot be printed"),
        ("name", '""', "name"),
        ("name", f'"{"x" * 300}"', "name"),
        ("bounds", "[[0, 0, 0], [0, 0, 0]]", "bounds"),
        ("starts", f"[{'[0, 0, 0], ' * 1001}]", "starts"),
    ],
)
def test_entries_that_no_scene_has_are_named(copied, entry, value, said):
    toml = copied / "scene.toml"
    toml.write_text(re.sub(rf"(?m)^{entry} = .*$", lambda _: f"{entry} = {value}", toml.read_text()))
    with pytest.raises(SceneError, match=said):
        load_scene(copied)


def test_a_name_that_cannot_be_printed_is_not_written(tmp_path):
    with pytest.raises(SceneError, match=r"named 'a\\x1bb'"):
        write_scene([_part(room())], SceneInfo("a\x1bb", "", ""), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("cut", [True, False])
def test_a_spoilt_geometry_is_said_to_be_so(copied, cut):
    path = copied / "geometry.npz"
    path.write_bytes(path.read_bytes()[:200] if cut else b"no archive")
    with pytest.raises(SceneError, match=r"geometry\.npz cannot be read"):
        load_scene(copied).triangles()


def test_a_geometry_without_faces_is_said_to_be_so(copied):
    path = copied / "geometry.npz"
    np.savez(path, **{**np.load(path), "faces": np.zeros((0, 3), np.int32)})
    with pytest.raises(SceneError, match=r"geometry\.npz cannot be read \(faces is empty\)"):
        load_scene(copied).triangles()


def test_nothing_of_mujocos_is_written_where_the_command_was_given(copied, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    xml = copied / "scene.xml"
    xml.write_text(xml.read_text().replace("</worldbody>", '<geom type="sphere" size="nan"/></worldbody>'))
    with pytest.raises(SceneError, match="nan size"):
        build_model(load_scene(copied))
    assert not list(Path.cwd().iterdir())


def test_pictures_of_other_sides_are_other_pictures_whatever_bytes_they_hold(tmp_path):
    shades = np.repeat(np.arange(0, 256, 16, dtype=np.uint8)[:, None], 3, axis=1)
    square = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [2.0, 1.0, 2.0], [1.0, 1.0, 2.0]])
    pictures = [shades[None], shades[:, None]]
    signs = [
        Submesh(
            "sign",
            square + np.array([k, 0, 0]),
            np.array([[0, 1, 2], [0, 2, 3]]),
            uv=square[:, [0, 2]],
            texture=picture,
        )
        for k, picture in enumerate(pictures)
    ]
    scene = write_scene([_part(room()), *signs], SceneInfo("signs", "tests", "CC0"), tmp_path / "signs")
    stored = [np.asarray(Image.open(path)) for path in sorted((scene.folder / "assets").glob("*.png"))]
    assert [picture.shape for picture in stored] == [picture.shape for picture in pictures]


def test_a_licence_that_cannot_be_written_loses_no_more_than_its_letter(tmp_path):
    info = SceneInfo("a", "caf\udce9.obj", "\ud800 CC0")
    scene = write_scene([_part(room())], info, tmp_path / "a")
    assert (scene.source, scene.licence) == ("caf?.obj", "? CC0")


@pytest.mark.parametrize("below", [".", "assets"])
def test_the_folder_that_somebody_is_in_is_not_replaced(tmp_path, monkeypatch, below):
    info = SceneInfo("a", "tests", "CC0")
    (tmp_path / "a").mkdir()
    write_scene([_part(room())], info, tmp_path / "a")
    monkeypatch.chdir(tmp_path / "a" / below)
    with pytest.raises(SceneError, match="is replaced as a whole, and you are in it"):
        write_scene([_part(room())], info, Path("." if below == "." else ".."))
    assert Path.cwd().samefile(tmp_path / "a" / below)
