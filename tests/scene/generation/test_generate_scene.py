"""Generated buildings: the same every time, every room within reach, ways round in circles."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import ndimage
from scipy.sparse.csgraph import connected_components

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.building_map import generated_map
from anm_mj.scene.generation.furnish import furnish
from anm_mj.scene.generation.generate_scene import generate_scene
from anm_mj.scene.generation.layout import plan_building
from anm_mj.scene.generation.move_furniture import move_furniture
from anm_mj.scene.navigable import is_clear, navigable_area
from anm_mj.types import DEFAULT_FOOTPRINT


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return generate_scene(tmp_path_factory.mktemp("scenes") / "flat", 2, 4)


@pytest.mark.parametrize("kind", ["apartment", "office"])
@pytest.mark.parametrize("rooms", [1, 2, 3, 5, 8, 13, 21, 40])
def test_a_plan_has_the_rooms_asked_for_all_joined_and_circles_from_five_on(rooms, kind):
    building = plan_building(rooms, 11, kind)
    joined = np.eye(rooms, dtype=bool)
    for passage in building.passages:
        i, j = passage.rooms
        joined[i, j] = joined[j, i] = True
    num, _ = connected_components(joined)

    assert len(building.rooms) == rooms
    assert num == 1
    assert len(building.passages) >= rooms - 1 + (rooms >= 5)


@pytest.mark.parametrize("kind", ["apartment", "office"])
@pytest.mark.parametrize("rooms", [4, 9, 30])
def test_rooms_do_not_overlap_and_passages_are_as_wide_as_a_robot_needs(rooms, kind):
    building = plan_building(rooms, 3, kind)
    floors = [room.floor for room in building.rooms] + [passage.floor for passage in building.passages]

    assert sum(floor.area for floor in floors) == pytest.approx(shapely.union_all(floors).area)
    for passage in building.passages:
        x0, y0, x1, y1 = passage.floor.bounds
        assert max(x1 - x0, y1 - y0) >= 0.8 - 1e-9
        for room in passage.rooms:
            assert building.rooms[room].floor.distance(passage.floor) == pytest.approx(0.0, abs=1e-6)


def test_walls_are_open_exactly_where_passages_are():
    building = plan_building(12, 2)
    gaps = sum(end - start for walls in building.walls for wall in walls for start, end, _ in wall.gaps)
    widths = 0.0
    for passage in building.passages:
        x0, y0, x1, y1 = passage.floor.bounds
        widths += 2.0 * max(x1 - x0, y1 - y0)
        assert sum(jamb.length_m for jamb in building.jambs(passage)) == pytest.approx(2.0 * min(x1 - x0, y1 - y0))

    assert gaps == pytest.approx(widths)


@pytest.mark.parametrize(("rooms", "seed", "kind"), [(0, 1, "apartment"), (61, 1, "office"), (3, -1, "office")])
def test_what_cannot_be_made_is_refused(rooms, seed, kind):
    with pytest.raises(SceneError, match="give"):
        plan_building(rooms, seed, kind)


def test_furniture_stands_inside_its_room_and_off_the_doors():
    building = plan_building(9, 5, "office")
    for room in furnish(building, 5):
        for placed in room.placed:
            body = shapely.union_all(shapely.polygons(placed.corners_m()))
            assert room.room.floor.buffer(0.01).covers(body), placed.piece.name
            for passage in building.passages:
                assert body.distance(passage.floor) > 0.04, placed.piece.name


def test_drawn_furniture_keeps_to_its_outline():
    """What the robot could bump into lies inside the outline that the map shows."""
    for kind in ("apartment", "office"):
        for room in furnish(plan_building(7, 8, kind), 8):
            for placed in room.placed:
                corners = placed.quads().corners_m.reshape(-1, 3)
                at_body = corners[(corners[:, 2] > 0.05) & (corners[:, 2] < 1.35)]
                outline = shapely.union_all(shapely.polygons(placed.corners_m())).convex_hull.buffer(0.08)
                assert shapely.covers(outline, shapely.points(at_body[:, :2])).all(), placed.piece.name


def test_a_topdown_map_is_the_same_every_time_and_all_of_one_piece():
    one, two = generated_map(6, 9), generated_map(6, 9)
    free, num = ndimage.label(ndimage.binary_erosion(~one.obstacles, iterations=4))
    sizes = np.bincount(free.ravel())[1:]

    assert (one.obstacles == two.obstacles).all()
    assert num >= 1
    assert set(np.unique(one.rooms[free == 1 + np.argmax(sizes)])) >= set(range(6))
    assert len(one.room_types) == 6
    other = generated_map(6, 10)
    assert other.obstacles.shape != one.obstacles.shape or (other.obstacles != one.obstacles).any()


def test_a_bare_map_shows_walls_only():
    bare, full = generated_map(4, 1, furniture=False), generated_map(4, 1)

    assert (bare.obstacles <= full.obstacles).all()
    assert not bare.obstacles[bare.rooms >= 0].any()


def test_a_generated_scene_is_the_same_to_the_byte(flat: Scene, tmp_path: Path):
    again = generate_scene(tmp_path / "flat", 2, 4)

    assert again.hash == flat.hash
    for file in flat.folder.rglob("*"):
        if file.is_file():
            assert file.read_bytes() == (again.folder / file.relative_to(flat.folder)).read_bytes(), file.name


def test_the_robot_gets_into_every_room_of_a_generated_scene(flat: Scene):
    vertices, faces = flat.triangles()
    area = navigable_area(vertices[faces], DEFAULT_FOOTPRINT)
    places = shapely.points(area.places(1))

    for room in plan_building(2, 4).rooms:
        assert shapely.contains(room.floor, places).sum() * 0.025**2 > 0.3, room.name
    assert len(flat.starts) >= 3
    assert all(is_clear(flat, start, DEFAULT_FOOTPRINT) for start in flat.starts)
    assert flat.has_ceiling
    assert flat.rooms == 2


def test_the_map_agrees_with_the_scene(flat: Scene):
    """Where the triangles leave room for the robot, the map shows no obstacle at its axis."""
    vertices, faces = flat.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)
    made = generated_map(2, 4)
    cols, rows = ((places - made.origin_xy_m) / made.resolution_m).astype(int).T

    assert made.obstacles[rows, cols].mean() < 0.03


def test_moved_furniture_stands_where_nothing_stood(tmp_path):
    def rooms(moved):
        building = plan_building(5, 4, "apartment")
        before = furnish(building, 4)
        return before, *move_furniture(before, moved, 4, lambda rooms: True)

    before, after, moves = rooms(2)
    assert len(moves) == 2
    assert len({move.room for move in moves}) == 2
    changed = [
        (old, new)
        for a, b in zip(before, after, strict=True)
        for old, new in zip(a.placed, b.placed, strict=True)
        if old is not new
    ]
    assert [old.piece for old, _ in changed] == [new.piece for _, new in changed]
    assert len(changed) == 2
    for move in moves:
        outline = shapely.Polygon(move.entry["to"]["outline_xy_m"])
        standing = [p for room in before for p in room.placed if p.piece.placement in ("wall", "corner", "middle")]
        for placed in standing:
            bodies = shapely.union_all(shapely.polygons(placed.corners_m()))
            assert outline.intersection(bodies).area < 0.02
    assert [m.entry for m in rooms(2)[2]] == [m.entry for m in moves]
    with pytest.raises(SceneError, match="--moved is 500"):
        rooms(500)
