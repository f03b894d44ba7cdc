"""Floor plans of three formats become furnished scenes that the robot gets about in."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from anm_mj.errors import SceneError
from anm_mj.scene.generation.furnish import furnish
from anm_mj.scene.generation.layout import plan_building
from anm_mj.scene.importing.import_floorplan import import_floorplan, is_floorplan, read_floorplan
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.navigable import navigable_area
from anm_mj.types import DEFAULT_FOOTPRINT
from tests.public_scenes import PUBLIC_SCENES

_PUBLIC = PUBLIC_SCENES / "floorplans"
_CORNERS = [{"x": x, "y": 0, "z": z} for x, z in ((0, 0), (0, 4), (3, 4), (3, 0))]
_ROOM = {"id": "room|1", "roomType": "Bedroom", "floorPolygon": _CORNERS}


def _box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def _plan1() -> dict:
    """Two rooms of 3 m by 4 m with a wall of 0.25 m between them and a door of 1 m in it."""
    walls = shapely.box(0, 0, 6.75, 4.5) - shapely.box(0.25, 0.25, 3.25, 4.25) - shapely.box(3.5, 0.25, 6.5, 4.25)
    walls -= shapely.box(3.25, 1.75, 3.5, 2.75)
    exterior, holes = list(walls.exterior.coords)[:-1], [list(ring.coords)[:-1] for ring in walls.interiors]
    west = shapely.union_all([shapely.box(0.25, 0.25, 3.25, 4.25), shapely.box(3.25, 1.75, 3.5, 2.75)])
    return {
        "schema": "plan-1",
        "source": {"repo": "someone/plans", "licence": "MIT"},
        "rooms": [
            {"exterior": list(west.exterior.coords)[:-1], "holes": []},
            {"exterior": _box(3.5, 0.25, 6.5, 4.25), "holes": []},
        ],
        "doors": [{"p0": [3.5, 1.75], "p1": [3.5, 2.75], "width": 1.0}],
        "walls": [{"exterior": exterior, "holes": holes}],
        "wall_height": 2.7,
        "door_height": 2.1,
    }


def _procthor() -> dict:
    """The same two rooms side by side, a door of 1 m and a window of 1.2 m in the file's own terms."""

    def wall(name: str, room: str, start: tuple[float, float], end: tuple[float, float]) -> dict:
        corners = [(*start, 0.0), (*end, 0.0), (*start, 2.6), (*end, 2.6)]
        return {"id": name, "roomId": room, "polygon": [{"x": x, "y": y, "z": z} for x, z, y in corners]}

    def room(name: str, kind: str, x0: float, x1: float) -> dict:
        floor = [{"x": x, "y": 0.0, "z": z} for x, z in _box(x0, 0.0, x1, 4.0)]
        return {"id": name, "roomType": kind, "floorPolygon": floor}

    def hole(low: float, high: float, bottom: float, top: float) -> list[dict]:
        return [{"x": low, "y": bottom, "z": 0.0}, {"x": high, "y": top, "z": 0.0}]

    return {
        "rooms": [room("room|1", "Bedroom", 0.0, 3.0), room("room|2", "LivingRoom", 3.0, 6.5)],
        "walls": [
            wall("wall|1|m", "room|1", (3.0, 4.0), (3.0, 0.0)),
            wall("wall|2|m", "room|2", (3.0, 0.0), (3.0, 4.0)),
            wall("wall|1|w", "room|1", (0.0, 0.0), (0.0, 4.0)),
        ],
        "doors": [
            {
                "id": "a",
                "room0": "room|1",
                "room1": "room|2",
                "wall0": "wall|1|m",
                "holePolygon": hole(1.0, 2.0, 0.0, 2.1),
            },
            {
                "id": "b",
                "room0": "room|1",
                "room1": "room|1",
                "wall0": "wall|1|w",
                "holePolygon": hole(1.0, 2.0, 0.0, 2.1),
            },
        ],
        "windows": [{"id": "w", "wall0": "wall|1|w", "holePolygon": hole(2.4, 3.6, 0.9, 2.0)}],
    }


