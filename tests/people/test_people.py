"""People in a scene: how they walk, how they look to every camera, and what the robot does to them."""

import math

import mujoco
import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.errors import ConfigError, SceneError
from anm_mj.people.crowd import PERIOD_S, Crowd
from anm_mj.people.figures import Figures
from anm_mj.people.people_config import PeopleConfig
from anm_mj.people.walking_floor import BODY
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.moved_rays import MovedRays
from anm_mj.sim.ray_camera import EmbreeCamera, MujocoRayCamera
from anm_mj.sim.render_mesh import visible_geoms
from anm_mj.types import Action
from tests.people.conftest import crowd_in, write_crowd

ROBOT_M = 0.18


@pytest.fixture(scope="module")
def robot(scene):
    """Among one person who stands still."""
    with make_robot(scene, people=PeopleConfig(number=1), image_px=64) as robot:
        crowd_in(robot)._stand_until_s[:] = 1e5
        yield robot


def crowd_of(floor, scene, seed=0, **settings) -> Crowd:
    return Crowd(PeopleConfig(**settings), floor, scene.starts[0].xy_m, ROBOT_M, seed)


def walked(crowd: Crowd, robot_xy_m, duration_s: float) -> np.ndarray:
    """Places of everybody at the end of each period."""
    places = []
    for k in range(round(duration_s / PERIOD_S)):
        crowd.follow((k + 1) * PERIOD_S, robot_xy_m)
        places.append(crowd.xy_m.copy())
    return np.array(places)


def test_who_stood_in_a_doorway_goes_on_from_there(floor, scene):
    crowd = crowd_of(floor, scene, number=1, blocked_s=2.0)
    stood = crowd.xy_m[0].copy()
    places = walked(crowd, scene.starts[0].xy_m, 12.0)[:, 0]
    still = np.linalg.norm(places - stood, axis=1) < 0.01
    assert still[: round(1.9 / PERIOD_S)].all()
    assert np.linalg.norm(places[round(5.0 / PERIOD_S)] - stood) > 0.3


def test_people_walk_on_the_floor_and_touch_nobody(floor, scene):
    robot = scene.starts[0].xy_m
    places = walked(crowd_of(floor, scene, number=3, longest_stand_s=2.0), robot, 60.0)

    step_m = np.linalg.norm(np.diff(places, axis=0), axis=2)
    apart_m = [np.linalg.norm(places[:, i] - places[:, j], axis=1).min() for i, j in ((0, 1), (0, 2), (1, 2))]
    clear_m = min(floor.clearance(x, y)[0] for x, y in places.reshape(-1, 2))
    assert step_m.sum(axis=0).min() > 4.0
    assert step_m.max() <= 1.3 * 1.2 * PERIOD_S + 1e-9
    assert min(apart_m) >= 2 * BODY.radius_m - 1e-9
    assert np.linalg.norm(places - robot, axis=2).min() >= BODY.radius_m + ROBOT_M - 1e-9
    assert clear_m >= BODY.radius_m


@pytest.mark.parametrize("seed", [2, 5])
def test_slow_people_get_through_doors_and_look_where_they_go(floor, scene, seed):
    slow = crowd_of(floor, scene, seed, number=1, slowest_mps=0.1, fastest_mps=0.1, longest_stand_s=0.0)
    places, yaw_rad = [slow.xy_m[0].copy()], []
    for k in range(1500):
        slow.follow((k + 1) * PERIOD_S, scene.starts[0].xy_m)
        places.append(slow.xy_m[0].copy())
        yaw_rad.append(slow.yaw_rad[0])
    steps = np.diff(places, axis=0)
    assert np.linalg.norm(steps, axis=1).sum() > 0.5 * 15.0
    aside_rad = np.angle(np.exp(1j * (np.arctan2(steps[:, 1], steps[:, 0]) - yaw_rad)))
    assert np.median(np.abs(aside_rad)) < 0.1


def test_who_is_pushed_to_and_fro_before_somebody_goes_elsewhere(floor, scene):
    """As a person does for ever that meets a robot where neither can pass the other."""
    crowd = crowd_of(floor, scene, number=1, longest_stand_s=0.0)
    robot = scene.starts[0].xy_m
    walked(crowd, robot, 3.0)
    (x, y), goals = crowd.xy_m[0].tolist(), int(crowd._num_goals[0])
    for k in range(round(6.0 / PERIOD_S)):
        crowd._num_periods += 1
        sign = 1 - 2 * (k % 2)
        crowd._put(0, x + 0.03 * sign, y, 0.6 * sign, 0.0, walks=True)

    crowd.follow(crowd.next_s, robot)

    assert crowd._num_goals[0] == goals + 1


