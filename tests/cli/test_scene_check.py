"""The command, on a room that is in order and on one whose walls have one side."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from anm_mj.cli.main import main
from anm_mj.scene.folder import read_scene_folder
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.sim.gl import select_backend
from anm_mj.sim.scene_views import NOTHING, SceneViews
from anm_mj.types import Pose2
from tests.robots import ROVER_XML
from tests.scene.shapes import room


def _write(mesh: trimesh.Trimesh, folder, starts=None):
    part = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    return write_scene([part], SceneInfo("room", "tests", "CC0", cull_face=True), folder, starts)


def test_a_room_in_order(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = _write(room(), tmp_path / "room")
    assert main(["scene", "check", str(scene.folder)]) == 0
    said = capsys.readouterr().out
    assert "rooms: 1, of 2" in said
    assert "front sides are drawn" in said
    assert "100.000% of pixels within 1 mm" in said or "99.9" in said
    with Image.open(tmp_path / "room_check.png") as sheet:
        assert sheet.size[0] > 500
    assert read_scene_folder(scene.folder).cull_face


def test_a_wider_robot_fits_less(tmp_path, capsys):
    scene, wide = str(_write(room(), tmp_path / "room").folder), tmp_path / "wide.xml"
    wide.write_text(ROVER_XML.read_text().replace('size="0.10 0.13 0.04"', 'size="0.40 0.13 0.04"'))
    found = []
    for robot in ("diff_drive", str(wide)):
        assert main(["scene", "check", scene, "--robot", robot, "--json", "--out", str(tmp_path / "sheet.png")]) == 0
        found.append(json.loads(capsys.readouterr().out))
    usual, other = found
    assert other["footprint"]["radius_m"] > 0.35 > usual["footprint"]["radius_m"]
    assert other["navigable_m2"] < 0.9 * usual["navigable_m2"]


def test_a_robot_that_is_not_there_ends_with_status_2(tmp_path, capsys):
    scene = _write(room(), tmp_path / "room")
    assert main(["scene", "check", str(scene.folder), "--robot", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err


def test_walls_seen_from_behind_are_fixed(tmp_path, capsys):
    inside_out = room()
    inside_out.invert()
    scene = _write(inside_out, tmp_path / "room")
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.png")]) == 0
    assert "both sides are drawn (fixed" in capsys.readouterr().out
    assert not read_scene_folder(scene.folder).cull_face


def test_an_unusable_scene_ends_with_status_1_and_a_sentence(tmp_path, capsys):
    scene = _write(room(), tmp_path / "room", starts=(Pose2(0.0, 0.0, 0.0),))
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.png")]) == 1
    assert "start poses is clear" in capsys.readouterr().err


def test_a_scene_that_is_not_there_ends_with_status_2(capsys):
    assert main(["scene", "check", "nowhere"]) == 2
    assert "There is no scene" in capsys.readouterr().err


def test_a_sheet_that_cannot_be_written_is_named(tmp_path, capsys):
    scene = _write(room(), tmp_path / "room")
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "missing" / "sheet.png")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_a_sheet_of_no_known_kind_is_refused(tmp_path, capsys):
    scene = _write(room(), tmp_path / "room")
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.of")]) == 2
    assert ".png or .pdf or .svg" in capsys.readouterr().err
    assert not (tmp_path / "sheet.of").exists()


def test_a_sheet_for_print(tmp_path):
    scene = _write(room(), tmp_path / "room")
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.pdf")]) == 0
    assert (tmp_path / "sheet.pdf").read_bytes().startswith(b"%PDF")


def test_the_view_from_above_is_light_and_lies_where_the_plan_does(tmp_path):
    scene = _write(room(), tmp_path / "room")
    views = SceneViews(scene, select_backend())
    picture = views.top_view(256)
    low, high = views.top_corners_m
    rows, cols = np.nonzero((picture != NOTHING).any(axis=2))
    m_per_px = (high[0] - low[0]) / 256
    west, east = low[0] + m_per_px * np.array([cols.min(), cols.max() + 1])
    south, north = high[1] - m_per_px * np.array([rows.max() + 1, rows.min()])
    np.testing.assert_allclose([[west, south], [east, north]], scene.bounds_m[:, :2], atol=0.04)


def test_a_body_of_the_scene_that_is_moved_by_hand_is_not_the_eye(tmp_path):
    scene, pose = _write(room(), tmp_path / "room"), Pose2(0.5, 0.5, 0.3)
    (alone,) = SceneViews(scene, select_backend()).interior_views((pose,), 32)
    text = scene.xml.read_text()
    scene.xml.write_text(text.replace("<worldbody>", '<worldbody>\n<body name="hand" mocap="true"/>', 1))
    (among,) = SceneViews(scene, select_backend()).interior_views((pose,), 32)
    np.testing.assert_array_equal(among, alone)


@pytest.mark.parametrize(("file", "says"), [("broken.png", "texture"), ("000_walls.msh", "cannot be compiled")])
def test_a_damaged_asset_ends_with_status_2_and_one_line(tmp_path, capsys, file, says):
    scene = _write(room(), tmp_path / "room")
    (scene.folder / "assets" / file).write_bytes(b"damaged")
    assert main(["scene", "check", str(scene.folder), "--out", str(tmp_path / "sheet.png")]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "import" in said
    assert "\n" not in said