def _houseexpo() -> dict:
    """Two rooms of 4 m by 4 m whose outline runs in at both sides of a door of 0.9 m."""
    verts = [
        [0, 0],
        [4, 0],
        [4, 1.5],
        [4.15, 1.5],
        [4.15, 0],
        [8, 0],
        [8, 4],
        [4.15, 4],
        [4.15, 2.4],
        [4, 2.4],
        [4, 4],
        [0, 4],
    ]
    return {
        "id": "x",
        "room_num": 2,
        "bbox": {"min": [0, 0], "max": [8, 4]},
        "verts": verts,
        "room_category": {"Kitchen": [[0, 0, 4, 4]], "Bedroom": [[4.15, 0, 8, 4]]},
    }


def _written(plan: dict, path: Path) -> Path:
    path.write_text(json.dumps(plan))
    return path


@pytest.mark.parametrize(
    ("plan", "area_m2", "kinds"),
    [
        (_plan1(), 24.0, None),
        (_procthor(), 2.88 * 3.88 + 3.38 * 3.88, {"bedroom", "living"}),
        (_houseexpo(), 31.4, {"kitchen", "bedroom"}),
    ],
    ids=["plan-1", "procthor", "houseexpo"],
)
def test_every_format_gives_its_rooms_and_the_door_between_them(plan, area_m2, kinds, tmp_path):
    src = _written(plan, tmp_path / "plan.json")
    _, building, _ = read_floorplan(src)

    assert is_floorplan(src)
    assert len(building.rooms) == 2
    assert sum(room.floor.area for room in building.rooms) == pytest.approx(area_m2, rel=0.04)
    assert kinds is None or {room.room_type for room in building.rooms} == kinds
    assert [set(passage.rooms) for passage in building.passages] == [{0, 1}]
    gaps = [end - start for walls in building.walls for wall in walls for start, end, door in wall.gaps if door]
    assert len(gaps) >= 2
    assert 1.7 < sum(gaps) < 2.6


@pytest.mark.parametrize("ceiling_m", [1.5, 2.0])
def test_nothing_of_a_low_building_reaches_through_its_ceiling(ceiling_m, tmp_path):
    plan = _plan1() | {"wall_height": ceiling_m}
    scene = import_scene(_written(plan, tmp_path / "plan.json"), tmp_path / "out")
    assert scene.bounds_m[1, 2] == pytest.approx(ceiling_m)
    building = replace(plan_building(14, 0, "apartment"), ceiling_m=ceiling_m)
    rooms = furnish(building, 0)
    assert sum(len(room.placed) for room in rooms) > 14
    assert all(placed.quads().corners_m[:, :, 2].max() <= ceiling_m for room in rooms for placed in room.placed)
    assert all(hole.z_high_m < ceiling_m for room in rooms for wall in room.walls for hole in wall.windows)


@pytest.mark.parametrize("marked", [1, 2])
def test_rooms_of_a_procthor_house_without_a_wall_between_them_are_one_space(marked, tmp_path):
    plan = _procthor()
    del plan["doors"][0]
    closed = read_floorplan(_written(plan, tmp_path / "closed.json"))[1]
    for wall in plan["walls"][:marked]:
        wall["empty"] = True
    src = _written(plan, tmp_path / "plan.json")
    scene = import_scene(src, tmp_path / "out", furniture=False)
    vertices, faces = scene.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)

    assert not any(wall.gaps for walls in closed.walls for wall in walls)
    # Open up to the ceiling, from one wall across to the other.
    gaps = [gap for walls in read_floorplan(src)[1].walls for wall in walls for gap in wall.gaps]
    assert np.allclose(gaps, [(0.0, 3.88, False)] * 2)
    assert scene.rooms == 2
    assert (places[:, 0] < 2.5).any()
    assert (places[:, 0] > 4.0).any()


def test_an_open_border_of_procthor_rooms_may_have_a_corner(tmp_path):
    def room(name: str, corners: list[tuple[float, float]]) -> dict:
        floor = [{"x": x, "y": 0.0, "z": z} for x, z in corners]
        return {"id": name, "roomType": "Kitchen", "floorPolygon": floor}

    def wall(name: str, room: str, ends: tuple[tuple[float, float], ...]) -> dict:
        corners = [{"x": x, "y": y, "z": z} for y in (0.0, 2.6) for x, z in ends]
        return {"id": name, "roomId": room, "polygon": corners, "empty": True}

    plan = {
        "rooms": [
            room("room|1", [(0, 0), (3, 0), (3, 3), (0, 3)]),
            room("room|2", [(3, 0), (6, 0), (6, 6), (0, 6), (0, 3), (3, 3)]),
        ],
        "walls": [wall("a", "room|1", ((3, 0), (3, 3))), wall("b", "room|1", ((3, 3), (0, 3)))],
        "doors": [],
    }
    _, building, _ = read_floorplan(_written(plan, tmp_path / "plan.json"))
    # Between outer walls of 0.12 m, half of which lies in the rooms.
    assert sum(room.floor.area for room in building.rooms) == pytest.approx(5.88**2)


