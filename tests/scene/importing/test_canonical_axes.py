import numpy as np
import pytest
import trimesh

from anm_mj.scene.importing.canonical_axes import R_WORLD_SOURCE, covered_share, find_floor, find_scale, find_up
from anm_mj.scene.importing.storeys import find_storeys
from tests.scene.shapes import box, room, table, to_y_up, two_rooms


def _triangles(mesh):
    return np.asarray(mesh.vertices[mesh.faces])


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001])
@pytest.mark.parametrize("size_m", [(3.0, 4.0, 2.5), (19.0, 11.4, 3.0), (57.0, 25.0, 3.4), (12.0, 10.0, 5.6)])
def test_the_unit_is_found_from_the_size_of_a_building(size_m, unit):
    assert find_scale(np.array(size_m) / unit) == unit


@pytest.mark.parametrize("preferred", ["y", "z"])
@pytest.mark.parametrize("mesh", [room(3.0, 4.0, 2.5), two_rooms(), room(8.0, 8.0, 3.0, ceiling=False)])
def test_the_up_axis_is_found_whatever_is_usual(mesh, preferred):
    assert find_up(_triangles(mesh), preferred) == "z"
    assert find_up(_triangles(to_y_up(mesh)), preferred) == "y"


@pytest.mark.parametrize("preferred", ["y", "z"])
def test_the_outside_of_a_wall_is_no_storey(preferred):
    walls = [((0, 0), (7.1, 0.1)), ((0, 4), (7.1, 4.1)), ((0, 0), (0.1, 4)), ((7, 0), (7.1, 4)), ((4, 0), (4.1, 1.5))]
    solid = [box((*low, 0.0), (*high, 2.5)) for low, high in walls]
    house = trimesh.util.concatenate([box((0.0, 0.0, -0.1), (7.1, 4.1, 0.0)), *solid])
    assert find_up(_triangles(house), preferred) == "z"
    assert find_up(_triangles(to_y_up(house)), preferred) == "y"


@pytest.mark.parametrize("preferred", ["y", "z"])
def test_furniture_on_the_floor_does_not_lay_a_room_on_its_side(preferred):
    furniture = [box((0, 0, 0), (2, 1.6, 0.5)), box((0, 1.8, 0), (0.6, 3, 2)), box((1.4, 2.4, 0), (3, 3, 0.75))]
    bedroom = trimesh.util.concatenate([room(3.0, 3.0, 2.6), *furniture, box((2.4, 0, 0), (3, 0.6, 0.9))])
    assert find_up(_triangles(bedroom), preferred) == "z"
    assert find_up(_triangles(to_y_up(bedroom)), preferred) == "y"


@pytest.mark.parametrize("height", [0.5, 1.0, 1.2])
@pytest.mark.parametrize("preferred", ["y", "z"])
def test_the_floor_of_an_arena_of_low_walls_counts(preferred, height):
    arena = room(6.0, 4.0, height, ceiling=False)
    assert find_up(_triangles(arena), preferred) == "z"
    assert find_up(_triangles(to_y_up(arena)), preferred) == "y"


def test_a_cube_without_evidence_keeps_the_usual_axis():
    cube = _triangles(room(2.5, 2.5, 2.5))
    assert find_up(cube, "y") == "y"
    assert find_up(cube, "z") == "z"


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_rotations_are_proper_and_put_the_axis_up(up):
    rotation = R_WORLD_SOURCE[up]
    assert np.isclose(np.linalg.det(rotation), 1.0)
    assert np.allclose(rotation @ np.eye(3)["xyz".index(up)], [0.0, 0.0, 1.0])


def test_a_gltf_scene_keeps_x_and_turns_minus_z_into_y():
    assert np.allclose(R_WORLD_SOURCE["y"] @ [1.0, 2.0, 3.0], [1.0, -3.0, 2.0])


@pytest.mark.parametrize("height", [-1.3, 0.0, 0.7])
def test_the_floor_is_the_top_of_its_slab(height):
    mesh = trimesh.util.concatenate([room(), table(2.0, 1.0), table(4.0, 2.5)])
    mesh.apply_translation([0.0, 0.0, height])
    floor = find_floor(_triangles(mesh))
    assert floor is not None
    assert floor.z_m == pytest.approx(height, abs=1e-6)


