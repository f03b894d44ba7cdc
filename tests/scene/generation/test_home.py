"""The project's own house: what is committed is what the generator makes, and a robot can live in it."""

from pathlib import Path

import numpy as np
import pytest

from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.generation.furniture.atlas import pack
from anm_mj.scene.generation.furniture.quads import Quads, ball, box, cushion, cylinder, lathe, strut
from anm_mj.scene.generation.furniture.textures import hashed, noise, plain
from anm_mj.scene.generation.furniture.wall import WINDOW_DEPTH_M
from anm_mj.scene.home.house import HOME_STARTS, furnished_rooms, make_small_scene
from anm_mj.scene.home.layout import (
    CEILING_M,
    DOOR_HEIGHT_M,
    WALL_M,
    Room,
    doorway_passage,
    room_shell,
)
from anm_mj.scene.home.plan import home_doorways, home_rooms
from anm_mj.scene.home.rooms import furnish
from anm_mj.scene.navigable import DEFAULT_FOOTPRINT, is_clear, navigable_area

_GREY = plain((0.5, 0.5, 0.5))
_HOME = Path(__file__).resolve().parents[3] / "scenes" / "home"


@pytest.fixture(scope="module")
def home() -> Scene:
    return load_scene(_HOME)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_small_scene(tmp_path_factory.mktemp("scenes") / "small")


def _volume(surface: Quads) -> float:
    """Signed volume by the divergence theorem; positive when a closed surface faces outward."""
    p = surface.corners_m
    triangles = np.concatenate([p[:, [0, 1, 2]], p[:, [0, 2, 3]]])
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0)


@pytest.mark.parametrize(
    ("body", "volume"),
    [
        (box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), _GREY), 6.0),
        (lathe([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)], _GREY, 64), 2.0 * np.pi),
        (ball(1.0, _GREY, 64), 4.0 / 3.0 * np.pi),
        (strut((0.0, 0.0, 0.0), (0.0, 1.0, 1.0), 0.5, _GREY, 64), 0.25 * np.pi * np.sqrt(2.0)),
        (cushion((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.001, _GREY), 1.0),
        (box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), _GREY).tilted(30.0).placed(3.0, -2.0, 50.0, 1.0), 1.0),
    ],
)
def test_bodies_are_closed_and_face_outward(body: Quads, volume: float):
    assert _volume(body) == pytest.approx(volume, rel=0.01)


def test_a_cylinder_stands_open_at_its_bottom():
    normals = cylinder(0.1, 0.0, 1.0, _GREY).normals

    assert (normals[:, 2] > -0.5).all()
    assert (normals[:, 2] > 0.5).any()


def test_a_skipped_face_is_the_one_named():
    normals = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), _GREY, skip="-z +y").normals

    assert not (normals @ (0.0, 0.0, -1.0) > 0.9).any()
    assert not (normals @ (0.0, 1.0, 0.0) > 0.9).any()
    assert len(normals) == 4


@pytest.mark.parametrize("room", home_rooms(), ids=lambda room: room.name)
def test_a_rooms_shell_faces_its_inside(room: Room):
    """From the middle of the room no wall, floor or ceiling is seen from behind."""
    shell = room_shell(room, home_doorways())
    p = shell.corners_m
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 3] - p[:, 0]), axis=1)
    to_middle = np.array([*room.centre_m, 1.3]) - p.mean(axis=1)

    facing = (shell.normals * to_middle).sum(axis=1)

    assert (area > 0.5).sum() >= 6
    assert (facing[area > 0.5] > 0).all()


def test_nothing_sticks_through_a_wall():
    for room in home_rooms():
        corners = furnish(room).corners_m
        low, high = np.array(room.low_m), np.array(room.high_m)
        assert (corners[..., :2] > low - WALL_M / 2).all(), room.name
        assert (corners[..., :2] < high + WALL_M / 2).all(), room.name
        assert corners[..., 2].min() > -0.005, room.name
        assert corners[..., 2].max() < CEILING_M, room.name


def test_doorways_are_as_wide_and_high_as_they_say():
    for doorway in home_doorways():
        corners = doorway_passage(doorway, home_rooms()[0].finish).corners_m.reshape(-1, 3)
        across = 0 if doorway.along == "x" else 1
        assert np.ptp(corners[:, across]) == pytest.approx(doorway.width_m)
        assert np.ptp(corners[:, 2]) == pytest.approx(DOOR_HEIGHT_M)
        assert corners[:, 1 - across].mean() == pytest.approx(doorway.line_m)


