"""Parts by name, doors, storeys, stray parts, scenes far from their origin."""

import logging
import tomllib

import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.doors import find_leaves, with_doors
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.gazebo import read_gazebo
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.parsed_scene import Joint
from anm_mj.scene.importing.storeys import Storey, clip_submesh, pick_storey
from anm_mj.scene.navigable import scene_area
from anm_mj.scene.submesh import Submesh
from anm_mj.types import DEFAULT_FOOTPRINT
from tests.scene.shapes import box, room

_ROOMS = 4
_STOREY_M = 3.0


def _visual(size, at=(0.0, 0.0, 0.0)) -> str:
    pose, size = " ".join(map(str, at)), " ".join(map(str, size))
    return f"<visual name='v'><pose>{pose} 0 0 0</pose><geometry><box><size>{size}</size></box></geometry></visual>"


def _model(name: str, at, size) -> str:
    pose = " ".join(map(str, at))
    return f"<model name='{name}'><pose>{pose} 0 0 0</pose><link name='l'>{_visual(size)}</link></model>"


def _door(name: str, x: float, y: float, z: float, kind: str) -> str:
    """A leaf of 0.9 x 2 m whose left edge is at x; hinged, sliding, or a mere model."""
    link = f"<link name='leaf'>{_visual((0.9, 0.04, 2.0), (0.45, 0, 1.02))}</link>"
    joints = {
        "hinged": "<joint name='j' type='revolute'><parent>frame</parent><child>leaf</child><axis><xyz>0 0 1</xyz>"
        "<limit><lower>-1.7</lower><upper>0</upper></limit></axis></joint>",
        "sliding": "<joint name='j' type='prismatic'><parent>frame</parent><child>leaf</child><axis><xyz>1 0 0</xyz>"
        "<limit><lower>0</lower><upper>0.9</upper></limit></axis></joint>",
        "fixed": "",
    }
    return f"<model name='{name}'><pose>{x} {y} {z} 0 0 0</pose>{link}<link name='frame'/>{joints[kind]}</model>"


def _clinic(path):
    """Two storeys of four rooms of 4 x 4 m along a corridor, every door shut."""
    models = []
    for storey in range(2):
        z, length = storey * _STOREY_M, 4.0 * _ROOMS
        models.append(_model(f"floor_{storey}", (length / 2, 3, z - 0.1), (length + 0.2, 6.2, 0.2)))
        walls = [((length / 2, -0.05), (length + 0.2, 0.1)), ((length / 2, 6.05), (length + 0.2, 0.1))]
        walls += [((x, 3), (0.1, 6.1)) for x in (-0.05, length + 0.05)]
        walls += [((4.0 * i, 4), (0.1, 4)) for i in range(1, _ROOMS)]
        for i in range(_ROOMS):
            # A doorway from x + 1 to x + 1.9.
            walls += [((4.0 * i + 0.5, 2), (1.0, 0.1)), ((4.0 * i + 2.95, 2), (2.1, 0.1))]
            kind = ("hinged", "sliding", "fixed")[i % 3]
            models.append(_door(f"door_{storey}_{i}", 4.0 * i + 1.0, 2.0, z, kind))
        for i, ((x, y), (sx, sy)) in enumerate(walls):
            models.append(_model(f"wall_{storey}_{i}", (x, y, z + 1.4), (sx, sy, 2.8)))
    roof = _model("roof", (2.0 * _ROOMS, 3, 2 * _STOREY_M - 0.1), (4.0 * _ROOMS + 0.2, 6.2, 0.2))
    models.append(roof)
    # With blank lines before the declaration, as Gazebo reads it.
    path.write_text(f"\n\n<?xml version='1.0'?><sdf version='1.9'><world name='w'>{''.join(models)}</world></sdf>")
    return path


@pytest.fixture(scope="module")
def clinic(tmp_path_factory):
    return _clinic(tmp_path_factory.mktemp("clinic") / "clinic.world")


def test_a_clinic_with_shut_doors_and_two_storeys_says_what_helps(clinic, tmp_path, caplog):
    with caplog.at_level(logging.INFO):
        scene = import_scene(clinic, tmp_path / "out")
    area = scene_area(scene, DEFAULT_FOOTPRINT)
    assert area.component.max() >= 1 + _ROOMS
    assert "has 2 storeys (1 at 0.00 m, 2 at 3.00 m)" in caplog.text
    assert "8 door leaves may be in its way: door_0_0/leaf, door_0_1/leaf" in caplog.text
    assert "--doors open" in caplog.text


