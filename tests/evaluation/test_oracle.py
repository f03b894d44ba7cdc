import math
from itertools import pairwise, permutations

import numpy as np
import pytest

from anm_mj.control.follow import Follower
from anm_mj.errors import PlanError
from anm_mj.evaluation.coverage import COVERED_M, Coverage
from anm_mj.evaluation.depth import reduce_depth
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.observable import Floor, observable_samples
from anm_mj.evaluation.oracle import Oracle
from anm_mj.evaluation.oracle_tour import Start, cover, shorten, tour_length
from anm_mj.evaluation.oracle_views import Views
from anm_mj.evaluation.oracle_ways import Ways, spread_places
from anm_mj.evaluation.pixel_rays import PixelRays
from anm_mj.evaluation.raycast import RayCaster
from anm_mj.frames import move_pose, pose_matrix
from anm_mj.types import (
    Action,
    ActionResult,
    MapUpdate,
    Observation,
    Pose2,
    StopReason,
    SurfacePoints,
    VoxelGrid,
    WheelSpeeds,
)
from tests.evaluation.test_observable import CAMERA, MOUNT, T_BASE_CAMERA, box, joined


@pytest.fixture(scope="module")
def rooms():
    """Two rooms with a door between them, the floor of both, and what can be seen there."""
    vertices, faces = joined(
        box((-3.0, -1.5, 0.0), (3.0, 1.5, 2.5)),
        box((-0.05, -1.5, 0.0), (0.05, 0.4, 2.5)),
        box((-2.6, -1.4, 0.0), (-2.0, -0.8, 0.8)),
    )
    reachable = np.zeros((30, 60), bool)
    reachable[3:27, 3:57] = True
    reachable[:22, 27:33] = False
    reachable[:10, 1:13] = False
    floor = Floor(reachable, np.array([-3.0, -1.5]), 0.1)
    truth = GroundTruth.sample(vertices, faces, 3_000)
    observable = observable_samples(truth.samples, RayCaster(vertices, faces), floor, MOUNT)
    return GroundTruth(truth.samples, truth.vertices, truth.faces, observable), floor


class RayRobot:
    """Drives on the floor's cells and sees by ray casting."""

    def __init__(self, truth, floor, pose):
        self._rays = RayCaster(truth.vertices, truth.faces)
        self._floor = floor
        self.pose = pose
        self._step = 0

    def observe(self):
        T_world_camera = pose_matrix(self.pose) @ T_BASE_CAMERA
        u, v = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
        rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
        directions = (rays.reshape(-1, 3) @ T_world_camera[:3, :3].T).astype(np.float32)
        origins = np.tile(T_world_camera[:3, 3].astype(np.float32), (len(directions), 1))
        depth_m = self._rays.lengths(origins, directions).reshape(CAMERA.height, CAMERA.width)
        rgb = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
        return Observation(self._step, 0.1 * self._step, rgb, depth_m, CAMERA, T_world_camera, self.pose)

    def act(self, action):
        self._step += 1
        turn = {Action.TURN_LEFT: 10.0, Action.TURN_RIGHT: -10.0}.get(action, 0.0)
        forward = 0.065 if action is Action.MOVE_FORWARD else 0.0
        pose = move_pose(self.pose, forward, math.radians(turn))
        collided = bool(self._floor.cells(pose.xy_m[None].astype(np.float32))[0] < 0)
        self.pose = self.pose if collided else pose
        return ActionResult(action, collided, WheelSpeeds(0.0, 0.0), 0.0 if collided else forward)


class NoMap:
    """Knows nothing and blocks nothing."""

    occupancy = VoxelGrid(np.zeros((1, 1, 1), np.int8), np.full((1, 1, 1), np.inf, np.float32), np.zeros(3), 10.0)

    def integrate(self, observation):
        return MapUpdate(0.0, 0, 0)

    def sdf(self, points_m):
        return np.ones(len(points_m), np.float32)

    def uncertainty(self, points_m):
        return np.ones(len(points_m), np.float32)

    def surface(self, centre_xy_m, radius_m):
        nothing = np.zeros((0, 3), np.float32)
        return SurfacePoints(nothing, nothing, np.zeros(0, np.float32))


def test_the_oracle_sees_nearly_all_there_is_in_few_steps(rooms):
    truth, floor = rooms
    robot = RayRobot(truth, floor, Pose2(-1.5, 0.0, 0.0))
    oracle, follower = Oracle(truth, floor, MOUNT), Follower()
    coverage = Coverage(truth.samples[truth.observable])
    plan, collisions = None, 0

    for _ in range(700):
        seen = robot.observe()
        oracle.observe(seen)
        coverage.add(reduce_depth(seen.depth_m), seen.intrinsics, seen.T_world_camera)
        action = follower.next_action(seen.pose)
        if action is None:
            plan = oracle.plan(NoMap(), seen)
            if plan.stop is not None:
                break
            follower.start(plan)
            action = follower.next_action(seen.pose)
        collided = robot.act(action).collided
        collisions += collided
        if collided:
            oracle.blocked(seen.pose, action)
            follower.drop()

    assert plan.stop is StopReason.COMPLETE
    assert (coverage.distance_m < COVERED_M).mean() > 0.95
    assert collisions == 0


