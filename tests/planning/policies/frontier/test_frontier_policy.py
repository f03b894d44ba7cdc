import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.frames import world_to_cell
from anm_mj.planning.grid_route import GridRoutes
from anm_mj.planning.paths import clearance_at
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.frontier.frontier_policy import Frontier, FrontierConfig, border_hops, frontiers
from anm_mj.planning.scan_grid import LEAST, MOST, RESOLUTION_M
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, Action, Footprint, Observation, Plan, Pose2, StopReason, TopDownMap
from tests.box_room import observe
from tests.planning.worlds import BoxWorld

FOOTPRINT = Footprint(0.18, 0.05, 1.35)


def hall(*, unknown=(), occupied=()) -> TopDownMap:
    """A free hall of 6 x 3 m with a wall around it, 5 cm fine."""
    world = BoxWorld((6.0, 3.0), [(0, 0, 6, 0.1), (0, 2.9, 6, 3), (0, 0, 0.1, 3), (5.9, 0, 6, 3), *occupied], unknown)
    state = world.occupancy.state[0]
    clear = np.where(state == OCCUPIED, 0.0, np.inf)
    boxes = world.boxes
    rows, cols = np.indices(state.shape)
    x, y = (cols + 0.5) * 0.05, (rows + 0.5) * 0.05
    for x0, y0, x1, y1 in boxes:
        clear = np.minimum(
            clear, np.hypot(np.maximum(np.maximum(x0 - x, x - x1), 0), np.maximum(np.maximum(y0 - y, y - y1), 0))
        )
    return TopDownMap(clear.astype(np.float32), state, 0.05, np.zeros(2))


def at_its_end(plan: Plan) -> Pose2:
    x_m, y_m = plan.path_xy_m[-1].tolist()
    return Pose2(x_m, y_m, plan.headings_rad[0])


def look(pose: Pose2) -> Observation:
    return observe(0, pose)


def test_frontiers_come_nearest_first_with_the_cells_they_have():
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9), (0.1, 0.1, 0.5, 1.1)])

    near, far = frontiers(topdown, border_hops(topdown, Pose2(1.5, 1.5, 0.0)))

    assert near.contact_xy_m[0] < 0.5
    assert far.contact_xy_m[0] > 4.5
    assert near.hops < far.hops
    assert far.num_cells == pytest.approx(2.8 / 0.05, abs=1)


def test_a_border_behind_a_wall_is_no_frontier():
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9)], occupied=[(3.0, 0.0, 3.2, 3.0)])

    assert frontiers(topdown, border_hops(topdown, Pose2(1.5, 1.5, 0.0))) == []


def test_routes_keep_their_clearance_around_an_obstacle():
    topdown = hall(occupied=[(2.8, 0.0, 3.2, 2.0)])
    pose = Pose2(1.0, 1.0, 0.0)
    routes = GridRoutes(topdown, pose, 0.22)

    path = routes.path_to(routes.nearest(np.array([5.0, 1.0])))

    assert np.linalg.norm(path[-1] - [5.0, 1.0]) < 0.05
    along = np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in itertools.pairwise(path)])
    assert clearance_at(topdown, along).min() >= 0.22 - 1e-6
    assert len(path) < 12


def test_the_nearest_reachable_place_stays_on_the_robots_side_of_a_wall():
    topdown = hall(occupied=[(3.0, 0.0, 3.2, 3.0)])

    place = GridRoutes(topdown, Pose2(1.0, 1.0, 0.0), 0.22).nearest(np.array([5.0, 1.0]))

    assert 2.5 < place[0] < 3.0


def test_a_choice_is_a_way_over_free_ground_a_look_and_a_limit_of_ten_steps():
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    first = look(Pose2(0.0, 0.0, 0.0))
    policy.observe(first)

    plan = policy.plan(BoxWorld((1.0, 1.0), []), first)

    assert plan.stop is None
    assert plan.valid_steps == 10
    assert plan.topdown is not None
    assert clearance_at(plan.topdown, plan.path_xy_m).min() >= 0.0
    assert math.dist(plan.path_xy_m[-1], plan.candidates[-1].xy_m) < 1e-9
    assert len(plan.headings_rad) == 1


