"""What the grid says of pixels that show something new, and what becomes of it: a wall with a thing before it."""

from dataclasses import replace

import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.field_occupancy import FieldOccupancy
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.mapping.moved_pixels import depth_doubt
from anm_mj.mapping.occupancy_kernels import DepthFrame
from anm_mj.sensing.pixel_state import judge_pixels, without_moved
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Intrinsics, Observation, PixelState, Pose2

CAMERA = Intrinsics.from_fov(96, 96, np.pi / 2)
T_WORLD_CAMERA = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
WALL_M, THING_M = 3.02, 1.53
RNG = np.random.default_rng(0)


def view(thing: slice | None = None, noise_m: float = 0.0, deviation_m: float = 0.0) -> Observation:
    """The wall, and the thing before it in some columns of the image; noise grows with the square of the depth."""
    depth_m = np.full((96, 96), WALL_M, np.float32)
    if thing is not None:
        depth_m[30:80, thing] = THING_M
    depth_m += (noise_m * (depth_m / WALL_M) ** 2 * RNG.standard_normal(depth_m.shape)).astype(np.float32)
    rgb = np.zeros((96, 96, 3), np.uint8)
    pose = Pose2(0.0, 0.0, 0.0)
    return Observation(0, 0.0, rgb, depth_m, CAMERA, T_WORLD_CAMERA, pose, position_deviation_m=deviation_m)


def fuse(grid: DepthOccupancy, seen: Observation, times: int = 1) -> Observation:
    for _ in range(times):
        told = judge_pixels(seen)
        moved = grid.find_moved(told)
        told = told if moved is None else without_moved(told, moved)
        grid.integrate(told.depth_m, told.intrinsics, told.T_world_camera, moved_m=told.moved_m)
    return told  # pyright: ignore[reportPossiblyUnboundVariable]


def new_grid(**settings) -> DepthOccupancy:
    return DepthOccupancy(OccupancyConfig(), MovingConfig(detect=True, **settings))