def test_the_seed_decides_where_people_walk(floor, scene):
    robot = scene.starts[0].xy_m
    first, again, other = (walked(crowd_of(floor, scene, seed, number=2), robot, 5.0) for seed in (0, 0, 1))

    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_a_copy_moves_on_by_itself_and_alike(floor, scene):
    crowd = crowd_of(floor, scene, number=2, longest_stand_s=0.0)
    copied, before = crowd.copied(), crowd.xy_m.copy()

    copied.follow(3.0, scene.starts[0].xy_m)

    assert np.array_equal(crowd.xy_m, before)
    crowd.follow(3.0, scene.starts[0].xy_m)
    assert np.array_equal(crowd.xy_m, copied.xy_m)
    assert not np.array_equal(crowd.xy_m, before)


def test_one_search_leads_to_every_place_as_one_for_each_does(floor):
    start, *ends = floor.places_m[:: len(floor.places_m) // 6]
    to = floor.ways(start)

    assert all(np.array_equal(to(end), floor.path(start, end)) for end in ends)
    assert min(len(to(end)) for end in ends) > 5


def test_every_doorway_lies_between_two_rooms_and_nobody_stops_in_one(floor):
    middles = np.array([door.middle_m for door in floor.doorways])
    widths = [math.dist(door.left_m, door.right_m) for door in floor.doorways]

    assert len(middles) == 7
    assert 0.5 < min(widths) < max(widths) < 1.6
    assert np.linalg.norm(floor.places_m[:, None] - middles, axis=2).min() > 0.7


def test_nobody_stands_in_a_doorway_that_the_robot_is_at(floor, scene, monkeypatch):
    first, second = (door.middle_m for door in floor.doorways[:2])
    monkeypatch.setattr(floor, "_doorways_m", np.array([first, second]))
    assert np.array_equal(floor.doorway(first), second)
    monkeypatch.setattr(floor, "_doorways_m", np.array([first]))
    with pytest.raises(SceneError, match=r"All doorways of the floor, 1, lie less than 1 m .* set people.blocked_s=0"):
        floor.doorway(first + 0.3)
    with pytest.raises(SceneError, match=r"start elsewhere"):
        Crowd(PeopleConfig(number=1, blocked_s=2.0), floor, first, ROBOT_M, 0)


def test_a_follower_comes_to_the_robot(floor, scene):
    robot = scene.starts[0].xy_m
    crowd = crowd_of(floor, scene, number=1, followers=1)

    crowd.follow(30.0, robot)

    assert math.dist(crowd.xy_m[0], robot) < 1.5


def test_a_floor_that_is_full_says_how_many_it_holds(floor, scene):
    with pytest.raises(SceneError, match=r"people.number is 100, but the floor has room for \d+ .* give fewer people"):
        crowd_of(floor, scene, number=100)


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("people.number=-1", "people.number is -1; it must be a number at least 0"),
        ("people.slowest_mps=1.5", "people.slowest_mps is 1.5; it must be at most fastest_mps, 1.2"),
        ("people.followers=2", "people.followers is 2, but people.number is 0"),
        ("people.blocked_s=60", "people.blocked_s is 60, but people.number is 0 and people.followers 0, so that"),
    ],
)
def test_impossible_people_end_in_a_sentence(setting, sentence):
    with pytest.raises(ConfigError, match=sentence):
        make_config("default", [setting], scene="home")


def test_who_follows_the_robot_stands_in_no_doorway():
    with pytest.raises(ConfigError, match=r"people.number is 2 and people.followers 2, so that nobody stands"):
        PeopleConfig(number=2, followers=2, blocked_s=60.0)
    PeopleConfig(number=2, followers=1, blocked_s=60.0)


