"""Things that move among people: vacuum robots, and a chair that is pushed once."""

import math

import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.errors import ConfigError, SceneError
from anm_mj.people.crowd import CHAIR, PERIOD_S, VACUUM, Crowd
from anm_mj.people.figures import CHAIR_NAME
from anm_mj.people.people_config import PeopleConfig
from anm_mj.people.walking_floor import BODY
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Action, Pose2
from tests.people.conftest import crowd_in, write_crowd

ROBOT_M = 0.18


def moved(floor, robot_xy_m, duration_s: float, seed=0, **settings) -> tuple[Crowd, np.ndarray]:
    """A crowd after a time, and places of everybody at the end of each period."""
    crowd, places = Crowd(PeopleConfig(**settings), floor, robot_xy_m, ROBOT_M, seed), []
    for k in range(round(duration_s / PERIOD_S)):
        crowd.follow((k + 1) * PERIOD_S, robot_xy_m)
        places.append(crowd.xy_m.copy())
    return crowd, np.array(places)


def test_vacuum_robots_drive_straight_and_touch_nothing(floor, scene):
    robot = scene.starts[0].xy_m
    crowd, places = moved(floor, robot, 120.0, number=1, vacuums=3, chair_pushed_s=20.0)
    vacuums = places[:, 1:4]

    step_m = np.linalg.norm(np.diff(vacuums, axis=0), axis=2)
    drives = step_m > 0.0
    assert np.allclose(step_m[drives], 0.3 * PERIOD_S)
    assert drives.mean() > 0.5
    # Many steps lead on as the one before did, and every robot turned.
    assert (crowd._num_goals[1:4] > 2).all()
    assert (crowd._num_goals[1:4] < 60).all()
    assert min(floor.clearance(x, y)[0] for x, y in vacuums.reshape(-1, 2)) >= VACUUM.radius_m
    assert np.linalg.norm(vacuums - robot, axis=2).min() >= VACUUM.radius_m + ROBOT_M + 0.1 - 1e-9
    for one in range(5):
        for other in range(one):
            apart_m = np.linalg.norm(places[:, one] - places[:, other], axis=1).min()
            assert apart_m >= crowd.radius_m[one] + crowd.radius_m[other] - 1e-9


def test_the_chair_is_pushed_once_and_stays(floor, scene):
    robot = scene.starts[0].xy_m
    _, places = moved(floor, robot, 20.0, chair_pushed_s=5.0)
    chair = places[:, 0]

    moves = np.flatnonzero(np.linalg.norm(np.diff(chair, axis=0), axis=1))
    assert abs(math.dist(chair[0], chair[-1]) - 0.7) < 0.05
    # Each period begins where the one before ended: the first step is that at 5 s.
    assert moves[0] + 2 == 50
    assert len(moves) == moves[-1] - moves[0] + 1 == 15 - (math.dist(chair[0], chair[-1]) <= 0.7)
    assert all(floor.clearance(*place)[0] >= 0.7 for place in (chair[0], chair[-1]))


def test_the_chair_waits_until_nobody_is_in_its_way(floor, scene):
    crowd, _ = moved(floor, scene.starts[0].xy_m, 0.1, chair_pushed_s=1.0)
    start, end = crowd.xy_m[0].copy(), crowd._path[0][0]
    in_its_way = start + (end - start) / math.dist(start, end) * (CHAIR.radius_m + ROBOT_M)

    crowd.follow(5.0, in_its_way)
    assert np.array_equal(crowd.xy_m[0], start)
    crowd.follow(10.0, scene.starts[0].xy_m)
    assert np.allclose(crowd.xy_m[0], end)


def test_the_seed_decides_and_a_copy_moves_on_alike(floor, scene):
    robot = scene.starts[0].xy_m
    settings = {"vacuums": 2, "chair_pushed_s": 3.0}
    (_, first), (crowd, again), (_, other) = (moved(floor, robot, 6.0, seed, **settings) for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)

    copied, before = crowd.copied(), crowd.xy_m.copy()
    copied.follow(30.0, robot)
    assert np.array_equal(crowd.xy_m, before)
    crowd.follow(30.0, robot)
    assert np.array_equal(crowd.xy_m, copied.xy_m)


def test_truth_leaves_things_out_and_tells_the_chair_from_what_always_moves(scene):
    with make_robot(scene, people=PeopleConfig(vacuums=1, chair_pushed_s=1e5), image_px=64) as robot:
        pose, crowd, seen = Pose2(4.74, 4.6, -math.pi / 2), crowd_in(robot), []
        ahead = np.array([0.0, -1.0])
        robot.place(pose)
        for chair_m in (2.3, 9.0):
            crowd.xy_m[:] = pose.xy_m + np.array([1.8, chair_m])[:, None] * ahead
            write_crowd(robot)
            robot.observe()
            seen.append(robot.true_view())
            assert np.allclose(robot.data.body(CHAIR_NAME).xpos[:2], crowd.xy_m[1])

    with_chair, without = seen
    assert with_chair.people.standing_shown.mean() > 0.004
    assert np.isnan(with_chair.depth_m[with_chair.people.standing_shown]).all()
    assert not (with_chair.people.shown & with_chair.people.standing_shown).any()
    assert with_chair.people.chair[:2] == pytest.approx(pose.xy_m + 2.3 * ahead)
    assert len(with_chair.people.states) == 0
    assert without.people.shown.any()
    assert np.isnan(without.depth_m[without.people.shown]).all()
    assert without.people.nearest_m == pytest.approx(1.8 - ROBOT_M - VACUUM.radius_m)


@pytest.mark.parametrize("drive", ["kinematic", "physics"])
def test_a_chair_stops_the_robot(scene, drive):
    with make_robot(scene, people=PeopleConfig(chair_pushed_s=1e5), image_px=16, drive=drive) as robot:
        pose = robot.pose
        ahead = np.array([math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)])
        crowd_in(robot).xy_m[0] = pose.xy_m + (ROBOT_M + CHAIR.radius_m + 0.1) * ahead
        write_crowd(robot)
        results = [robot.act(Action.MOVE_FORWARD) for _ in range(3)]
        apart_m = crowd_in(robot).distance_m(robot.pose.xy_m)

    assert results[-1].met_person
    assert apart_m > -0.02


def test_a_narrow_floor_has_no_room_for_the_chair(floor, scene, monkeypatch):
    monkeypatch.setattr(floor, "clearance", lambda x, y: (BODY.radius_m, 0.0, 0.0))
    with pytest.raises(SceneError, match=r"no room to push a chair by 0.7 m .* set people.chair_pushed_s=0"):
        moved(floor, scene.starts[0].xy_m, 0.1, chair_pushed_s=5.0)


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("people.vacuums=-1", "people.vacuums is -1; it must be a number at least 0"),
        ("people.chair_pushed_s=-2", "people.chair_pushed_s is -2.0; it must be a number at least 0"),
    ],
)
def test_impossible_things_end_in_a_sentence(setting, sentence):
    with pytest.raises(ConfigError, match=sentence):
        make_config("default", [setting], scene="home")