def test_a_frontier_is_kept_when_nearer_than_a_choice_would_allow_and_given_up_once_looked_at(monkeypatch):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9), (0.1, 0.1, 0.5, 1.1)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    world = BoxWorld((1.0, 1.0), [])

    assert policy.plan(world, look(Pose2(2.0, 0.8, 0.0))).path_xy_m[-1][0] < 1.0
    near = policy.plan(world, look(Pose2(1.2, 0.8, 0.0)))
    assert near.reason == "the same frontier as before"
    assert near.path_xy_m[-1][0] < 1.0

    other = policy.plan(world, look(at_its_end(near)))
    assert other.path_xy_m[-1][0] > 4.0


@pytest.mark.parametrize("aside_deg", [-30.0, 30.0])
def test_a_frontier_is_looked_at_by_the_camera_and_not_by_the_base(monkeypatch, aside_deg: float):
    policy, world = Frontier(PolicyContext(FOOTPRINT, FrontierConfig())), BoxWorld((1.0, 1.0), [])
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    ahead = look(Pose2(1.0, 1.5, math.radians(aside_deg)))
    aside = replace(ahead, pose=Pose2(1.0, 1.5, 0.0))
    policy.observe(aside)

    plan = policy.plan(world, aside)
    contact, place = policy._chosen[:2] if policy._chosen else (np.zeros(2), np.zeros(2))
    towards_rad = math.atan2(*(contact - place)[::-1])
    assert math.degrees(plan.headings_rad[0] - towards_rad) == pytest.approx(-aside_deg, abs=0.3)

    # It is not looked at yet where the base alone faces it.
    x_m, y_m = place.tolist()
    facing = policy.plan(world, look(Pose2(x_m, y_m, towards_rad)))
    assert facing.reason == "the same frontier as before"
    assert policy.plan(world, look(at_its_end(facing))).reason != facing.reason


def test_two_places_about_as_near_to_a_frontier_do_not_take_turns(monkeypatch):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    world = BoxWorld((1.0, 1.0), [])
    first = policy.plan(world, look(Pose2(1.0, 1.5, 0.0))).path_xy_m[-1]
    for farther_m, stays in ((0.05, True), (0.5, False)):
        before = first - [farther_m, 0.0]
        assert policy._chosen is not None
        monkeypatch.setattr(policy, "_chosen", policy._chosen._replace(place_xy_m=before))
        kept = policy.plan(world, look(Pose2(1.5, 1.5, 0.0))).path_xy_m[-1]
        np.testing.assert_allclose(kept, before if stays else first, atol=0.03)


