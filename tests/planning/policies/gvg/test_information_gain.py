import math

import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg import ray_cache
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain, view_gains
from anm_mj.planning.policies.gvg.views import Viewpoint
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Pose2
from tests.planning.worlds import RESOLUTION_M, room


def everywhere(grid):
    return slice(0, grid.state.shape[1]), slice(0, grid.state.shape[2])


def gain_in(grid, aside_deg=0.0):
    """Gains of a camera of 90 degrees that looks aside to the left."""
    camera = FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25, azimuth_rad=math.radians(aside_deg))
    gain = InformationGain(GvgConfig(), camera)
    gain.update(grid, everywhere(grid))
    return gain


def with_lid(world):
    """The same world with its floor and ceiling seen."""
    grid = world.occupancy
    grid.state[:2] = grid.state[-2:] = OCCUPIED
    grid.seen_range_m[:2] = grid.seen_range_m[-2:] = 1.0
    return grid


def best_view(sector_gain):
    """Gain of the best view of 90 degrees, and the yaw of its middle [rad]."""
    sums = view_gains(sector_gain[None], 9)[0]
    start = int(np.argmax(sums))
    return sums[start], (start + 4) * math.tau / 36


def gain_at(grid, x, y):
    return best_view(gain_in(grid).sector_gains(np.array([[x, y]]))[0])


def test_known_room_has_no_gain():
    assert gain_at(with_lid(room(4, 3)), 2.0, 1.5)[0] == 0.0


def test_rays_longer_than_a_byte_counts_are_refused_in_a_sentence():
    gain = InformationGain(GvgConfig(gain_range_m=30.0), FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25))
    grid = with_lid(room(4, 3))
    gain.update(grid, everywhere(grid))
    with pytest.raises(PlanError, match=r"A ray of 30 m through cells of 0\.\d m has \d+ samples.*lower policy\."):
        gain.sector_gains(np.array([[2.0, 1.5]]))


def test_gain_lies_where_the_unknown_is():
    best_m2, yaw = gain_at(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)])), 1.0, 1.7)
    assert best_m2 > 1.0
    assert abs(math.remainder(yaw, math.tau)) < math.radians(11)


def test_wall_hides_the_unknown_behind_it():
    grid = with_lid(room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)], unknown=[(4.3, 0.2, 8.2, 3.2)]))
    assert gain_at(grid, 2.0, 1.7)[0] == 0.0


def test_unresolved_skin_on_a_surface_has_no_gain():
    grid = with_lid(room(4, 3))
    grid.state[:, 4, :] = UNKNOWN  # One voxel in front of the wall at y = 0.2 was never resolved.
    assert gain_at(grid, 2.0, 1.5)[0] == 0.0


def test_gain_is_limited_in_range():
    grid = with_lid(room(10, 3, unknown=[(8.2, 0.2, 10.2, 3.2)]))
    assert gain_at(grid, 2.0, 1.7)[0] == 0.0
    assert gain_at(grid, 5.5, 1.7)[0] > 0.5


def test_what_a_view_left_unknown_has_gain_from_nearer_only():
    gain = gain_in(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)])))
    place = np.array([[1.5, 1.7]])
    before = best_view(gain.sector_gains(place)[0])[0]
    gain.suppress_view(Pose2(1.5, 1.7, math.pi))
    assert best_view(gain.sector_gains(place)[0])[0] == pytest.approx(before)  # It looked the other way.
    gain.suppress_view(Pose2(1.5, 1.7, 0.0))
    assert best_view(gain.sector_gains(place)[0])[0] < 0.2 * before
    assert best_view(gain.sector_gains(np.array([[2.6, 1.7]]))[0])[0] > 0.5


def test_what_views_left_unknown_is_handed_on():
    world = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    gain, place = gain_in(world), np.array([[1.5, 1.7]])
    before = gain.sector_gains(place)
    gain.suppress_view(Pose2(1.5, 1.7, 0.0))
    next_ = gain_in(world)
    # What lies outside of the map is left out.
    next_.take_tried(np.concatenate((gain.tried, [[1e6, 0.0, 0.0, 1.0]])))
    np.testing.assert_array_equal(next_.sector_gains(place), gain.sector_gains(place))
    assert (next_.sector_gains(place) < before).any()


def test_sky_has_no_gain():
    grid = room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]).occupancy
    grid.state[:2], grid.seen_range_m[:2] = OCCUPIED, 1.0
    low = gain_at(grid, 2.0, 1.7)[0]
    # The same room with walls up to 1.3 m only: what lies above them is known to be free wherever it is known.
    grid.state[26:][grid.state[26:] == OCCUPIED] = FREE
    assert 0.0 < gain_at(grid, 2.0, 1.7)[0] < 0.8 * low


