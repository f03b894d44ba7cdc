import math

import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics
from tests.mapping.numpy_occupancy import footprint_minima
from tests.mapping.ray_room import LEG, Room, camera_pose


def _fused(observations, config=None):
    occupancy = DepthOccupancy(config or OccupancyConfig())
    for observation in observations:
        occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    return occupancy


def _centres(grid, state):
    cells = np.argwhere(grid.state == state)
    return grid.origin_m + (cells[:, ::-1] + 0.5) * grid.resolution_m


@pytest.fixture(scope="module")
def occupancy(room: Room) -> DepthOccupancy:
    return _fused(room.turn(1.5, 1.5, 12, size=128))


def test_occupied_voxels_touch_surfaces_and_free_ones_lie_in_free_space(room, occupancy):
    half_diagonal = 0.5 * math.sqrt(3.0) * 0.05
    assert np.abs(room.sdf(_centres(occupancy.grid, OCCUPIED))).max() <= half_diagonal + 1e-3
    assert room.sdf(_centres(occupancy.grid, FREE)).min() > -1e-3


def test_most_of_the_room_in_view_is_known(room, occupancy):
    rng = np.random.default_rng(0)
    points = rng.uniform([0.3, 0.3, 0.6], [2.2, 2.7, 1.8], (2000, 3))
    inside = points[room.sdf(points) > 0.1]
    far_from_camera = np.hypot(*(inside[:, :2] - 1.5).T) > 0.7
    assert (occupancy.state_at(inside[far_from_camera]) == FREE).mean() > 0.99


def test_nothing_is_known_behind_walls_or_below_the_table_top(room, occupancy):
    behind = np.array([[-0.3, 1.5, 1.2], [4.3, 1.5, 1.2], [1.5, -0.4, 0.8], [1.5, 1.5, -0.3], [3.0, 1.5, 0.4]])
    assert (occupancy.state_at(behind) == UNKNOWN).all()


def test_the_floor_fills_one_layer(occupancy):
    grid = occupancy.grid
    column = np.floor((np.array([1.0, 2.8]) - grid.origin_m[:2]) / grid.resolution_m).astype(int)
    layers = np.flatnonzero(grid.state[:, column[1], column[0]] == OCCUPIED)
    heights = grid.origin_m[2] + (layers + 0.5) * grid.resolution_m
    assert np.isclose(heights, 0.0).sum() == 1
    assert not np.isclose(np.abs(heights), 0.05).any()


def test_voxel_arrays_are_indexed_layer_row_column(room):
    # Mirrored or transposed axes would put the table elsewhere.
    occupancy = _fused([room.observe(1.5, 1.5, 0.0, size=128)])
    grid = occupancy.grid
    x, y, z = np.floor((np.array([2.6, 1.5, 0.6]) - grid.origin_m) / grid.resolution_m).astype(int)
    assert (grid.state[z, y, x - 1 : x + 2] == OCCUPIED).any()
    assert occupancy.state_at(np.array([[2.6, 1.5, 0.6]]))[0] == OCCUPIED


@pytest.mark.parametrize("distance_m", [pytest.param(1.0, marks=pytest.mark.slow), 2.0, 3.0])
def test_a_thin_leg_is_never_carved_away(distance_m):
    room = Room(furniture=(LEG,))
    views = [room.observe(2.0, 2.2 - distance_m * 0.7, math.pi / 2 + turn, size=256) for turn in (-0.2, 0.0, 0.1) * 20]
    occupancy = _fused(views)
    leg = np.stack((np.full(10, 2.0), np.full(10, 2.2), np.linspace(0.6, 1.6, 10)), axis=1)
    assert (occupancy.state_at(leg) == OCCUPIED).all()


def test_what_moved_away_is_carved_in_the_end():
    away = Room(furniture=())
    occupancy = _fused([Room().observe(1.5, 1.5, 0.0, size=128)] * 3 + [away.observe(1.5, 1.5, 0.0, size=128)] * 40)
    assert occupancy.state_at(np.array([[2.6, 1.5, 0.6]]))[0] == FREE


def test_growth_keeps_what_was_there_at_the_same_place(room):
    occupancy = _fused([room.observe(1.5, 1.5, 0.0, size=64)])
    before = occupancy.grid
    known = np.argwhere(before.state != UNKNOWN)
    points = before.origin_m + (known[:, ::-1] + 0.5) * before.resolution_m
    states = before.state[tuple(known.T)].copy()
    seen = before.seen_range_m.copy()
    origin = before.origin_m.copy()
    empty = np.full((4, 4), np.nan, np.float32)
    far = camera_pose(-20.0, 15.0, 1.0, math.pi)
    occupancy.integrate(empty, Intrinsics.from_fov(4, 4, 1.0), far)
    after = occupancy.grid
    assert np.prod(after.state.shape) > np.prod(before.state.shape)
    np.testing.assert_array_equal(occupancy.state_at(points), states)
    shift = np.rint((origin - after.origin_m) / 0.05).astype(int)[::-1]
    part = tuple(slice(s, s + n) for s, n in zip(shift, seen.shape, strict=True))
    np.testing.assert_array_equal(after.seen_range_m[part], seen)
    assert (occupancy.voxels.corner % BLOCK == 0).all()