def test_the_floor_of_a_thin_slab_is_its_top_too():
    mesh = trimesh.util.concatenate([box((0.0, 0.0, -0.03), (6.0, 4.0, 0.0)), box((0.0, 0.0, 0.0), (0.1, 4.0, 2.5))])
    floor = find_floor(_triangles(mesh))
    assert floor is not None
    assert floor.z_m == pytest.approx(0.0, abs=1e-6)


def test_a_pit_below_the_floor_and_a_rug_on_it_do_not_count():
    mesh = trimesh.util.concatenate([room(), box((1.0, 1.0, -0.5), (2.0, 2.0, -0.4)), box((3, 1, 0), (4.0, 3.0, 0.03))])
    floor = find_floor(_triangles(mesh))
    assert floor is not None
    assert floor.z_m == pytest.approx(0.0, abs=1e-6)


def test_of_two_storeys_the_lower_is_taken():
    upper = room()
    upper.apply_translation([0.0, 0.0, 2.6])
    floor = find_floor(_triangles(trimesh.util.concatenate([room(), upper])))
    assert floor is not None
    assert floor.z_m == pytest.approx(0.0, abs=1e-6)


def test_a_roof_is_no_floor_though_furniture_leaves_less_of_the_floor():
    desks = [box((x, y, 0.68), (x + 1.4, y + 0.8, 0.75)) for x in (0.2, 2.2, 4.2) for y in (0.2, 1.5, 2.8)]
    classroom = _triangles(trimesh.util.concatenate([room(), *desks]))
    floor, roof = find_floor(classroom), find_floor(classroom, roofs=True)
    assert floor is not None
    assert roof is not None
    assert (floor.z_m, roof.z_m) == (pytest.approx(0.0, abs=1e-6), pytest.approx(2.6, abs=1e-6))


@pytest.mark.parametrize("size_m", [0.5, 2.5])
def test_a_floor_within_low_walls_goes_before_a_hole_in_it(size_m):
    ends = np.array([[0, 0, 6, 2], [0, 4.5, 6, 6], [0, 2, 2, 4.5], [2 + size_m, 2, 6, 4.5], [2, 2 + size_m, 4.5, 4.5]])
    floor = [box((x0, y0, -0.1), (x1, y1, 0.0)) for x0, y0, x1, y1 in ends if y1 > y0]
    pit = box((2.0, 2.0, -1.1), (2.0 + size_m, 2.0 + size_m, -1.0))
    found = find_floor(_triangles(trimesh.util.concatenate([*floor, pit, box((-0.1, 0, 0), (0, 6, 0.4))])))
    assert found is not None
    assert found.z_m == pytest.approx(0.0, abs=1e-6)


def test_a_ceiling_is_seen_and_open_sky_is_too():
    assert covered_share(_triangles(room())) > 0.95
    # Only the tops of the walls.
    assert covered_share(_triangles(room(ceiling=False))) < 0.2


def test_walls_alone_have_no_floor():
    assert find_floor(_triangles(box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))[[0]] * [1.0, 0.0, 1.0]) is None


def _on_a_lawn(plinth_m, storeys):
    lawn = box((-15.0, -15.0, -0.1), (15.0, 15.0, 0.0))
    plinth = [box((0.0, 0.0, 0.0), (8.0, 6.0, plinth_m))] if plinth_m else []
    rooms = [room(8.0, 6.0, 2.6).apply_translation([0.0, 0.0, plinth_m + 3.0 * k]) for k in range(storeys)]
    return _triangles(trimesh.util.concatenate([lawn, *plinth, *rooms]))


@pytest.mark.parametrize("storeys", [1, 2])
@pytest.mark.parametrize("plinth_m", [0.0, 0.25])
def test_a_house_on_a_wide_lawn_is_explored_and_not_the_lawn(plinth_m, storeys):
    house = _on_a_lawn(plinth_m, storeys)
    floor = find_floor(house)
    assert floor is not None
    assert floor.z_m == pytest.approx(plinth_m, abs=1e-6)
    heights = [storey.floor_m for storey in find_storeys(house)]
    assert heights == pytest.approx([plinth_m + 3.0 * k for k in range(storeys)], abs=1e-6)


def test_a_yard_with_a_shed_on_it_stays_the_floor():
    yard = trimesh.util.concatenate([box((-6, -6, -0.1), (6, 6, 0.0)), room(1.5, 1.5, 2.2)])
    floor = find_floor(_triangles(yard))
    assert floor is not None
    assert floor.z_m == pytest.approx(0.0, abs=1e-6)
    assert floor.walkable_m2 > 100.0