def test_images_begun_ahead_show_people_where_they_will_be(scene):
    images = []
    for ahead in (False, True):
        with make_robot(scene, people=PeopleConfig(number=3), image_px=64, seed=1, anticipates=ahead) as robot:
            seen = []
            for _ in range(6):
                if ahead:
                    robot.anticipate(Action.TURN_LEFT, Action.TURN_LEFT)
                robot.act(Action.TURN_LEFT)
                begun = len(robot._ahead._coming) if robot._ahead else 0
                seen.append(robot.observe())
                # The image was taken, not thrown away.
                assert begun == 0 or len(robot._ahead._coming) in (begun - 1, 0)
            images.append(seen)

    for one, other in zip(*images, strict=True):
        assert np.array_equal(one.rgb, other.rgb)
        assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)


def before_the_robot(robot, distance_m=1.0):
    """Put the first person in front of the robot."""
    pose = robot.pose
    crowd_in(robot).xy_m[0] = pose.xy_m + distance_m * np.array([math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)])
    write_crowd(robot)


def test_every_camera_shows_the_same_people(robot):
    before_the_robot(robot, 1.5)
    seen = robot.observe()
    true = robot.true_view()
    name = robot.model.camera(robot._camera._camera_id).name
    cast = [kind(robot.model, name, 64, 64).render(robot.data) for kind in (EmbreeCamera, MujocoRayCamera)]

    shown = true.people.shown
    assert 0.02 < shown.mean() < 0.5
    assert np.isnan(true.depth_m[shown]).all()
    assert np.isfinite(true.depth_m[~shown]).mean() > 0.95
    for rgb, depth_m in cast:
        same = np.abs(depth_m - seen.depth_m) < 0.03
        assert same[shown].mean() > 0.9
        assert same[~shown].mean() > 0.97
        assert np.abs(rgb[shown & same].astype(int) - seen.rgb[shown & same]).mean() < 5.0


def test_feet_stand_on_the_floor_in_every_phase(robot):
    crowd, model, data = crowd_in(robot), robot.model, robot.data
    feet = [geom for geom in range(model.ngeom) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX]
    feet = [geom for geom in feet if model.body(int(model.geom_bodyid[geom])).name.startswith("person_")]
    lowest = []
    for phase_rad in np.linspace(0.0, math.tau, 16):
        crowd.phase_rad[0], crowd.swing[0] = phase_rad, 1.0
        Figures(model, crowd).write(crowd, data)
        mujoco.mj_kinematics(model, data)
        corner = np.abs(data.geom_xmat[feet].reshape(-1, 3, 3)[:, 2]) * model.geom_size[feet]
        lowest.append((data.geom_xpos[feet, 2] - corner.sum(axis=1)).min())
    crowd.swing[0] = 0.0

    assert len(feet) == 2
    assert np.abs(lowest).max() < 1e-6


@pytest.mark.parametrize("drive", ["kinematic", "physics"])
def test_a_person_stops_the_robot(scene, drive):
    with make_robot(scene, people=PeopleConfig(number=1, longest_stand_s=1e5), image_px=16, drive=drive) as robot:
        crowd_in(robot)._stand_until_s[:] = 1e5
        before_the_robot(robot, ROBOT_M + BODY.radius_m + 0.1)
        results = [robot.act(Action.MOVE_FORWARD) for _ in range(3)]
        apart_m = crowd_in(robot).distance_m(robot.pose.xy_m)

    assert results[-1].collided
    assert results[-1].met_person
    assert apart_m > -0.02


def test_restarted_people_begin_anew(scene):
    with make_robot(scene, people=PeopleConfig(number=2, longest_stand_s=0.0), image_px=16) as robot:
        first = crowd_in(robot).xy_m.copy()
        for _ in range(20):
            robot.act(Action.TURN_LEFT)
        moved = crowd_in(robot).xy_m.copy()
        robot.restart(scene.starts[0])

        assert not np.allclose(moved, first)
        assert np.array_equal(crowd_in(robot).xy_m, first)


def test_rays_tell_people_from_what_stands_before_them(robot):
    before_the_robot(robot, 1.5)
    robot.observe()
    rays = MovedRays(robot.model, visible_geoms(robot.model, moved=True))
    directions = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (64, 64, 3))
    T_world_camera = robot._camera.T_world_camera(robot.data)
    far, near = np.full((64, 64), 9.0, np.float32), np.full((64, 64), 0.5, np.float32)

    assert rays.shown(robot.data, T_world_camera, directions, far).all()
    assert not rays.shown(robot.data, T_world_camera, directions, near).any()