def test_end_of_the_floor_has_no_gain():
    grid = with_lid(room(6, 3, unknown=[(4.2, 0.2, 6.2, 3.2)]))
    depth = np.full((4, *grid.state.shape[1:]), OCCUPIED, np.int8)
    cliff = OccupancyGrid(
        np.concatenate([depth, grid.state]),
        np.concatenate([np.ones(depth.shape, np.float32), grid.seen_range_m]),
        grid.origin_m - np.array([0.0, 0.0, 4 * RESOLUTION_M]),
        RESOLUTION_M,
    )
    before = gain_at(cliff, 2.0, 1.7)[0]
    cliff.state[:6, :, 70:84] = FREE  # From x = 3.5 on one sees below the floor.
    assert before > 1.0
    assert gain_at(cliff, 2.0, 1.7)[0] == 0.0


def padded(grid, rows, cols):
    """The same map in a larger box of the unknown: cells added before and after."""
    pad = ((0, 0), rows, cols)
    return OccupancyGrid(
        np.pad(grid.state, pad, constant_values=UNKNOWN),
        np.pad(grid.seen_range_m, pad, constant_values=np.inf),
        grid.origin_m - np.array([cols[0], rows[0], 0]) * RESOLUTION_M,
        RESOLUTION_M,
    )


def test_gain_depends_on_the_place_alone():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    place = np.array([[1.01, 1.71]])
    alone = gain_in(grid).sector_gains(place)[0]
    together = gain_in(grid).sector_gains(np.array([[3.0, 0.8], [1.01, 1.71]]))[1]
    larger = padded(grid, (30, 8), (12, 2))
    assert np.allclose(alone, together)
    assert np.allclose(alone, gain_in(larger).sector_gains(place)[0])


def test_gain_follows_a_map_that_changes_and_grows():
    grid = with_lid(room(6, 3, unknown=[(3.2, 0.2, 6.2, 3.2)]))
    gain = gain_in(grid)
    places = np.array([[1.02, 1.72], [2.63, 1.04]])
    gain.sector_gains(places)
    grid.state[2:-2, 6:-6, 60:80] = FREE
    larger = padded(grid, (16, 48), (32, 0))
    for now in (grid, larger):
        gain.update(now, everywhere(now))
        assert np.allclose(gain.sector_gains(places), gain_in(now).sector_gains(places))


def test_full_cache_is_cleared(monkeypatch):
    grid = with_lid(room(6, 3, unknown=[(3.2, 0.2, 6.2, 3.2)]))
    places = np.random.default_rng(0).uniform(0.5, 3.0, (40, 2))
    at_once = gain_in(grid).sector_gains(places, fresh=True)
    monkeypatch.setattr(ray_cache, "MAX_ROWS", 10)
    gain = gain_in(grid)
    for _ in range(2):
        few = np.concatenate([gain.sector_gains(some, fresh=True) for some in np.split(places, 5)])
        assert np.array_equal(few, at_once)


def test_more_places_than_the_cache_holds_are_cast_together(monkeypatch):
    grid = with_lid(room(6, 3, unknown=[(3.2, 0.2, 6.2, 3.2)]))
    places = np.random.default_rng(0).uniform(0.5, 3.0, (40, 2))
    at_once = gain_in(grid).sector_gains(places, fresh=True)
    monkeypatch.setattr(ray_cache, "MAX_ROWS", 10)
    assert np.array_equal(gain_in(grid).sector_gains(places, fresh=True), at_once)


def test_best_view_wraps_around():
    sector_gain = np.zeros(36)
    sector_gain[[34, 35, 0, 1]] = 1.0
    best_m2, yaw = best_view(sector_gain)
    assert best_m2 == pytest.approx(4.0)
    assert abs(math.remainder(yaw, math.tau)) < math.radians(36)


def test_pooling_parts_is_pooling_everything():
    grid = with_lid(room(6, 4, boxes=[(3.0, 1.0, 3.4, 3.0)], unknown=[(3.4, 1.0, 3.5, 3.0), (2.9, 1.0, 3.0, 3.0)]))
    parts = gain_in(grid)
    rng = np.random.default_rng(0)
    for _ in range(20):
        row, col = rng.integers(4, 80), rng.integers(4, 120)
        grid.state[20:24, row, col] = rng.integers(-1, 2)
        parts.update(grid, (slice(row - 3, row + 2), slice(col, col + 1)))
    whole = gain_in(grid)
    assert np.array_equal(whole.occupancy.state, parts.occupancy.state)
    assert np.array_equal(whole.occupancy.layer_share, parts.occupancy.layer_share)
    assert whole.seen_m2 == pytest.approx(parts.seen_m2)


