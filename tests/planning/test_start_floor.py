import numpy as np
import pytest
from scipy import ndimage

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.paths import clearance_at
from anm_mj.planning.start_floor import away_from_hits, has_way_out
from anm_mj.planning.topdown import TopDownMapper
from anm_mj.types import FREE, UNKNOWN, Footprint, Pose2
from tests.planning.test_topdown import state_at
from tests.planning.worlds import room

BODY = Footprint(0.18, 0.05, 1.35)
SAFE_M = BODY.radius_m + PlanningConfig().margin_m
WHOLE = (slice(0, 60), slice(0, 60))


def topdown_from(start, **world):
    world = room(5, 4, **world)
    return TopDownMapper(PlanningConfig(hole_area_m2=0.01), BODY).update(world.occupancy, world.sdf, start)


def test_unseen_floor_beside_an_obstacle_is_not_free_where_there_is_another_way():
    topdown = topdown_from(Pose2(2.5, 2.0, 0.0), boxes=[(1.6, 0.2, 2.0, 4.2)], unknown=[(2.0, 1.4, 3.1, 2.6)])
    assert state_at(topdown, 2.1, 2.4) == UNKNOWN
    assert state_at(topdown, 2.9, 2.0) == FREE
    # A body stands at the start, whatever is beside it.
    assert state_at(topdown, 2.4, 2.0) == FREE


@pytest.mark.parametrize("half_m", [0.25, 0.4, 0.55])
def test_a_robot_between_obstacles_finds_a_way_out_over_unseen_floor_as_far_from_them_as_can_be(half_m):
    walls = [(0.2, 0.2, 2.5 - half_m, 4.2), (2.5 + half_m, 0.2, 5.2, 4.2)]
    topdown = topdown_from(Pose2(2.5, 2.2, 0.0), boxes=walls, unknown=[(2.5 - half_m, 1.5, 2.5 + half_m, 2.9)])
    middle = np.column_stack([np.full(29, 2.5), np.linspace(1.0, 3.4, 29)])
    assert clearance_at(topdown, middle).min() >= min(SAFE_M, half_m - 0.05)
    beside = state_at(topdown, 2.5 - half_m + 0.03, 2.65)
    assert beside == (FREE if half_m == 0.25 else UNKNOWN)


def test_floor_keeps_off_hits_by_the_distance_and_of_nothing_else():
    floor, hit = np.zeros((60, 60), bool), np.zeros((60, 60), bool)
    floor[10:50, 10:50] = True
    hit[30, 5] = True
    row, col = np.mgrid[:60, :60]
    for cells in (0, 1, 7, 20):
        far = np.hypot(row - 30, col - 5) > cells
        assert np.array_equal(away_from_hits(floor, hit, WHOLE, cells), floor & far if cells else floor)
    window = (slice(25, 33), slice(2, 20))
    assert np.array_equal(away_from_hits(floor, hit, window, 12), away_from_hits(floor, hit, WHOLE, 12)[window])


@pytest.mark.parametrize(("gap_m", "out"), [(0.0, False), (0.3, False), (0.6, True)])
def test_a_way_out_is_as_wide_as_the_robot(gap_m, out):
    row, col = np.mgrid[:80, :80]
    off_m = 0.05 * np.hypot(row - 40, col - 40)
    ring = (np.abs(off_m - 0.6) < 0.05) & ~((col > 40) & (0.05 * np.abs(row - 40) < gap_m / 2))
    clearance_m = (0.05 * np.asarray(ndimage.distance_transform_edt(~ring))).astype(np.float32)
    place = np.array([40.5, 40.5])
    assert has_way_out(clearance_m, off_m < 0.9, place, safe_m=SAFE_M, resolution_m=0.05) is out
    # Whoever stands outside is out.
    assert has_way_out(clearance_m, off_m < 0.9, np.array([79.0, 79.0]), safe_m=SAFE_M, resolution_m=0.05)