def test_seen_range_is_the_nearest_view_of_a_surface(room):
    wall = np.array([[0.0, 1.5, 1.2]])
    far = room.observe(2.0, 1.5, math.pi, size=128)
    near = room.observe(1.0, 1.5, math.pi, size=128)
    for views, expected in (([far], 2.0), ([far, near], 1.0), ([near, far], 1.0)):
        occupancy = _fused(views)
        grid = occupancy.grid
        x, y, z = np.floor((wall[0] - grid.origin_m) / grid.resolution_m).astype(int)
        assert grid.seen_range_m[z, y, x] == pytest.approx(expected, abs=0.01)
    assert np.isinf(grid.seen_range_m[grid.state == UNKNOWN]).all()


def test_surfaces_beyond_the_carving_range_are_marked_but_the_way_there_stays_unknown():
    config = OccupancyConfig(carve_range_m=1.0, hit_range_m=8.0)
    occupancy = _fused([Room(furniture=()).observe(1.0, 1.5, 0.0, size=128)], config)
    x_of = np.array([[1.8, 1.5, 1.2], [2.5, 1.5, 1.2], [4.0, 1.5, 1.2]])
    assert occupancy.state_at(x_of).tolist() == [FREE, UNKNOWN, OCCUPIED]


@pytest.mark.parametrize(("is_free", "state"), [(True, FREE), (False, UNKNOWN)])
def test_pixels_without_depth_carve_only_if_asked_to(is_free, state):
    sky = np.full((64, 64), np.inf, np.float32)
    occupancy = DepthOccupancy(OccupancyConfig(no_depth_is_free=is_free))
    occupancy.integrate(sky, Intrinsics.from_fov(64, 64, 1.5), camera_pose(0.0, 0.0, 1.0, 0.0))
    assert (occupancy.state_at(np.array([[2.0, 0.0, 1.0], [4.8, 0.0, 1.0]])) == state).all()
    assert (occupancy.grid.state != OCCUPIED).all()


def test_pixels_that_were_not_measured_carve_nothing():
    occupancy = DepthOccupancy(OccupancyConfig())
    depth = np.full((64, 64), np.nan, np.float32)
    depth[:, :8] = 2.0
    occupancy.integrate(depth, Intrinsics.from_fov(64, 64, 1.5), camera_pose(0.0, 0.0, 1.0, 0.0))
    assert occupancy.state_at(np.array([[1.5, 0.0, 1.0], [1.5, -1.0, 1.0]])).tolist() == [UNKNOWN, UNKNOWN]
    assert (occupancy.grid.state == FREE).any()


def test_single_pixels_that_were_not_measured_hide_no_free_space():
    depth = np.full((64, 64), 2.0, np.float32)
    depth[np.random.default_rng(0).random((64, 64)) < 0.1] = np.nan
    occupancy = DepthOccupancy(OccupancyConfig())
    occupancy.integrate(depth, Intrinsics.from_fov(64, 64, 1.5), camera_pose(0.0, 0.0, 1.0, 0.0))
    ahead = np.stack([np.linspace(0.5, 1.7, 20), np.zeros(20), np.ones(20)], axis=1)
    assert (occupancy.state_at(ahead) == FREE).all()


def test_a_pitched_and_rolled_camera_carves_the_same_truth(room):
    observation = room.observe(1.5, 1.5, 0.3, size=96)
    # Rotate the camera about itself and cast again.
    angle = 0.4
    c, s = math.cos(angle), math.sin(angle)
    pitch = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    roll = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    T_world_camera = observation.T_world_camera @ pitch @ roll
    from anm_mj.frames import pixel_directions

    directions = pixel_directions(observation.intrinsics).reshape(-1, 3) @ T_world_camera[:3, :3].T
    depth = room.cast(T_world_camera[:3, 3], directions).reshape(96, 96).astype(np.float32)
    occupancy = DepthOccupancy(OccupancyConfig())
    occupancy.integrate(depth, observation.intrinsics, T_world_camera)
    free = _centres(occupancy.grid, FREE)
    assert len(free) > 5000
    assert room.sdf(free).min() > -1e-3
    axis = T_world_camera[:3, 2]
    ahead = T_world_camera[:3, 3] + axis * np.linspace(0.4, depth[48, 48] - 0.15, 10)[:, None]
    assert (occupancy.state_at(ahead) == FREE).all()