def test_a_procthor_house_of_the_first_version_is_read(tmp_path):
    plan = _procthor()
    new = read_floorplan(_written(plan, tmp_path / "new.json"))[1]
    for entry in (*plan["doors"], *plan["windows"]):
        low, high = entry.pop("holePolygon")
        entry["boundingBox"] = {"min": low, "max": high}
    old = read_floorplan(_written(plan, tmp_path / "old.json"))[1]
    assert [passage.floor for passage in old.passages] == [passage.floor for passage in new.passages]
    assert old.windows == new.windows


def test_one_room_is_counted_as_one(tmp_path, caplog):
    plan = _houseexpo() | {"verts": [[0, 0], [8, 0], [8, 4], [0, 4]]}
    with caplog.at_level("INFO"):
        import_floorplan(_written(plan, tmp_path / "plan.json"), tmp_path / "out", furniture=False)
    assert "plan.json: 1 room, 0 passages (HouseExpo)" in caplog.text


def test_a_houses_windows_are_those_of_the_file(tmp_path):
    _, building, _ = read_floorplan(_written(_procthor(), tmp_path / "plan.json"))

    assert building.windows is not None
    (window,) = building.windows
    assert np.allclose([window.start_m, window.end_m], [(0.0, 2.4), (0.0, 3.6)])
    assert (window.z_low_m, window.z_high_m) == (0.9, 2.0)


@pytest.mark.parametrize("furniture", [True, False])
def test_an_imported_plan_can_be_driven_through(furniture, tmp_path):
    src = _written(_plan1(), tmp_path / "plan.json")
    scene = import_scene(src, tmp_path / "out", furniture=furniture)
    vertices, faces = scene.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)

    assert (scene.rooms, scene.licence) == (2, "MIT")
    assert scene.has_ceiling
    assert scene.bounds_m[1, 2] == pytest.approx(2.7)
    assert (places[:, 0] < 2.5).any()
    assert (places[:, 0] > 4.5).any()


def test_a_room_of_any_outline_is_closed_above_and_below(tmp_path):
    """Floor and ceiling of an L-shaped room have its area, and are seen from inside."""
    plan = _plan1()
    ell = shapely.box(0.25, 0.25, 3.25, 4.25) - shapely.box(0.25, 0.25, 1.5, 2.0)
    ell = shapely.union_all([ell, shapely.box(3.25, 1.75, 3.5, 2.75)])
    plan["rooms"][0]["exterior"] = list(ell.exterior.coords)[:-1]
    walls = shapely.Polygon(plan["walls"][0]["exterior"], plan["walls"][0]["holes"])
    walls = shapely.union_all([walls, shapely.box(0.25, 0.25, 1.5, 2.0)])
    plan["walls"] = [
        {"exterior": list(part.exterior.coords)[:-1], "holes": [list(ring.coords)[:-1] for ring in part.interiors]}
        for part in shapely.get_parts(walls)
    ]
    scene = import_floorplan(_written(plan, tmp_path / "plan.json"), tmp_path / "out", furniture=False)
    vertices, faces = scene.triangles()
    normal = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))) / 2.0
    z = vertices[faces][:, :, 2]
    area = 24.0 - 1.25 * 1.75 + 0.25

    floor, ceiling = (z == 0.0).all(axis=1), np.isclose(z, 2.7).all(axis=1)
    assert normal[floor, 2].clip(0.0).sum() == pytest.approx(area, rel=0.02)
    assert -normal[ceiling, 2].clip(None, 0.0).sum() == pytest.approx(area - 0.25, rel=0.03)


def _with(plan: dict, at: tuple, value: object) -> str:
    """The text of a plan with another value at a place."""
    *way, last = at
    node = plan
    for key in way:
        node = node[key]
    node[last] = value
    return json.dumps(plan)


