import math
from itertools import pairwise

import numpy as np
import pytest

from anm_mj.control.follow import Follower
from anm_mj.errors import PlanError
from anm_mj.evaluation.coverage import COVERED_M, Coverage
from anm_mj.evaluation.depth import reduce_depth
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.observable import ReachableArea, observable_samples
from anm_mj.evaluation.oracle.discretize import turned, walk
from anm_mj.evaluation.oracle.policy import Oracle, OracleConfig
from anm_mj.evaluation.oracle.roadmap import Ways, num_places
from anm_mj.evaluation.oracle.segments import NO_YAW, Pieces
from anm_mj.evaluation.oracle.tour import Level, Task, TourSearch, greedy_tour
from anm_mj.evaluation.oracle.visibility import count, frame_bits, pack, unpack
from anm_mj.evaluation.pixel_rays import NUM_YAWS, PixelRays
from anm_mj.evaluation.scene_truth import SceneTruth
from anm_mj.frames import move_pose, pose_matrix
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.types import (
    Action,
    ActionResult,
    Footprint,
    MapUpdate,
    Observation,
    Pose2,
    StopReason,
    SurfacePoints,
    VoxelGrid,
    WheelSpeeds,
)
from anm_mj.utils.raycast import RayCaster
from tests.evaluation.test_observable import CAMERA, CAMERA_ON_BASE, T_BASE_CAMERA, box, joined

ROUNDS = 40
"""Changes tried of a tour."""


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


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
    floor = ReachableArea(reachable, np.array([-3.0, -1.5]), 0.1)
    truth = GroundTruth.sample(vertices, faces, 3_000)
    observable = observable_samples(truth.samples, RayCaster(vertices, faces), floor, CAMERA_ON_BASE)
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


def oracle_for(truth, floor):
    context = PolicyContext(
        Footprint(0.18, 0.05, 1.35), OracleConfig(rounds=ROUNDS), truth=SceneTruth(truth, floor, CAMERA_ON_BASE)
    )
    return Oracle(context)


def test_the_oracle_sees_nearly_all_there_is_in_few_steps(rooms):
    truth, floor = rooms
    robot = RayRobot(truth, floor, Pose2(-1.5, 0.0, 0.0))
    oracle, follower = oracle_for(truth, floor), Follower()
    coverage = Coverage(truth.samples[truth.observable])
    plan, collisions, at_first = None, 0, 0

    for _ in range(1500):
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
        assert action is not None
        collided = robot.act(action).collided
        collisions += collided
        if oracle._tours <= 1:
            at_first = collisions
        if collided:
            oracle.on_collision(seen.pose, action)
            follower.drop()

    assert plan is not None
    assert plan.stop is StopReason.COMPLETE
    assert (coverage.distance_m < COVERED_M).mean() > 0.99
    assert at_first == 0
    assert collisions <= 1  # What is left is looked at from the very edge of the floor, too.


def test_the_oracle_ends_when_all_that_is_left_has_been_given_up(rooms):
    truth, floor = rooms
    oracle = oracle_for(truth, floor)
    here = RayRobot(truth, floor, Pose2(-1.5, 0.0, 0.0)).observe()
    oracle.plan(NoMap(), here)
    oracle._stops = []
    oracle._failures[:] = 2

    assert oracle.plan(NoMap(), here).stop is StopReason.COMPLETE


def first_plan(rooms):
    truth, floor = rooms
    oracle = oracle_for(truth, floor)
    seen = RayRobot(truth, floor, Pose2(-1.5, 0.0, 0.0)).observe()
    oracle.observe(seen)
    return oracle.plan(NoMap(), seen)


def test_a_tour_is_found_once_and_kept(rooms, monkeypatch):
    plan = first_plan(rooms)
    monkeypatch.setattr(TourSearch, "improve", lambda *_: pytest.fail("searched again"))

    assert first_plan(rooms).actions == plan.actions


def test_a_damaged_tour_in_the_cache_is_found_anew(rooms, tmp_path):
    plan = first_plan(rooms)
    (kept,) = (tmp_path / "cache").rglob("*.json")
    kept.write_text("[[1, 2")

    assert first_plan(rooms).actions == plan.actions


def test_a_stop_whose_way_was_blocked_is_gone_to_once_more(rooms):
    truth, floor = rooms
    oracle = oracle_for(truth, floor)
    seen = RayRobot(truth, floor, Pose2(-1.5, 0.0, 0.0)).observe()
    oracle.observe(seen)
    first = oracle.plan(NoMap(), seen)

    oracle.on_collision(seen.pose, Action.MOVE_FORWARD)

    assert oracle.plan(NoMap(), seen).reason == first.reason


def test_without_the_observable_surface_there_is_no_oracle(rooms):
    truth, floor = rooms
    with pytest.raises(PlanError, match="embree"):
        oracle_for(GroundTruth(truth.samples, truth.vertices, truth.faces), floor)


@pytest.fixture(scope="module")
def views(rooms):
    """Ways between places, samples, and what is seen of them."""
    truth, floor = rooms
    ways = Ways(floor, 0.4)
    samples = truth.samples[truth.observable][:640]
    bits = frame_bits(samples, ways.places_m, PixelRays(RayCaster(truth.vertices, truth.faces), CAMERA_ON_BASE))
    return ways, samples, bits


def test_bits_are_flags():
    flags = np.random.default_rng(3).random((5, 128)) < 0.3

    assert all(np.array_equal(unpack(bits), row) for bits, row in zip(pack(flags), flags, strict=True))
    assert np.array_equal(count(pack(flags)), flags.sum(axis=1))