def test_the_heights_of_storeys_are_said_as_the_option_takes_them(tmp_path, caplog):
    house = trimesh.util.concatenate([room(z=2.8), room(z=2.8).apply_translation([0.0, 0.0, 3.0])])
    house.apply_translation([0.0, 0.0, 3.0]).export(tmp_path / "a.ply")
    import_scene(tmp_path / "a.ply", tmp_path / "both", up="z", scale=1.0)
    assert "(1 at 3.00 m, 2 at 6.00 m)" in caplog.text
    assert "the robot drives on the one at 3.00 m" in caplog.text
    import_scene(tmp_path / "a.ply", tmp_path / "one", up="z", scale=1.0, storey="6.00")
    assert "floor_removed = 6.0\n" in (tmp_path / "one" / "scene.toml").read_text()


def _reached(scene) -> int:
    """Number of the clinic's rooms whose middle belongs to the largest piece of floor."""
    area = scene_area(scene, DEFAULT_FOOTPRINT)
    xy = np.array([(4.0 * i + 2.5, 4.0) for i in range(_ROOMS)])
    cols, rows = np.floor((xy - area.grid.origin_xy_m) / area.grid.resolution_m).astype(int).T
    return int((area.component[rows, cols] == 1).sum())


@pytest.mark.parametrize("storey", ["1", "2", "3.0"])
def test_one_storey_with_open_doors_reaches_all_rooms(clinic, tmp_path, caplog, storey):
    with caplog.at_level(logging.INFO):
        scene = import_scene(clinic, tmp_path / "out", doors="open", storey=storey)
    assert _reached(scene) == _ROOMS
    assert scene.has_ceiling
    assert np.allclose(scene.bounds_m[:, 2], [-0.1, 2.995 if storey == "1" else 3.0], atol=0.01)
    # Shut in between, they are moved aside, and those without a joint are gone.
    assert "opened 6 (" in caplog.text
    assert "took out 2 without a hinge" in caplog.text
    assert "left out those at" in caplog.text


def test_doors_stay_as_they_are_unless_asked(clinic, tmp_path):
    assert _reached(import_scene(clinic, tmp_path / "out", storey="1")) <= 1
    assert _reached(import_scene(clinic, tmp_path / "shut", storey="1", doors="closed")) <= 1
    assert _reached(import_scene(clinic, tmp_path / "gone", storey="1", leave_out=["door_*"])) == _ROOMS


def test_only_and_leave_out_take_patterns_and_refuse_what_matches_nothing(clinic, tmp_path):
    scene = import_scene(clinic, tmp_path / "out", only=["FLOOR_0", "wall_0_*"], leave_out=["wall_0_3"])
    assert scene.num_triangles == 12 * (1 + 4 + _ROOMS - 1 + 2 * _ROOMS - 1)
    for wrong in ({"only": ["cellar"]}, {"leave_out": ["cellar"]}):
        with pytest.raises(SceneError, match="No part of the source matches 'cellar': it has floor_0"):
            import_scene(clinic, tmp_path / "out2", **wrong)
    with pytest.raises(SceneError, match="No part of the source is left"):
        import_scene(clinic, tmp_path / "out2", only=["roof"], leave_out=["*"])
    for storey, word in (
        ("7", "no storey 7: the storeys are 1 at 0.00 m, 2 at 3.00 m"),
        ("9.5", "near 9.5"),
        ("x", "'x'"),
    ):
        with pytest.raises(SceneError, match=word):
            import_scene(clinic, tmp_path / "out2", storey=storey)
    assert not (tmp_path / "out2").exists()


@pytest.mark.parametrize(
    ("kind", "state", "end"),
    [("hinged", "5 2 1 0 0 -1.5", (0.0, -0.9)), ("sliding", "5.8 2 1 0 0 0", (1.8, 0.0))],
)
def test_a_door_that_the_saved_state_has_open_is_shut_and_opened_from_there(tmp_path, kind, state, end):
    saved = f"<model name='door'><pose>5 2 1 0 0 0</pose><link name='leaf'><pose>{state}</pose></link></model>"
    world = f"<world name='w'>{_door('door', 1.0, 2.0, 0.0, kind)}<state world_name='w'>{saved}</state></world>"
    (tmp_path / "a.world").write_text(f"<sdf version='1.6'>{world}</sdf>")
    read = read_gazebo(tmp_path / "a.world", [], ImportReport())
    (leaf,) = find_leaves(read.submeshes, read.joints)
    assert not leaf.is_shut
    for doors, reach in (("closed", (0.9, 0.0)), ("open", end)):
        (moved,) = with_doors(read, [leaf], doors).submeshes
        away = (moved.vertices_m - [5.0, 2.0, 0.0])[:, :2]
        assert away[np.argmax(np.linalg.norm(away, axis=1))] == pytest.approx(reach, abs=0.03)