def thing_states(grid: DepthOccupancy, cols: range) -> np.ndarray:
    """States of the voxels in the thing's front, in the middle of some columns."""
    u = (np.array([cols[len(cols) // 2]]) + 0.5 - CAMERA.cx) / CAMERA.fx
    heights = 1.0 + np.arange(-0.2, 0.3, 0.05)
    return grid.state_at(np.stack([np.full(10, THING_M), np.full(10, -u[0] * THING_M), heights], axis=1))


def thing_column(grid: DepthOccupancy, col: int) -> np.ndarray:
    """States of the voxels in the thing's front in a column of the image, from 0.15 m on."""
    v = np.arange(32, 78) + 0.5
    heights = 1.0 - (v - CAMERA.cy) / CAMERA.fy * THING_M
    y_m = -(col + 0.5 - CAMERA.cx) / CAMERA.fx * THING_M
    points = np.stack([np.full(len(v), THING_M), np.full(len(v), y_m), heights], axis=1)
    return grid.state_at(points[heights > 0.15])


def test_what_comes_into_free_space_has_moved():
    grid = new_grid()
    fuse(grid, view(), 5)

    told = fuse(grid, view(slice(40, 60)))

    shown = np.zeros((96, 96), bool)
    shown[30:80, 40:60] = True
    assert np.array_equal(told.pixel_state == PixelState.MOVED, shown)
    assert np.isnan(told.depth_m[shown]).all()
    assert told.moved_m is not None
    assert (told.moved_m[shown] == np.float32(THING_M)).all()
    assert (thing_states(grid, range(40, 60)) == FREE).all()


def test_too_few_looks_and_the_wall_itself_say_nothing():
    grid = new_grid(free_looks=5)
    assert (fuse(grid, view(), 4).pixel_state == PixelState.MEASURED).all()
    assert (fuse(grid, view(slice(40, 60))).pixel_state == PixelState.MEASURED).all()


@pytest.mark.parametrize(("noise_m", "deviation_m"), [(0.05, 0.0), (0.0, 0.6)])
def test_noise_and_an_unsure_pose_explain_what_is_near_the_wall(noise_m, deviation_m):
    """A pixel may be too near by four standard deviations."""
    grid = new_grid()
    fuse(grid, view(noise_m=noise_m), 12)

    alone = grid.find_moved(judge_pixels(view(noise_m=noise_m, deviation_m=deviation_m)))
    beside = grid.find_moved(judge_pixels(view(slice(40, 60), noise_m, deviation_m)))

    assert alone is None or alone.mean() < 1e-3
    assert (beside is None) == (deviation_m > 0.0)


def test_what_stays_becomes_surface_and_is_freed_when_it_leaves():
    grid = new_grid()
    fuse(grid, view(), 8)
    frames = 0
    while (fuse(grid, view(slice(40, 60))).pixel_state == PixelState.MOVED).any():
        frames += 1
        assert frames < 60
    # From -60, wherever it comes, up to the surely free -8, by one in every frame.
    assert frames == 53
    assert (thing_states(grid, range(40, 60)) == OCCUPIED).all()

    fuse(grid, view(), 4)
    assert (thing_states(grid, range(40, 60)) == FREE).all()


def test_what_was_marked_before_it_moved_is_freed_where_something_moves():
    states = []
    for memory_frames in (60, 0):
        grid = new_grid(memory_frames=memory_frames)
        for start in (20, 20, 20, 28, 36, 44, 52, 60, 68):
            fuse(grid, view(slice(start, start + 16)))
        states.append(thing_states(grid, range(20, 36)))

    assert (states[0] == FREE).all()
    assert (states[1] == OCCUPIED).all()


def test_what_is_held_is_an_obstacle_until_it_is_released_or_looked_through():
    grid = new_grid()
    fuse(grid, view(), 5)
    fuse(grid, view(slice(40, 60)))
    version = grid.voxels.column_version.copy()

    grid.hold_moved(np.zeros((0, 3)))
    assert (thing_states(grid, range(40, 60)) == OCCUPIED).all()
    assert grid.release_moved()
    assert (thing_states(grid, range(40, 60)) == FREE).all()
    assert not grid.release_moved()
    assert (grid.voxels.column_version > version).any() or (version == 6).any()

    grid.hold_moved(np.zeros((0, 3)))
    fuse(grid, view())
    assert (thing_states(grid, range(40, 60)) == FREE).all()
    assert not grid.release_moved()


def test_a_held_disc_is_an_obstacle_where_space_is_known_and_its_place_still_surely_free():
    grid = new_grid()
    fuse(grid, view(), 5)
    inside, beside, unknown = np.array([[1.0, 0.2, 1.0], [1.0, 0.4, 1.0], [-1.0, 0.0, 1.0]])

    grid.hold_moved(np.array([[1.0, 0.0, 0.3], [-1.0, 0.0, 0.3]]))
    assert grid.state_at(np.stack([inside, beside, unknown])).tolist() == [OCCUPIED, FREE, UNKNOWN]

    told = fuse(grid, view(slice(40, 60)))
    assert (told.pixel_state == PixelState.MOVED).sum() == 50 * 20
    assert grid.state_at(inside[None]).tolist() == [FREE]


def test_depth_without_noise_may_be_too_short_by_nothing():
    unsure = replace(view(deviation_m=0.03), heading_deviation_rad=0.01)
    assert depth_doubt(1e-6, view()) == (0.0, 0.0, 0.0)
    assert depth_doubt(np.inf, view()) == (0.0, 0.0, 0.0)
    assert depth_doubt(0.002, unsure) == pytest.approx((0.008, 0.12, 0.04))


@pytest.mark.parametrize(
    ("settings", "detects"),
    [
        ([], False),
        (["people.number=2"], True),
        (["people.number=2", "mapping.moving.detect=false"], False),
        (["mapping.moving.detect=true"], True),
    ],
)
def test_among_people_moved_pixels_are_looked_for(settings, detects):
    assert make_config("default", settings, scene="home").mapping.moving.detect is detects


def test_a_thing_that_is_pushed_leaves_free_space_and_becomes_surface_where_it_stays():
    grid = new_grid()
    fuse(grid, view(slice(20, 36)), 10)
    before, after = range(20, 36), range(52, 68)
    assert (thing_states(grid, before) == OCCUPIED).all()

    pushed = [fuse(grid, view(slice(52, 68))).pixel_state == PixelState.MOVED for _ in range(60)]

    assert pushed[0][30:80, 52:68].all()
    assert not pushed[-1].any()
    assert (thing_states(grid, before) == FREE).all()
    assert (thing_states(grid, after) == OCCUPIED).all()


def test_what_is_held_is_an_obstacle_for_some_frames_and_for_twice_as_many_the_next_time():
    grid = new_grid(held_frames=3)
    fuse(grid, view(), 5)
    away = view()
    away.depth_m[:] = np.nan
    disc, place, held = np.array([[1.0, 0.0, 0.3]]), np.array([[1.0, 0.2, 1.0]]), []
    for _ in range(2):
        grid.hold_moved(disc)
        frames = 0
        while grid.state_at(place) == [OCCUPIED]:
            fuse(grid, away)
            frames += 1
        held.append(frames)

    assert held == [3, 6]
    assert not grid.release_moved() or (grid.state_at(place) == FREE).all()


def test_a_turned_camera_may_explain_a_far_pixel_and_not_a_near_one():
    """Four times 0.1 rad are 0.6 m at the thing, 1.5 m before the wall, and 1 m half a metre before it."""
    grid = new_grid()
    fuse(grid, view(), 12)
    near, far = view(slice(40, 60)), view()
    far.depth_m[30:80, 40:60] = 2.5

    assert grid.find_moved(judge_pixels(replace(near, heading_deviation_rad=0.1))) is not None
    assert grid.find_moved(judge_pixels(replace(far, heading_deviation_rad=0.1))) is None
    assert grid.find_moved(judge_pixels(far)) is not None


def test_what_the_camera_cannot_look_through_of_a_thing_goes_with_the_rest():
    """A thing stands at first and leaves; its lowest part stays hidden behind something near."""
    grid = new_grid()
    fuse(grid, view(slice(20, 36)), 5)
    left = view(slice(52, 68))
    left.depth_m[64:80, 20:36] = 0.6
    for _ in range(8):
        fuse(grid, left)

    states = thing_column(grid, 28)
    assert (states == FREE).mean() > 0.9
    assert not (states == OCCUPIED).any()


@pytest.mark.parametrize(("frames", "state"), [(2, FREE), (3, OCCUPIED)])
def test_a_foot_that_few_frames_took_for_surface_goes_with_the_thing_that_moved_above_it(frames, state):
    """Two frames show the foot alone; then something hides it, and the thing above moves away."""
    grid = new_grid()
    low, high = slice(64, 96), slice(0, 64)
    empty, foot, thing = view(), view(slice(40, 60)), view(slice(40, 60))
    empty.depth_m[low] = thing.depth_m[low] = 0.6
    foot.depth_m[high] = 0.6
    fuse(grid, empty, 5)
    fuse(grid, foot, frames)
    at_foot = np.array([[THING_M, 0.0, height_m] for height_m in (0.05, 0.1, 0.2)])
    assert (grid.state_at(at_foot) == OCCUPIED).all()

    assert (fuse(grid, thing, 2).pixel_state == PixelState.MOVED).any()
    assert (grid.state_at(at_foot) == OCCUPIED).all()
    fuse(grid, empty)
    assert (grid.state_at(at_foot) == state).all()


def behind_curtain(seen: Observation) -> Observation:
    """A view whose columns 38 to 49 end at something near."""
    seen.depth_m[:, 38:50] = 0.6
    return seen


def doubting_grid():
    """A thing was seen once, and another one beside its place, so that it is doubted."""
    grid = new_grid()
    fuse(grid, view(slice(42, 45)))
    fuse(grid, behind_curtain(view()), 6)
    fuse(grid, behind_curtain(view(slice(60, 76))))
    assert grid.doubt_moved()
    return grid


@pytest.mark.parametrize(("after", "state"), [(None, OCCUPIED), (view(), FREE), (view(slice(42, 45)), OCCUPIED)])
def test_what_may_be_left_of_a_thing_is_doubted_once_until_its_place_is_seen(after, state):
    """One frame shows a thing, which nobody looks at again; another one walks beside its place."""
    grid = new_grid()
    fuse(grid, view(slice(42, 45)))
    fuse(grid, behind_curtain(view()), 6)
    assert not grid.doubt_moved()
    fuse(grid, behind_curtain(view(slice(60, 76))))
    assert (thing_states(grid, range(42, 45)) == OCCUPIED).all()

    assert grid.doubt_moved()
    assert (thing_states(grid, range(42, 45)) == FREE).all()
    if after is not None:
        fuse(grid, after)
    assert not grid.doubt_moved()
    grid.settle_moved()
    assert (thing_states(grid, range(42, 45)) == state).all()


def test_what_was_doubted_and_settled_is_seen_like_all_else():
    grid = doubting_grid()
    grid.settle_moved()
    assert (thing_states(grid, range(42, 45)) == OCCUPIED).all()

    # Log-odds of zero by a hit and a look through it are no doubt of before.
    fuse(grid, view())
    assert (thing_states(grid, range(42, 45)) == FREE).all()
    grid.settle_moved()
    assert (thing_states(grid, range(42, 45)) == FREE).all()


def test_a_grid_that_is_built_again_is_carved_up_to_what_moved():
    grid = new_grid()
    fuse(grid, view(), 6)
    told = fuse(grid, view(slice(20, 36)))
    assert told.moved_m is not None
    grid.rebuild([DepthFrame(told.depth_m, CAMERA, T_WORLD_CAMERA, moved_m=told.moved_m)])
    y_m = -(28.5 - CAMERA.cx) / CAMERA.fx
    before, behind = np.array([[1.0, y_m, 1.0]]), np.array([[2.0, 2.0 * y_m, 1.0]])
    assert grid.state_at(before) == FREE
    assert grid.state_at(behind) == UNKNOWN
    assert not (thing_states(grid, range(20, 36)) == OCCUPIED).any()


def test_a_look_through_what_was_hit_since_it_was_doubted_decides():
    """A hit and looks through it add up to log-odds of zero, as doubt leaves them."""
    grid = doubting_grid()

    fuse(grid, view(slice(42, 45)))
    assert (thing_states(grid, range(42, 45)) == OCCUPIED).all()
    fuse(grid, view())
    assert (thing_states(grid, range(42, 45)) == FREE).all()
    assert not grid.doubt_moved()
    grid.settle_moved()
    assert (thing_states(grid, range(42, 45)) == FREE).all()


def test_a_wall_that_many_frames_show_is_not_doubted():
    """It is so near that its pixels leave no voxel out."""
    grid = new_grid()
    wall = replace(view(), depth_m=np.full((96, 96), 2.02, np.float32))
    fuse(grid, wall, 5)
    surface = grid.voxels.state == OCCUPIED
    wall.depth_m[30:80, 40:60] = THING_M
    assert (fuse(grid, wall).pixel_state == PixelState.MOVED).any()

    grid.doubt_moved()
    assert (grid.voxels.state[surface] == OCCUPIED).all()


def test_readers_notice_what_is_held_and_released_where_nobody_looks():
    grid, disc = new_grid(), np.array([[1.0, 0.0, 0.2]])
    reader, inside = FieldOccupancy(grid), np.array([[1.0, 0.0, 1.0]])
    hidden = replace(view(), depth_m=np.full((96, 96), 0.5, np.float32))

    def read() -> int:
        fuse(grid, hidden)
        seen = reader.grid(lambda points_m: np.zeros(len(points_m), np.float32))
        layer, row, col = np.floor((inside - seen.origin_m) / seen.resolution_m).astype(int)[0, ::-1]
        return int(seen.state[layer, row, col])

    fuse(grid, view(), 5)
    assert read() == FREE
    grid.hold_moved(disc)
    assert read() == OCCUPIED
    assert grid.release_moved()
    assert read() == FREE


SENSORS = {
    "exact": (np.array([0.0, 8.0, 8.0]), np.zeros(2)),
    "noise": (np.array([0.08, 8.0, 8.0]), np.zeros(2)),
    "strays": (np.array([0.0, 8.0, 8.0]), np.array([100.0, 50.0])),
}
"""What is known of a sensor: noise, as :class:`NoiseMean` keeps it, and strays, as :class:`Strays` does."""


def hold_beside_surface(grid: DepthOccupancy) -> None:
    fuse(grid, view(slice(20, 36)), 5)
    grid.hold_moved(np.array([[1.0, 0.4, 0.2]]))


def doubt_beside_surface(grid: DepthOccupancy) -> None:
    """Of a thing that many frames show, one frame shows more, and nobody looks there again."""
    fuse(grid, view(slice(20, 45)))
    seen, other = behind_curtain(view(slice(20, 42))), behind_curtain(view(slice(60, 76)))
    seen.depth_m[:, 42:50] = other.depth_m[:, 42:50] = 0.6
    other.depth_m[30:80, 20:42] = THING_M
    seen.depth_m[30:80, 38:42] = other.depth_m[30:80, 38:42] = THING_M
    fuse(grid, seen, 6)
    assert (fuse(grid, other).pixel_state == PixelState.MOVED).any()
    assert grid.doubt_moved()


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize(
    ("pretend", "sdf_m", "state"), [(hold_beside_surface, 0.1, OCCUPIED), (doubt_beside_surface, -0.01, FREE)]
)
def test_the_field_decides_neither_on_what_is_held_nor_on_what_is_doubted(sensor, pretend, sdf_m, state):
    """It says the opposite of both, beside surface, where it is asked."""
    grid = new_grid()
    pretend(grid)
    noise, strays = SENSORS[sensor]
    grid.noise.set_array(noise)
    grid.strays.set_array(strays)
    by_depth = grid.voxels.state.copy()

    read = FieldOccupancy(grid).grid(lambda points_m: np.full(len(points_m), sdf_m, np.float32))
    pretended = np.flatnonzero(grid.is_pretended(np.arange(by_depth.size)))
    assert len(pretended) > 20
    assert (by_depth.reshape(-1)[pretended] == state).all()
    assert (read.state.reshape(-1)[pretended] == state).all()