def test_a_frontier_that_is_not_looked_at_in_time_is_given_up(monkeypatch):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    topdown = hall(unknown=[(4.5, 0.1, 5.9, 2.9), (0.1, 0.1, 0.5, 1.1)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    world = BoxWorld((1.0, 1.0), [])
    pose = Pose2(2.0, 0.8, 0.0)
    chosen = policy.plan(world, observe(0, pose))
    needed = np.linalg.norm(np.diff(chosen.path_xy_m, axis=0), axis=1).sum() / 0.065 + 36

    assert policy.plan(world, observe(round(1.5 * needed), pose)).reason == "the same frontier as before"
    other = policy.plan(world, observe(round(4.5 * needed), pose))

    assert other.stop is None
    assert other.path_xy_m[-1][0] > 4.0


def test_of_the_only_frontier_no_more_is_given_up_than_was_tried(monkeypatch):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    topdown = hall(unknown=[(0.1, 0.1, 5.9, 0.8), (4.5, 0.1, 5.9, 2.9)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    world = BoxWorld((1.0, 1.0), [])
    near = policy.plan(world, look(Pose2(1.0, 1.8, 0.0)))
    assert policy._chosen is not None
    tried_m = policy._chosen[0]

    again = policy.plan(world, look(at_its_end(near)))

    assert again.stop is None
    assert math.dist(policy._chosen[0], tried_m) >= 0.3


@pytest.mark.parametrize(("came", "stop"), [(True, None), (False, StopReason.COMPLETE)])
def test_it_goes_back_the_way_it_came_although_something_was_marked_beside_it(monkeypatch, came, stop):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    # A gap of 30 cm, as a collision leaves it of a door.
    wall = [(3.0, 0.0, 3.2, 1.3), (3.0, 1.6, 3.2, 3.0)]
    topdown = hall(unknown=[(0.1, 0.1, 0.8, 2.9)], occupied=wall)
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    monkeypatch.setattr(policy.grid, "integrate", lambda observation: None)
    for x_m in np.arange(1.5, 4.5, 0.065) if came else [4.5]:
        policy.observe(look(Pose2(float(x_m), 1.45, 0.0)))

    plan = policy.plan(BoxWorld((1.0, 1.0), []), look(Pose2(4.5, 1.45, 0.0)))

    assert plan.stop is stop
    if came:
        assert plan.path_xy_m[-1][0] < 1.5


def test_a_step_back_that_collides_closes_the_way_too(monkeypatch):
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    topdown = hall(unknown=[(0.1, 0.1, 0.8, 2.9)], occupied=[(3.0, 0.0, 3.2, 3.0)])
    monkeypatch.setattr(policy.grid, "topdown", lambda: topdown)
    monkeypatch.setattr(policy.grid, "integrate", lambda observation: None)
    for x_m in np.arange(1.5, 4.5, 0.065):
        policy.observe(look(Pose2(float(x_m), 1.45, 0.0)))

    assert policy.plan(BoxWorld((1.0, 1.0), []), look(Pose2(4.5, 1.45, 0.0))).stop is StopReason.COMPLETE


def test_marks_of_collisions_that_close_the_only_way_shrink_before_it_gives_up():
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    # A corridor of 70 cm, known but for its end.
    policy.grid.integrate(look(Pose2(0.0, 0.0, 0.0)))
    grid = policy.grid.log_odds
    grid[:], policy.grid.surface_m[:] = MOST, np.nan
    row, col = world_to_cell(np.zeros((1, 2)), policy.grid.origin_xy_m, RESOLUTION_M)[0]
    grid[row - 7 : row + 7, col - 20 : col + 20] = LEAST
    grid[row - 7 : row + 7, col + 20 : col + 30] = np.nan
    free = np.count_nonzero(grid < 0)
    seen, world = look(Pose2(-0.3, 0.0, 0.0)), BoxWorld((1.0, 1.0), [])
    assert policy.plan(world, seen).stop is None

    for side_m in (-0.34, 0.34):
        policy.on_collision(Pose2(0.0, side_m, 0.0), Action.MOVE_FORWARD)
    marked = free - np.count_nonzero(grid < 0)
    plan = policy.plan(world, seen)

    assert marked > 0
    assert plan.stop is None
    assert plan.path_xy_m[-1][0] > 0.4
    assert 0 < free - np.count_nonzero(grid < 0) < marked


def test_a_room_seen_to_the_last_corner_is_complete():
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig(range_m=10.0)))
    for k in range(36):
        policy.observe(look(Pose2(0.0, 0.0, math.radians(10 * k))))

    plan = policy.plan(BoxWorld((1.0, 1.0), []), look(Pose2(0.0, 0.0, 0.0)))

    assert plan.stop is StopReason.COMPLETE
    assert plan.reason == "no frontier is left"


def test_a_refused_step_closes_the_place_it_led_to():
    policy = Frontier(PolicyContext(FOOTPRINT, FrontierConfig()))
    first = look(Pose2(0.0, 0.0, 0.0))
    policy.observe(first)

    policy.on_collision(first.pose, Action.MOVE_FORWARD)
    topdown = policy.plan(BoxWorld((1.0, 1.0), []), first).topdown

    assert topdown is not None
    assert clearance_at(topdown, np.array([[0.245, 0.0]]))[0] < 0
    assert (topdown.state == FREE).any()
    assert (topdown.state == UNKNOWN).any()