def test_footprint_minima_double_their_reach():
    image = np.full((64, 64), 5.0, np.float32)
    image[32, 32] = 1.0
    for level, minima in enumerate(footprint_minima(image)):
        reach = 1 << level
        low = np.argwhere(minima == 1.0)
        assert low.min(axis=0).tolist() == [32 - reach] * 2
        assert low.max(axis=0).tolist() == [32 + reach] * 2


def test_an_impossible_setting_is_refused_with_its_value():
    with pytest.raises(MapError, match="limit is 200"):
        OccupancyConfig(limit=200)


def test_the_sky_frees_space_without_making_the_grid_grow():
    open_room = Room(ceiling=False)
    grid = DepthOccupancy(OccupancyConfig())
    for yaw in (0.0, 1.5, 3.0, 4.5):
        view = open_room.observe(1.5, 1.5, yaw, size=64)
        grid.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
    top_m = grid.grid.origin_m[2] + grid.grid.state.shape[0] * grid.grid.resolution_m
    # Walls are 2.4 m high; blocks of 0.8 m are added as a whole.
    assert 2.4 <= top_m < 4.0
    assert grid.state_at(np.array([[3.2, 1.5, 2.35]]))[0] == FREE


def test_looks_are_counted_at_the_place_that_a_pixel_shows():
    room = Room(ceiling=False)
    occupancy = DepthOccupancy(OccupancyConfig())
    view = room.observe(1.5, 1.2, 0.4)
    counts = []
    for _ in range(2):
        occupancy.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
        counts.append(occupancy.observation_count(view.depth_m, view.intrinsics, view.T_world_camera).astype(int))
    seen = np.isfinite(view.depth_m)
    assert (counts[0] > 0).tolist() == seen.tolist()
    np.testing.assert_array_equal(counts[1], 2 * counts[0])
    # A voxel far away takes fewer pixels than a near one.
    near, far = view.depth_m < 1.5, view.depth_m > 2.2
    assert np.median(counts[0][near]) > np.median(counts[0][far])
    elsewhere = view.T_world_camera.copy()
    elsewhere[0, 3] += 50.0
    assert not occupancy.observation_count(view.depth_m, view.intrinsics, elsewhere).any()


def test_layers_between_start_where_a_lower_face_lies_in_the_range():
    grid = DepthOccupancy(OccupancyConfig(voxel_m=0.1)).grid
    assert grid.layers_between(0.04, 0.36) == slice(1, 5)
    assert grid.num_layers_between(0.04, 0.36) == 4
    assert grid.layers_between(-1.0, 0.36) == slice(0, 5)


def test_whole_layers_lie_in_the_range():
    grid = DepthOccupancy(OccupancyConfig(voxel_m=0.1)).grid
    assert grid.layers_between(0.04, 0.36, whole=True) == slice(1, 4)


@pytest.mark.parametrize(("z_m", "layer"), [(0.0, 0), (0.05, 1), (-0.06, -1)])
def test_layer_of(z_m, layer):
    assert DepthOccupancy(OccupancyConfig(voxel_m=0.1)).grid.layer_of(z_m) == layer


@pytest.mark.parametrize("far_m", [2e3, 1e8])
def test_a_grid_says_how_large_it_would_be_before_it_grows(far_m):
    camera = Intrinsics(8, 8, 4.0, 4.0, 4.0, 4.0)
    occupancy = DepthOccupancy(OccupancyConfig())
    occupancy.integrate(np.ones((8, 8), np.float32), camera, np.eye(4))
    shape = occupancy.grid.state.shape
    T = np.eye(4)
    T[:2, 3] = far_m
    with pytest.raises(MapError, match=r"Frame 2 lets the map extend over .* ANM_MJ_MAX_VOXELS"):
        occupancy.integrate(np.ones((8, 8), np.float32), camera, T)
    assert occupancy.grid.state.shape == shape


@pytest.mark.parametrize("far_m", [1.1e5, -5e6])
def test_places_that_32_bits_do_not_tell_apart_are_refused(far_m):
    T = np.eye(4)
    T[0, 3] = far_m
    with pytest.raises(MapError, match=r"Frame 1 lets the map reach .* m from the origin.*up to 1\.049e\+05 m"):
        DepthOccupancy(OccupancyConfig()).integrate(np.ones((8, 8), np.float32), Intrinsics(8, 8, 4, 4, 4, 4), T)


@pytest.mark.parametrize(("name", "value"), [("corner", [3, 0, 0]), ("num_frames", 2**31 - 1)])
def test_arrays_that_no_grid_has_are_refused(room, name, value):
    view = room.observe(1.5, 1.5, 0.0)
    occupancy = DepthOccupancy(OccupancyConfig())
    occupancy.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
    with pytest.raises(ValueError, match=r"begins at|num_frames"):
        DepthOccupancy(OccupancyConfig()).set_arrays({**occupancy.arrays(), name: np.array(value)})