def test_without_the_observable_surface_there_is_no_oracle(rooms):
    truth, floor = rooms
    with pytest.raises(PlanError, match="embree"):
        Oracle(GroundTruth(truth.samples, truth.vertices, truth.faces), floor, MOUNT)


def test_gains_are_sums_over_what_is_covered(rooms):
    truth, _ = rooms
    places_m = np.array([[-1.5, 0.5], [1.5, 0.0], [0.0, 0.9]])
    samples = truth.samples[truth.observable][:800]
    views = Views(samples, places_m, PixelRays(RayCaster(truth.vertices, truth.faces), MOUNT))
    wanted = np.random.default_rng(0).random(len(samples)) < 0.7
    from_yaw = np.array([3, 20, 35])

    gains = views.arc_gains(views.counts(wanted), from_yaw)

    for place in range(3):
        for yaw in (0, 3, 14, 29):
            assert gains[place, yaw] == wanted[views.covered(place, int(from_yaw[place]), yaw)].sum()
    some = views.covered(1, 20, 22)
    fewer = wanted.copy()
    fewer[some] = False
    assert np.array_equal(views.without(views.counts(wanted), some[wanted[some]]), views.counts(fewer))


def test_a_cover_covers_what_was_asked_for(rooms):
    truth, floor = rooms
    ways = Ways(floor)
    cells = spread_places(floor.reachable, 4, ways.edge_m)
    places_m = ways.xy_m(cells)
    samples = truth.samples[truth.observable][:800]
    views = Views(samples, places_m, PixelRays(RayCaster(truth.vertices, truth.faces), MOUNT))

    def row(cell):
        return ways.distances_m((int(cell[0]), int(cell[1])))[tuple(cells.T)]

    start = Start(places_m[0], 0.0, row(cells[0]))
    half = cover(views, np.ones(800, bool), 400, start, places_m, lambda place: row(cells[place]))
    most = cover(views, np.ones(800, bool), 700, start, places_m, lambda place: row(cells[place]))

    assert 0 < len(half) < len(most)
    assert views.coverable.mean() > 0.9


def test_a_short_order_is_the_shortest_on_small_cases():
    rng = np.random.default_rng(4)
    optimal = 0
    for _ in range(20):
        xy = rng.random((7, 2))
        costs = np.linalg.norm(xy[:, None] - xy[None], axis=2) + 0.05 * rng.random((7, 7))
        order = shorten(costs)
        assert order[0] == 0
        assert sorted(order) == list(range(7))
        best = min(tour_length(costs, [0, *rest]) for rest in permutations(range(1, 7)))
        assert tour_length(costs, order) <= 1.15 * best
        optimal += tour_length(costs, order) <= best + 1e-9
    assert optimal >= 14


def test_tours_of_one_and_two_points_are_left_alone():
    assert shorten(np.zeros((1, 1))) == [0]
    assert shorten(np.array([[0.0, 1.0], [1.0, 0.0]])) == [0, 1]


def test_a_place_that_blocked_is_gone_round(rooms):
    _, floor = rooms
    ways = Ways(floor)
    a, b = ways.cell(np.array([1.0, 0.0])), ways.cell(np.array([2.4, 0.0]))
    obstacle = np.array([1.7, 0.0])

    ways.avoid(obstacle)

    cells = np.array(ways._search(b, True)[0].traceback(a))
    assert np.linalg.norm(ways.xy_m(cells) - obstacle, axis=1).min() > 0.15
    assert ways.distances_m(a)[b] < 2.5


def test_a_way_keeps_to_the_floor_and_goes_through_the_door(rooms):
    _, floor = rooms
    ways = Ways(floor)
    a, b = ways.cell(np.array([-1.0, -1.0])), ways.cell(np.array([1.0, -1.0]))

    path = ways.path_m(a, b)

    assert path[0] == pytest.approx(ways.xy_m(np.array([a]))[0])
    assert path[-1] == pytest.approx(ways.xy_m(np.array([b]))[0])
    assert path[:, 1].max() > 0.6
    dense = np.concatenate([np.linspace(p, q, 60) for p, q in pairwise(path)])
    assert (floor.cells(dense.astype(np.float32)) >= 0).all()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length <= ways.distances_m(a)[b] + 0.2