def test_memory_order_of_the_voxels_changes_nothing():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    turned = OccupancyGrid(np.asfortranarray(grid.state), grid.seen_range_m, grid.origin_m, grid.resolution_m)
    assert not turned.state.flags.c_contiguous
    assert np.array_equal(gain_in(turned).occupancy.state, gain_in(grid).occupancy.state)


def test_update_says_where_the_occupancy_changed():
    grid = with_lid(room(4, 3))
    gain = gain_in(grid)
    assert gain.occupancy.update(grid, everywhere(grid)) is None
    grid.state[20, 30, 40] = OCCUPIED
    changed = gain.occupancy.update(grid, everywhere(grid))
    assert changed is not None
    assert (changed[0] <= [2.0, 1.5]).all()
    assert (changed[1] >= [2.05, 1.55]).all()
    assert (changed[1] - changed[0] < 0.6).all()


def test_view_of_a_known_room_expects_nothing_of_any_kind():
    view = gain_in(with_lid(room(4, 3))).expected_view(Viewpoint(np.array([2.0, 1.5]), 0))
    assert view.gain_m2 == 0.0
    assert not view.of_kind_m2.any()


def test_promise_is_done_where_it_was_seen_or_looked_at():
    unknown = [(3.2, 0.2, 4.2, 3.2)]
    world = with_lid(room(4, 3, unknown=unknown))
    gain, place = gain_in(world), np.array([1.5, 1.7])
    sectors = np.zeros(36, bool)
    sectors[[35, 0, 1, 18]] = True
    promised = gain.promise(place, sectors)
    total_m2 = gain.sector_gains(place[None])[0]
    assert promised.gain_m2.sum() == pytest.approx(total_m2[sectors].sum(), rel=1e-5)
    assert gain.done_m2(promised) == 0.0
    # Looked along from there, whether or not anything was seen.
    ahead = np.arange(36) == 0
    assert gain.done_m2(promised, ahead) == pytest.approx(total_m2[0], rel=1e-5)
    # Seen from elsewhere.
    seen = with_lid(room(4, 3))
    gain.update(seen, everywhere(seen))
    assert gain.done_m2(promised) == pytest.approx(promised.gain_m2.sum(), rel=1e-5)


def test_what_has_turned_up_on_the_way_to_the_unknown_counts_as_seen():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    gain, place = gain_in(grid), np.array([1.5, 1.7])
    promised, ray_gains = gain.promise(place, np.arange(36) == 0), gain.ray_gains(place[None])[1]
    grid.state[:, :, 48:52] = OCCUPIED
    gain.update(grid, everywhere(grid))
    assert gain.done_m2(promised) == pytest.approx(promised.gain_m2.sum(), rel=1e-5)
    # What the policy remembers of its rays is as before, so that its decisions are.
    assert (gain.ray_gains(place[None])[1] == ray_gains).all()


def test_what_a_view_left_unknown_is_done():
    gain, place = gain_in(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))), np.array([1.5, 1.7])
    promised = gain.promise(place, np.ones(36, bool))
    gain.suppress_view(Pose2(1.5, 1.7, 0.0))
    assert gain.done_m2(promised) > 0.8 * promised.gain_m2.sum() > 1.0


def test_sectors_of_a_camera_that_looks_aside_are_headings():
    grid = with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)]))
    place = np.array([[1.5, 1.7]])
    ahead, aside = gain_in(grid), gain_in(grid, 30.0)
    np.testing.assert_allclose(aside.sector_gains(place), np.roll(ahead.sector_gains(place), -3, axis=1), rtol=0.02)
    np.testing.assert_allclose(aside.best_view_gains(place), ahead.best_view_gains(place), rtol=0.02)
    # The base has to stand 30 degrees to the right for the same view.
    for heading in (0, 5, 20):
        same = ahead.expected_view(Viewpoint(place[0], heading))
        view = aside.expected_view(Viewpoint(place[0], (heading - 3) % 36))
        assert view.gain_m2 == pytest.approx(same.gain_m2, rel=0.02)


@pytest.mark.parametrize("aside_deg", [-30.0, 0.0, 30.0])
def test_what_a_view_aside_left_unknown_lies_where_it_looked(aside_deg: float):
    gain = gain_in(with_lid(room(4, 3, unknown=[(3.2, 0.2, 4.2, 3.2)])), aside_deg)
    # The unknown lies 41 degrees to either side.
    for looks_deg, (low_deg, high_deg) in ((70.0, (25.0, 41.0)), (0.0, (-41.0, 41.0))):
        gain.suppress_view(Pose2(1.5, 1.7, math.radians(looks_deg - aside_deg)))
        away = gain.tried[:, :2] - [1.5, 1.7]
        bearings = np.degrees(np.arctan2(away[:, 1], away[:, 0]))
        assert (bearings.min(), bearings.max()) == pytest.approx((low_deg, high_deg), abs=6.0)