def test_a_place_shows_what_frames_about_it_cover(rooms, views):
    truth, floor = rooms
    ways, samples, bits = views
    place = int(ways.nearest(np.array([[-1.5, 0.2]]))[0])
    coverage = Coverage(samples)
    for aside_m in (-0.05, 0.0, 0.05):
        for k in range(NUM_YAWS):
            x_m, y_m = (ways.places_m[place] + aside_m).tolist()
            pose = Pose2(x_m, y_m, math.radians(10.0 * k))
            seen = RayRobot(truth, floor, pose).observe()
            coverage.add(reduce_depth(seen.depth_m), CAMERA, seen.T_world_camera)

    promised = unpack(np.bitwise_or.reduce(bits[place], axis=0))

    covered = coverage.distance_m < COVERED_M
    assert 0.1 < covered.mean() < 0.9
    assert (promised == covered).mean() > 0.9


def test_the_picture_is_as_wide_as_the_camera_sees(views):
    _, _, bits = views
    yaws = np.stack([count(bits[:, k] & bits[:, (k + 10) % NUM_YAWS]) for k in range(NUM_YAWS)])

    assert count(bits).mean() > 10
    assert yaws.max() == 0


def search_in(views, seed=0):
    ways, samples, bits = views
    levels = (Level(int(0.5 * len(samples)), 1.0), Level(int(0.8 * len(samples)), 0.5))
    pieces = Pieces(bits, ways, 0.0)
    task = Task(int(ways.nearest(np.array([[-1.5, 0.0]]))[0]), 0, np.zeros(bits.shape[2], np.uint64), levels)
    return TourSearch(pieces, ways, task, seed), pieces, task


def test_the_curve_of_a_tour_is_that_of_its_frames_one_by_one(views):
    ways, _, bits = views
    search, _, task = search_in(views)
    stops = [(5, 7, 1), (40, NO_YAW, 1), (40, 30, -1), (12, 3, 1)]

    place, yaw = task.place, task.yaw
    seen, curve = np.zeros(bits.shape[2], np.uint64), [0]
    for to, towards, side in stops:
        if to != place:
            start_m = ways.places_m[place]
            way = walk(start_m, None, ways.corners_m(place, to), ways, 0.0)
            xy_m, yaws = way.frames(start_m, yaw, 0.0)
            for at, k in zip(ways.nearest(xy_m), yaws, strict=True):
                # A turn before a way is made at its beginning, which is the place itself.
                seen |= bits[at, k]
                curve.append(int(count(seen)))
            place, yaw = to, way.yaws[-1]
        for k in turned(yaw, towards, side) if towards != NO_YAW else []:
            seen |= bits[place, k]
            curve.append(int(count(seen)))
            yaw = k

    steps, covered = search.curve(stops)
    assert steps[-1] == len(curve) - 1
    assert [curve[k] for k in steps] == covered.tolist()


def test_a_search_shortens_and_is_the_same_for_the_same_seed(views):
    ways, _, _ = views
    search, pieces, task = search_in(views)
    begin = greedy_tour(pieces, ways, task, 0.0)

    found = search.improve(begin, 300)

    assert search.cost(found) < search.cost(begin)
    assert search_in(views)[0].improve(begin, 300) == found
    assert search_in(views, seed=1)[0].improve(begin, 300) != found


def test_what_is_missing_of_a_level_costs_more_than_a_tour_that_reaches_it(views):
    search, _, _ = search_in(views)
    found = search.improve([], 600)
    _, covered = search.curve(found)

    assert covered[-1] >= 0.8 * 640
    assert search.cost(found) < search.cost([])


def test_a_walk_gets_there_by_few_turns(views):
    ways, _, _ = views
    for target in ([0.9, 0.2], [2.0, 1.0], [1.4, -0.6]):
        goal = np.array(target)
        way = walk(np.array([0.5, 0.0]), 0, goal[None], ways, 0.0)
        assert np.linalg.norm(way.end_m - goal) < 0.13
        assert len(way.yaws) <= 2
        xy_m, yaws = way.frames(np.array([0.5, 0.0]), 0, 0.0)
        assert xy_m[-1] == pytest.approx(way.end_m)
        moved = np.linalg.norm(np.diff(np.concatenate([[[0.5, 0.0]], xy_m]), axis=0), axis=1)
        turned_by = np.abs((np.diff([0, *yaws]) + 18) % 36 - 18)
        assert np.all((moved > 0.06) ^ (turned_by == 1))


def test_a_place_that_blocked_is_gone_round(rooms):
    _, floor = rooms
    ways = Ways(floor, 0.2)
    a, b = (int(k) for k in ways.nearest(np.array([[1.0, 0.0], [2.4, 0.0]])))
    obstacle = np.array([1.7, 0.0])
    before_m = ways.distance_m[a, b]

    ways.avoid(obstacle)

    assert before_m < ways.distance_m[a, b] < 2.5


def test_a_way_keeps_to_the_floor_and_goes_through_the_door(rooms):
    _, floor = rooms
    ways = Ways(floor, 0.2)
    a, b = (int(k) for k in ways.nearest(np.array([[-1.0, -0.4], [1.0, -1.0]])))

    path = np.concatenate([ways.places_m[[a]], ways.corners_m(a, b)])

    assert path[-1] == pytest.approx(ways.places_m[b])
    assert path[:, 1].max() > 0.6
    dense = np.concatenate([np.linspace(p, q, 60) for p, q in pairwise(path)])
    assert (floor.cells(dense.astype(np.float32)) >= 0).all()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length <= ways.distance_m[a, b] + 1e-5
    assert num_places(floor, 0.2) == len(ways.places_m)