def test_packed_rectangles_do_not_overlap():
    sizes = np.random.default_rng(3).integers(2, 40, (300, 2))

    corners, (width, height) = pack(sizes)

    taken = np.zeros((height, width), np.int64)
    for (x, y), (w, h) in zip(corners, sizes, strict=True):
        taken[y : y + h, x : x + w] += 1
    assert taken.max() == 1
    assert taken.sum() == sizes.prod(axis=1).sum()


def test_noise_is_continuous_and_fills_its_range():
    line = np.stack([np.linspace(-20.0, 20.0, 40_001), np.full(40_001, 0.3)], axis=-1)

    values = noise(line)

    assert np.abs(np.diff(values)).max() < 0.005
    assert values.min() < 0.2
    assert values.max() > 0.8


def test_hashed_numbers_are_evenly_spread():
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(-100, 100), np.arange(-100, 100)))

    values = hashed(i, j, 4)

    assert np.histogram(values, 10, (0.0, 1.0))[0] == pytest.approx(len(values) / 10, rel=0.06)
    assert np.corrcoef(values[:-1], values[1:])[0, 1] == pytest.approx(0.0, abs=0.02)


def test_the_small_scene_is_the_same_every_time(small: Scene, tmp_path: Path):
    again = make_small_scene(tmp_path / "again")

    assert again.hash == small.hash
    assert (again.folder / "geometry.npz").read_bytes() == (small.folder / "geometry.npz").read_bytes()


def test_the_small_scene_can_be_lived_in(small: Scene):
    vertices, faces = small.triangles()
    area = navigable_area(vertices[faces], DEFAULT_FOOTPRINT)
    places = area.places(1)

    assert small.has_ceiling
    assert (places[:, 0] < 2.5).any()
    assert (places[:, 0] > 3.5).any()
    assert all(is_clear(small, start, DEFAULT_FOOTPRINT) for start in small.starts)


def test_the_committed_house_is_the_one_that_the_code_makes(home: Scene):
    """The geometry, exactly; light and texture follow from it and take half a minute to paint."""
    vertices, _ = home.triangles()
    surfaces = furnished_rooms(home_rooms(), home_doorways()).values()
    made = np.concatenate([surface.corners_m.reshape(-1, 3) for surface in surfaces]).astype(np.float32)

    committed, made = (np.unique(np.round(points, 3), axis=0) for points in (vertices, made))

    both = np.concatenate([committed, made])
    assert len(np.unique(both, axis=0)) == len(made)
    # What lies inside other bodies is left out when the scene is written.
    assert len(committed) > 0.9 * len(made)


def test_the_house_is_light_enough_to_come_with_the_code(home: Scene):
    size = sum(file.stat().st_size for file in home.folder.rglob("*") if file.is_file())

    assert size < 6_000_000
    assert 15_000 <= home.num_triangles <= 40_000
    assert home.rooms == len(home_rooms())
    assert home.has_ceiling


def test_the_robot_reaches_every_room_of_the_house(home: Scene):
    vertices, faces = home.triangles()
    places = navigable_area(vertices[faces], DEFAULT_FOOTPRINT).places(1)

    for room in home_rooms():
        inside = (places > room.low_m).all(axis=1) & (places < room.high_m).all(axis=1)
        assert inside.sum() * 0.025**2 > 1.0, room.name


def test_the_starts_of_the_house_are_clear(home: Scene):
    assert len(home.starts) == len(HOME_STARTS) == 3
    assert all(is_clear(home, start, DEFAULT_FOOTPRINT) for start in home.starts)


def test_the_house_has_no_outside(home: Scene):
    """Nothing lies farther out than the window panes, above the ceiling or below the floor."""
    rooms = home_rooms()
    low = np.min([room.low_m for room in rooms], axis=0) - WINDOW_DEPTH_M - 1e-3
    high = np.max([room.high_m for room in rooms], axis=0) + WINDOW_DEPTH_M + 1e-3

    assert (home.bounds_m[0, :2] >= low).all()
    assert (home.bounds_m[1, :2] <= high).all()
    assert home.bounds_m[0, 2] > -0.005
    assert home.bounds_m[1, 2] == pytest.approx(CEILING_M)
