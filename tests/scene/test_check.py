"""What a check finds in rooms of known measure."""

import numpy as np
import pytest
import trimesh

from anm_mj.scene.check import check_scene, disable_backface_culling
from anm_mj.scene.folder import read_scene_folder
from anm_mj.scene.navigable import navigable_area
from anm_mj.scene.room_segmentation import segment_rooms
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.types import DEFAULT_FOOTPRINT, Pose2
from tests.scene.shapes import box, room, shelf_hall, table, two_rooms


def _plan(mesh: trimesh.Trimesh):
    triangles = np.asarray(mesh.triangles)
    return segment_rooms(triangles, navigable_area(triangles, DEFAULT_FOOTPRINT))


def _scene(mesh: trimesh.Trimesh, folder, starts=None, **info):
    part = Submesh("walls", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    return write_scene([part], SceneInfo(folder.name, "tests", "CC0", **info), folder, starts)


def test_one_room_is_one_room_whatever_stands_in_it():
    plan = _plan(trimesh.util.concatenate([room(), table(1.0, 1.0), table(3.5, 1.0)]))
    assert plan.area_m2 == pytest.approx((24.0,), rel=0.05)
    assert not plan.doors


@pytest.mark.parametrize("width_m", [0.7, 0.9, 1.1])
def test_a_doorway_parts_two_rooms_and_is_measured(width_m):
    plan = _plan(two_rooms(width_m))
    assert plan.area_m2 == pytest.approx((11.8, 11.8), rel=0.06)
    (door,) = plan.doors
    assert door.xy_m == pytest.approx((3.0, 2.0), abs=0.15)
    assert door.width_m == pytest.approx(width_m, abs=0.08)
    assert door.rooms == (1, 2)
    assert door.fits


def test_a_wide_opening_is_a_door_below_a_lintel_only():
    walls = two_rooms(2.0).split(only_watertight=False)
    open_to_the_ceiling = trimesh.util.concatenate([piece for piece in walls if piece.bounds[0, 2] != 2.05])
    assert len(walls) == len(open_to_the_ceiling.split(only_watertight=False)) + 1
    (door,) = _plan(two_rooms(2.0)).doors
    assert door.width_m == pytest.approx(2.0, abs=0.08)
    assert len(_plan(open_to_the_ceiling).area_m2) == 1


def test_shelves_and_low_walls_divide_no_hall():
    plan = _plan(shelf_hall())
    assert plan.area_m2 == pytest.approx((192.0,), rel=0.05)
    assert not plan.doors


def test_a_room_out_of_reach_does_not_count():
    plan = _plan(two_rooms(0.3))
    assert len(plan.area_m2) == 1
    assert not plan.doors


def test_a_written_scene_counts_its_rooms_unless_told(tmp_path):
    assert _scene(two_rooms(), tmp_path / "counted").rooms == 2
    assert _scene(two_rooms(), tmp_path / "told", rooms=5).rooms == 5


def test_a_usable_scene_has_no_problems(tmp_path):
    check = check_scene(_scene(two_rooms(), tmp_path / "flat"), DEFAULT_FOOTPRINT)
    assert not check.problems
    assert not check.holes
    assert not check.blocked_starts
    assert len(check.clear_starts) == len(check.scene.starts)
    assert check.floor_m == pytest.approx(0.0, abs=0.001)
    assert check.plan is not None
    assert len(check.plan.area_m2) == 2


def test_a_hole_in_the_floor_is_found(tmp_path):
    # The slab is put together around a hole of 0.6 x 0.6 m.
    walls = room().split(only_watertight=False)[1:]
    slabs = [
        box((-0.1, -0.1, -0.1), (2.0, 4.1, 0.0)),
        box((2.6, -0.1, -0.1), (6.1, 4.1, 0.0)),
        box((2.0, -0.1, -0.1), (2.6, 1.5, 0.0)),
        box((2.0, 2.1, -0.1), (2.6, 4.1, 0.0)),
    ]
    scene = _scene(trimesh.util.concatenate([*walls, *slabs]), tmp_path / "holed")
    (hole,) = check_scene(scene, DEFAULT_FOOTPRINT).holes
    assert hole == pytest.approx((2.3, 1.8, 0.36), abs=0.07)


def test_a_scene_whose_starts_are_all_blocked_is_unusable(tmp_path):
    scene = _scene(two_rooms(), tmp_path / "flat", starts=(Pose2(3.0, 0.5, 0.0),))
    (problem,) = check_scene(scene, DEFAULT_FOOTPRINT).problems
    assert "None of the 1 start poses is clear: put starts = [[" in problem


def test_a_scene_without_a_floor_is_unusable(tmp_path):
    scene = _scene(room(), tmp_path / "raised", starts=(Pose2(1.0, 1.0, 0.0),))
    vertices, faces = scene.triangles()
    np.savez_compressed(scene.folder / "geometry.npz", vertices=vertices + np.float32([0, 0, 0.5]), faces=faces)
    toml = scene.folder / "scene.toml"
    toml.write_text(toml.read_text().replace('hash = "', 'hash = "other'))
    check = check_scene(read_scene_folder(scene.folder), DEFAULT_FOOTPRINT)
    assert check.area is None
    assert "floor within" in check.problems[0]


@pytest.mark.parametrize("up", ["x", "y"])
def test_a_scene_on_its_side_is_unusable_whichever_side_that_is(tmp_path, up):
    mesh = room()
    # World z becomes x or y.
    mesh.vertices = mesh.vertices[:, {"x": [2, 0, 1], "y": [1, 2, 0]}[up]]
    problems = check_scene(_scene(mesh, tmp_path / "side"), DEFAULT_FOOTPRINT).problems
    assert f"level along {up}, not along z. Import it again with --up {up}" in problems[0]


def test_an_arena_of_low_walls_is_usable(tmp_path):
    assert not check_scene(_scene(room(z=0.6, ceiling=False), tmp_path / "arena"), DEFAULT_FOOTPRINT).problems


def test_drawing_both_sides_is_written_into_the_folder_once(tmp_path):
    scene = _scene(room(), tmp_path / "room", cull_face=True)
    assert disable_backface_culling(scene)
    assert not read_scene_folder(scene.folder).cull_face
    assert not disable_backface_culling(scene)
