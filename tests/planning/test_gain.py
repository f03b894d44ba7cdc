import math

import numpy as np
import pytest

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.gain import MAX_TRIES, GainCaster, best_view
from anm_mj.types import OCCUPIED, Pose2, VoxelGrid
from tests.planning.worlds import RESOLUTION_M, room


@pytest.fixture
def caster():
    return GainCaster(PlanningConfig(), RESOLUTION_M, 1.25)


def with_lid(world, floor_and_ceiling=True):
    """The same world with its floor and ceiling seen."""
    grid = world.occupancy
    if floor_and_ceiling:
        grid.state[0] = grid.state[-1] = OCCUPIED
        grid.seen_range_m[0] = grid.seen_range_m[-1] = 1.0
    return grid


def test_a_room_that_is_known_holds_no_gain(caster):
    grid = with_lid(room(4, 3))
    assert caster.panoramas(grid, np.array([[2.0, 1.5]])).max() == 0.0


def test_gain_lies_where_the_unknown_is(caster):
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    gain, yaw = best_view(caster.panoramas(grid, np.array([[1.0, 1.7]]))[0])
    assert gain > 1.0
    assert abs(math.remainder(yaw, math.tau)) < math.radians(11)


def test_a_wall_hides_the_unknown_behind_it(caster):
    grid = with_lid(room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)], unknown=[(4.3, 0.2, 8.2, 3.2)]))
    assert caster.panoramas(grid, np.array([[2.0, 1.7]])).max() == 0.0


def test_the_unseen_skin_on_a_surface_promises_nothing(caster):
    grid = with_lid(room(4, 3))
    grid.state[:, 4:6, :] = -1  # One cell of the wall at y = 0.2 and one in front of it were never resolved.
    grid.state[:, 4, :] = OCCUPIED
    assert caster.panoramas(grid, np.array([[2.0, 1.5]])).max() == 0.0


def test_nearness_to_the_gain_raises_it_until_it_is_seen_whole(caster):
    grid = with_lid(room(10, 3, unknown=[(8.2, 0.2, 10.2, 3.2)]))
    far, near = (best_view(p)[0] for p in caster.panoramas(grid, np.array([[2.0, 1.7], [5.5, 1.7]])))
    assert far == 0.0
    assert near > 0.5


def test_surface_seen_only_from_afar_counts_again_and_well_seen_surface_does_not(caster):
    world = room(4, 3)
    grid = with_lid(world)
    grid.seen_range_m[grid.state == OCCUPIED] = 9.0
    afar = best_view(caster.panoramas(grid, np.array([[2.0, 1.5]]))[0])[0]
    grid.seen_range_m[grid.state == OCCUPIED] = 2.0
    well = best_view(caster.panoramas(grid, np.array([[2.0, 1.5]]))[0])[0]
    assert afar > 1.0
    assert well == 0.0


def test_unknown_that_views_do_not_resolve_is_given_up(caster):
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    place = np.array([[1.5, 1.7]])
    before = best_view(caster.panoramas(grid, place)[0])[0]
    for _ in range(MAX_TRIES):
        caster.note_view(grid, Pose2(1.5, 1.7, math.pi))
    assert best_view(caster.panoramas(grid, place)[0])[0] == pytest.approx(before)  # It looked the other way.
    for _ in range(MAX_TRIES):
        caster.note_view(grid, Pose2(1.5, 1.7, 0.0))
    assert best_view(caster.panoramas(grid, place)[0])[0] < 0.2 * before


def test_the_gain_of_a_place_does_not_depend_on_the_others_nor_on_the_grid_around_it(caster):
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    place = np.array([[1.01, 1.71]])
    alone = caster.panoramas(grid, place)[0]
    together = caster.panoramas(grid, np.array([[3.0, 0.8], [1.01, 1.71]]))[1]
    pad = ((0, 0), (30, 7), (11, 3))
    larger = VoxelGrid(
        np.pad(grid.state, pad, constant_values=-1),
        np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        grid.origin_m - np.array([11, 30, 0]) * RESOLUTION_M,
        RESOLUTION_M,
    )
    assert np.allclose(alone, together)
    assert np.allclose(alone, caster.panoramas(larger, place)[0])


def test_the_best_view_wraps_around_north():
    panorama = np.zeros(36)
    panorama[[34, 35, 0, 1]] = 1.0
    gain, yaw = best_view(panorama)
    assert gain == pytest.approx(4.0)
    assert abs(math.remainder(yaw, math.tau)) < math.radians(36)