def _leaf(name: str, size, joint: Joint | None = None) -> list:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation((0, 0, size[2] / 2))
    return find_leaves([Submesh(name, mesh.vertices, mesh.faces, part=name)], {} if joint is None else {name: joint})


def test_leaves_are_told_from_furniture_and_frames():
    upright = Joint(True, np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.0, None)
    tilting = Joint(True, np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.0, None)
    leaf = (0.9, 0.05, 2.0)
    assert _leaf("InteriorDoor_3", leaf)
    assert _leaf("panel", leaf, upright)
    assert _leaf("hotel/door_12/leaf", leaf)
    for name in ("panel", "door_frame", "wardrobe_door", "outdoor_wall", "kitchen/fridge/door"):
        assert not _leaf(name, leaf)
    assert not _leaf("panel", leaf, tilting)
    assert not _leaf("door", (0.9, 0.05, 0.7))
    assert not _leaf("door", (5.0, 0.05, 2.0))
    assert not _leaf("door", (0.9, 0.9, 2.0))


def test_a_triangle_is_cut_with_its_texture():
    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.0]])
    uv = corners[:, [0, 2]] / 4.0
    part = clip_submesh(
        Submesh("t", corners, np.array([[0, 1, 2]]), uv=uv, texture=np.zeros((2, 2, 3), np.uint8)), 1, 2
    )
    triangles = part.vertices_m[part.faces]
    area = (
        np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1).sum() / 2
    )
    # Between z = 1 and 2 the triangle is 3 to 2 m wide.
    assert area == pytest.approx(2.5)
    assert np.allclose(part.uv, part.vertices_m[:, [0, 2]] / 4.0)
    assert clip_submesh(part, 3.0, 4.0) is None


def test_a_stray_part_is_left_out_and_named(tmp_path, caplog):
    scene = trimesh.Scene()
    scene.add_geometry(room(), node_name="house")
    scene.add_geometry(box((450, 0, 0), (450.5, 0.5, 0.5)), node_name="lamp")
    scene.export(tmp_path / "a.glb")
    made = import_scene(tmp_path / "a.glb", tmp_path / "out", up="z")
    assert made.bounds_m[1, 0] == pytest.approx(6.1, abs=1e-3)
    assert "far from everything else: lamp (444 m away)" in caplog.text


def test_a_scene_far_from_its_origin_loses_nothing(tmp_path):
    mesh = room()
    (tmp_path / "near.obj").write_text(trimesh.exchange.obj.export_obj(mesh, digits=4))
    mesh.apply_translation((500000.25, 4649776.5, 0.0))
    (tmp_path / "far.obj").write_text(trimesh.exchange.obj.export_obj(mesh, digits=4))
    near = import_scene(tmp_path / "near.obj", tmp_path / "near", up="z", scale=1.0)
    far = import_scene(tmp_path / "far.obj", tmp_path / "far", up="z", scale=1.0)
    origin = tomllib.loads((tmp_path / "far" / "scene.toml").read_text())["origin"]
    assert origin == [500003.0, 4649778.0] or np.allclose(origin, [500003.25, 4649778.5], atol=0.6)
    shift = np.array([500000.25, 4649776.5]) - origin
    assert np.allclose(far.bounds_m[:, :2], near.bounds_m[:, :2] + shift, atol=1e-3)
    assert far.num_triangles == near.num_triangles
    assert "origin" not in tomllib.loads((tmp_path / "near" / "scene.toml").read_text())


def test_a_storey_with_thousands_of_digits_is_none():
    with pytest.raises(SceneError, match="No storey"):
        pick_storey([Storey(0.0, 20.0, -0.1, 3.0)], "9" * 5000)


def test_the_parts_of_an_obj_file_are_its_materials(tmp_path):
    mesh = room()
    corners = trimesh.exchange.obj.export_obj(mesh, include_normals=False)
    rows = [line for line in corners.splitlines() if line.startswith("f ")]
    vertices = [line for line in corners.splitlines() if line.startswith("v ")]
    lines = ["mtllib a.mtl", *vertices, "o house", "usemtl plaster", *rows, "o door_1", "usemtl wood", *rows[:1]]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "a.mtl").write_text("newmtl plaster\nKd 1 1 1\nnewmtl wood\nKd 0 1 0\n")
    made = import_scene(tmp_path / "a.obj", tmp_path / "out", up="z", leave_out=["wood"])
    assert made.num_triangles == len(rows)
    with pytest.raises(
        SceneError, match=r"No part of the source matches 'door_\*': it has (plaster, wood|wood, plaster)"
    ):
        import_scene(tmp_path / "a.obj", tmp_path / "other", up="z", leave_out=["door_*"])
