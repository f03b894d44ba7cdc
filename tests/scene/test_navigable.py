import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.navigable import choose_starts, is_clear, navigable_area, require_clear
from anm_mj.scene.submesh import Submesh
from anm_mj.scene.writer import SceneInfo, write_scene
from anm_mj.types import Footprint, Pose2
from tests.scene.shapes import box, room, table, two_rooms

FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)


def _area(*meshes, footprint=FOOTPRINT):
    mesh = trimesh.util.concatenate(meshes)
    return navigable_area(mesh.vertices[mesh.faces], footprint)


@pytest.fixture(scope="module")
def furnished(tmp_path_factory):
    mesh = trimesh.util.concatenate([two_rooms(), table(4.0, 1.5)])
    part = Submesh("all", mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
    return write_scene([part], SceneInfo("furnished", "tests", "CC0"), tmp_path_factory.mktemp("scene") / "furnished")


def test_an_empty_room_is_navigable_but_for_a_radius_along_its_walls():
    # The slit of one cell beside each wall is the grid's, not the room's.
    assert _area(room()).area_m2 == pytest.approx((6.0 - 0.36) * (4.0 - 0.36), rel=0.02)


def test_two_rooms_are_one_component_through_a_door_and_two_without():
    assert _area(two_rooms(door_width=0.9)).component.max() == 1
    assert _area(two_rooms(door_width=0.3)).component.max() == 2


def _on_a_wide_ground(*meshes: trimesh.Trimesh):
    return _area(box((-15.0, -15.0, -0.2), (20.0, 20.0, 0.0)), *meshes)


def _starts_inside(area) -> bool:
    return all(0.0 < start.x_m < 6.0 and 0.0 < start.y_m < 4.0 for start in choose_starts(area, FOOTPRINT))


def test_the_robot_starts_in_a_building_and_not_on_the_ground_around_it():
    area = _on_a_wide_ground(room())
    assert area.component.max() == 2
    assert area.area_m2 < 24.0
    assert _starts_inside(area)


def test_the_robot_starts_in_a_building_whose_door_is_open():
    # Only a wall at the right, a doorway of 0.9 m in it.
    walls = [box((-0.1, -0.1, 0.0), (0.0, 4.1, 2.5)), box((0.0, -0.1, 0.0), (6.1, 0.0, 2.5))]
    walls += [box((0.0, 4.0, 0.0), (6.1, 4.1, 2.5)), box((6.0, 0.0, 0.0), (6.1, 1.5, 2.5))]
    area = _on_a_wide_ground(*walls, box((6.0, 2.4, 0.0), (6.1, 4.0, 2.5)))
    assert area.component.max() == 1
    assert _starts_inside(area)


def test_a_floor_without_walls_is_taken_as_it_is():
    area = _area(box((-5.0, -5.0, -0.2), (5.0, 5.0, 0.0)), box((1.0, 1.0, 0.0), (2.0, 2.0, 1.0)))
    assert not area.indoors.any()
    assert area.area_m2 > 90.0


def test_below_a_table_is_no_place_for_a_tall_robot():
    area = _area(room(), table(2.0, 1.5))
    low = _area(room(), table(2.0, 1.5), footprint=Footprint(0.18, 0.05, 0.5))
    assert low.area_m2 > area.area_m2 + 0.3


def test_a_closet_is_refused_with_the_least_area():
    with pytest.raises(SceneError, match=r"has only 0\.4\d? m2 to move on .* and needs 0\.5 m2"):
        _area(room(1.1, 1.0, 2.3))


def test_without_floor_there_is_nothing_to_stand_on():
    with pytest.raises(SceneError, match="check the up axis"):
        _area(
            box((0.0, 0.0, 0.0), (6.0, 4.0, 2.5)),
            box((0.0, 0.0, -1.0), (0.1, 0.1, 2.5)),
            footprint=Footprint(5, 0.05, 1),
        )


def test_starts_are_clear_apart_and_reachable(furnished):
    assert len(furnished.starts) >= 3
    assert all(is_clear(furnished, start, FOOTPRINT) for start in furnished.starts)
    places = np.array([start.xy_m for start in furnished.starts])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(len(places), 1)]
    assert apart.min() > 0.8
    # Both rooms have some.
    assert (places[:, 0] < 2.9).any()
    assert (places[:, 0] > 3.1).any()


def test_starts_do_not_look_at_the_wall_before_them():
    area = _area(room(8.0, 2.0))
    first = choose_starts(area, FOOTPRINT)[0]
    assert abs(np.cos(first.yaw_rad)) > 0.8


def test_clear_is_exact_to_a_tenth_of_a_millimetre(furnished):
    # The wall's face is at x = 0.
    assert is_clear(furnished, Pose2(0.1801, 1.0, 0.0), FOOTPRINT)
    assert not is_clear(furnished, Pose2(0.1799, 1.0, 0.0), FOOTPRINT)
    # A corner of the table top at (4.0, 1.5): diagonally away by the radius.
    away = 0.18 / np.sqrt(2.0)
    assert is_clear(furnished, Pose2(4.0 - away - 1e-4, 1.5 - away - 1e-4, 0.0), FOOTPRINT)
    assert not is_clear(furnished, Pose2(4.0 - away + 1e-4, 1.5 - away + 1e-4, 0.0), FOOTPRINT)


def test_inside_walls_below_tables_and_out_of_doors_is_not_clear(furnished):
    for x, y in ((3.0, 0.5), (4.6, 1.9), (-3.0, 2.0), (50.0, 2.0), (6.05, 2.0)):
        assert not is_clear(furnished, Pose2(x, y, 0.0), FOOTPRINT)


def test_a_start_that_is_not_clear_is_answered_with_the_nearest_that_is(furnished):
    require_clear(furnished, Pose2(1.5, 2.0, 0.0), FOOTPRINT)
    with pytest.raises(SceneError, match=r"cannot start at \(3\.00, 1\.00\).*nearest clear place is \((2\.7|3\.2)"):
        require_clear(furnished, Pose2(3.0, 1.0, 0.0), FOOTPRINT)
