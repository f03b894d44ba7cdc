import math

import numpy as np
import pytest

from anm_mj.planning.policies.gvg import information_gain as gain
from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import GainCaster, view_sums
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Pose2, VoxelGrid
from tests.planning.worlds import RESOLUTION_M, room

ALL = np.array([-50.0, -50.0]), np.array([50.0, 50.0])


def caster_of(grid):
    caster = GainCaster(GvgConfig(), 1.25)
    caster.view.update(grid, *ALL)
    return caster


def with_lid(world):
    """The same world with its floor and ceiling seen."""
    grid = world.occupancy
    grid.state[:2] = grid.state[-2:] = OCCUPIED
    grid.seen_range_m[:2] = grid.seen_range_m[-2:] = 1.0
    return grid


def best_view(panorama):
    """Gain of the best view of 90 degrees, and the yaw of its middle [rad]."""
    sums = view_sums(panorama[None])[0]
    start = int(np.argmax(sums))
    return sums[start], (start + 4) * math.tau / 36


def gain_at(grid, x, y):
    return best_view(caster_of(grid).panoramas(np.array([[x, y]]))[0])


def test_a_room_that_is_known_holds_no_gain():
    assert gain_at(with_lid(room(4, 3)), 2.0, 1.5)[0] == 0.0


def test_gain_lies_where_the_unknown_is():
    gain, yaw = gain_at(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)])), 1.0, 1.7)
    assert gain > 1.0
    assert abs(math.remainder(yaw, math.tau)) < math.radians(11)


def test_a_wall_hides_the_unknown_behind_it():
    grid = with_lid(room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)], unknown=[(4.3, 0.2, 8.2, 3.2)]))
    assert gain_at(grid, 2.0, 1.7)[0] == 0.0


def test_the_unseen_skin_on_a_surface_promises_nothing():
    grid = with_lid(room(4, 3))
    grid.state[:, 4, :] = UNKNOWN  # One voxel in front of the wall at y = 0.2 was never resolved.
    assert gain_at(grid, 2.0, 1.5)[0] == 0.0


def test_nearness_to_the_gain_raises_it_until_it_is_seen_whole():
    grid = with_lid(room(10, 3, unknown=[(8.2, 0.2, 10.2, 3.2)]))
    assert gain_at(grid, 2.0, 1.7)[0] == 0.0
    assert gain_at(grid, 5.5, 1.7)[0] > 0.5


def test_unknown_that_a_view_does_not_resolve_is_expected_from_nearer_only():
    caster = caster_of(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)])))
    place = np.array([[1.5, 1.7]])
    before = best_view(caster.panoramas(place)[0])[0]
    caster.note_view(Pose2(1.5, 1.7, math.pi))
    assert best_view(caster.panoramas(place)[0])[0] == pytest.approx(before)  # It looked the other way.
    caster.note_view(Pose2(1.5, 1.7, 0.0))
    assert best_view(caster.panoramas(place)[0])[0] < 0.2 * before
    assert best_view(caster.panoramas(np.array([[2.6, 1.7]]))[0])[0] > 0.5


def test_above_rooms_without_a_ceiling_nothing_is_expected():
    grid = room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]).occupancy
    grid.state[:2], grid.seen_range_m[:2] = OCCUPIED, 1.0
    low = gain_at(grid, 2.0, 1.7)[0]
    # The same room with walls up to 1.3 m only: what lies above them is known to be free wherever it is known.
    grid.state[26:][grid.state[26:] == OCCUPIED] = FREE
    assert 0.0 < gain_at(grid, 2.0, 1.7)[0] < 0.8 * low


def test_beyond_the_end_of_the_floor_nothing_is_expected():
    grid = with_lid(room(6, 3, unknown=[(4.2, 0.2, 6.2, 3.2)]))
    depth = np.full((4, *grid.state.shape[1:]), OCCUPIED, np.int8)
    cliff = VoxelGrid(
        np.concatenate([depth, grid.state]),
        np.concatenate([np.ones(depth.shape, np.float32), grid.seen_range_m]),
        grid.origin_m - np.array([0.0, 0.0, 4 * RESOLUTION_M]),
        RESOLUTION_M,
    )
    before = gain_at(cliff, 2.0, 1.7)[0]
    cliff.state[:6, :, 70:84] = FREE  # From x = 3.5 on one sees below the floor.
    assert before > 1.0
    assert gain_at(cliff, 2.0, 1.7)[0] == 0.0