def _procthor_walls(top: float) -> str:
    plan = _procthor()
    for wall in plan["walls"]:
        for corner in wall["polygon"]:
            corner["y"] *= top
    return json.dumps(plan)


def _many_rooms(num: int) -> str:
    plan = _procthor()
    corners = [_box(10.0 + 3 * k, 0.0, 13.0 + 3 * k, 3.0) for k in range(num)]
    floors = [[{"x": x, "y": 0.0, "z": z} for x, z in box] for box in corners]
    plan["rooms"] += [{"id": f"more|{k}", "roomType": "Bedroom", "floorPolygon": f} for k, f in enumerate(floors)]
    return json.dumps(plan)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (_with(_plan1(), ("wall_height",), -3), "-3 m high"),
        (_with(_plan1(), ("wall_height",), 1e9), r"e[+]09 m high"),
        (_with(_plan1(), ("door_height",), 0), r"doors of .* 0 m high"),
        (_with(_plan1(), ("doors", 0, "p0"), [1e300, 1]), "farther than"),
        (_procthor_walls(160.0), "416 m high"),
        (_procthor_walls(1e12), "m high"),
        (_with(_procthor(), ("doors", 0, "holePolygon", 1, "x"), 1e9), "outside of its wall"),
        (_with(_procthor(), ("windows", 0, "holePolygon", 1, "y"), 1e9), "outside of its wall"),
        (_many_rooms(400), "402 rooms.*ANM_MJ_MAX_ROOMS"),
        (
            _with(_procthor(), ("rooms", 0, "floorPolygon"), [{"x": x, "z": z} for x, z in _box(-400, 0, 0, 400)]),
            "m2.*ANM_MJ_MAX_FLOOR_M2",
        ),
        (
            _with(_procthor(), ("rooms", 0, "floorPolygon"), [{"x": x, "z": z} for x, z in _box(0, 0, 4, 4)]),
            "rooms 'room.1' and 'room.2' lie over one another",
        ),
        (
            _with(
                _procthor(),
                ("rooms", 0, "floorPolygon"),
                [{"x": -x, "z": z} for x, z in [(0, 0), (4, 4), (4, 0), (0, 4)]],
            ),
            "crosses itself",
        ),
        (json.dumps({"verts": _box(0, 0, 200, 200), "room_category": {}}), "200 m by 200 m is larger"),
    ],
)
def test_what_is_no_building_is_refused_before_it_is_built(tmp_path, text, said):
    src = tmp_path / "plan.json"
    src.write_text(text)
    with pytest.raises(SceneError, match=said):
        import_floorplan(src, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not a JSON document"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "nested too deeply"),
        ("{}", "no floor plan of a known format"),
        ('{"schema": "plan-1"}', "damaged plan-1"),
        ('{"verts": [], "room_category": {}}', "damaged HouseExpo"),
        ('{"verts": [[0, 0], [4, 0], [4, 4], [0, 4]], "room_category": 7}', "damaged HouseExpo"),
        (json.dumps({"proceduralParameters": {}, "rooms": [_ROOM], "walls": [], "doors": []}), "it has no walls"),
        ('{"verts": [[0, 0], [9000, 0], [0, 9000]], "room_category": {}}', "larger than 500 m"),
        ('{"verts": [[0, 0], [NaN, 0], [0, 9]], "room_category": {}}', "it holds NaN"),
    ],
    ids=lambda value: value[:30],
)
def test_what_is_no_plan_is_refused_in_a_sentence(text, said, tmp_path):
    src = tmp_path / "plan.json"
    src.write_text(text)

    with pytest.raises(SceneError, match=said):
        import_floorplan(src, tmp_path / "out")


@pytest.mark.skipif(not _PUBLIC.is_dir(), reason="ANM_MJ_PUBLIC_SCENES names no folder with floor plans")
@pytest.mark.parametrize("number", [38, 52])
def test_real_plans_keep_their_rooms_doors_and_area(number):
    src = _PUBLIC / f"kth_dev_{number:03d}.json"
    plan = json.loads(src.read_text())
    _, building, _ = read_floorplan(src)

    assert len(building.rooms) == plan["n_rooms"]
    assert len(building.passages) == len(plan["doors"])
    area = sum(part.floor.area for part in (*building.rooms, *building.passages))
    assert area == pytest.approx(plan["free_area_m2"], rel=0.03)