def test_the_gain_of_a_place_does_not_depend_on_the_others_nor_on_the_grid_around_it():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    place = np.array([[1.01, 1.71]])
    alone = caster_of(grid).panoramas(place)[0]
    together = caster_of(grid).panoramas(np.array([[3.0, 0.8], [1.01, 1.71]]))[1]
    pad = ((0, 0), (30, 8), (12, 2))
    larger = VoxelGrid(
        np.pad(grid.state, pad, constant_values=UNKNOWN),
        np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        grid.origin_m - np.array([12, 30, 0]) * RESOLUTION_M,
        RESOLUTION_M,
    )
    assert np.allclose(alone, together)
    assert np.allclose(alone, caster_of(larger).panoramas(place)[0])


def test_what_is_remembered_follows_a_map_that_changes_and_grows():
    grid = with_lid(room(6, 3, unknown=[(3.2, 0.2, 6.2, 3.2)]))
    caster = caster_of(grid)
    places = np.array([[1.02, 1.72], [2.63, 1.04]])
    caster.panoramas(places)
    grid.state[2:-2, 6:-6, 60:80] = FREE
    pad = ((0, 0), (16, 48), (32, 0))
    larger = VoxelGrid(
        np.pad(grid.state, pad, constant_values=UNKNOWN),
        np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        grid.origin_m - np.array([32, 16, 0]) * RESOLUTION_M,
        RESOLUTION_M,
    )
    for now in (grid, larger):
        caster.view.update(now, np.array([2.8, 0.0]), np.array([4.4, 3.4]))
        assert np.allclose(caster.panoramas(places), caster_of(now).panoramas(places))


def test_what_is_forgotten_for_want_of_room_is_cast_anew(monkeypatch):
    grid = with_lid(room(6, 3, unknown=[(3.2, 0.2, 6.2, 3.2)]))
    places = np.random.default_rng(0).uniform(0.5, 3.0, (40, 2))
    at_once = caster_of(grid).panoramas(places)
    monkeypatch.setattr(gain, "MAX_ROWS", 10)
    caster = caster_of(grid)
    for _ in range(2):
        few = np.concatenate([caster.panoramas(some) for some in np.split(places, 5)])
        assert np.array_equal(few, at_once)
        assert caster._num_rows <= 10
    # More at once than are remembered are remembered together.
    assert np.array_equal(caster.panoramas(places), at_once)


def test_the_best_view_wraps_around_north():
    panorama = np.zeros(36)
    panorama[[34, 35, 0, 1]] = 1.0
    gain, yaw = best_view(panorama)
    assert gain == pytest.approx(4.0)
    assert abs(math.remainder(yaw, math.tau)) < math.radians(36)


def test_what_is_expected_does_not_depend_on_the_part_that_was_looked_at_last():
    grid = with_lid(room(6, 4, boxes=[(3.0, 1.0, 3.4, 3.0)], unknown=[(3.4, 1.0, 3.5, 3.0), (2.9, 1.0, 3.0, 3.0)]))
    whole, parts = caster_of(grid), caster_of(grid)
    rng = np.random.default_rng(0)
    for _ in range(20):
        low = rng.uniform(0.0, 4.0, 2)
        grid.state[20, 30, 30] = -grid.state[20, 30, 30]  # Something changes in every part.
        parts.view.update(grid, low, low + rng.uniform(0.5, 3.0, 2))
    whole.view.update(grid, *ALL)
    parts.view.update(grid, *ALL)
    assert np.array_equal(whole.view.state, parts.view.state)
    assert np.array_equal(whole.view.layer_share, parts.view.layer_share)
    assert whole.view.seen_m2 == pytest.approx(parts.view.seen_m2)


def test_the_order_of_the_voxels_in_memory_changes_nothing():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    turned = VoxelGrid(np.asfortranarray(grid.state), grid.seen_range_m, grid.origin_m, grid.resolution_m)
    assert not turned.state.flags.c_contiguous
    assert np.array_equal(caster_of(turned).view.state, caster_of(grid).view.state)


def test_an_update_says_where_the_map_has_changed():
    grid = with_lid(room(4, 3))
    caster = caster_of(grid)
    assert caster.view.update(grid, *ALL) is None
    grid.state[20, 30, 40] = OCCUPIED
    changed = caster.view.update(grid, *ALL)
    assert changed is not None
    assert (changed[0] <= [2.0, 1.5]).all()
    assert (changed[1] >= [2.05, 1.55]).all()
    assert (changed[1] - changed[0] < 0.6).all()
