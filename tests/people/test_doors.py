"""Doors: shut until a person passes, walls until then, and open ways afterwards."""

import math

import numpy as np
import pytest

from anm_mj.config import make_config
from anm_mj.errors import ConfigError, SceneError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.people.crowd import PERIOD_S, Crowd
from anm_mj.people.door_leaves import LEAF
from anm_mj.people.people_config import PeopleConfig
from anm_mj.people.walking_floor import BODY
from anm_mj.sensing.pixel_state import judge_pixels, without_moved
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import OCCUPIED, Action, Twist
from tests.people.conftest import crowd_in, pose_at, standing_shown
from tests.people.pictures import map_slice, save_picture

ROBOT_M = 0.18
HANDLE_M = 1.0
BEFORE, AFTER = 20, 100
"""Frames; a turn lasts 0.34 s."""


def gap_m(doors, xy_m, radius_m):
    """Between a body at a place and the nearest leaf [m]."""
    return min(float(doors._gaps_m(one, np.array([[*xy_m, radius_m]]))[0]) for one in range(len(doors)))


@pytest.fixture(scope="module")
def door(floor, scene):
    """Middle of the first door, and the unit vector through it to the side where somebody stands at first."""
    (x, y, yaw, length), *_ = Crowd(
        PeopleConfig(number=1, doors=1), floor, scene.starts[0].xy_m, ROBOT_M, 0
    ).doors.states
    return np.array([x, y]) + length / 2 * np.array([math.cos(yaw), math.sin(yaw)]), np.array(
        [-math.sin(yaw), math.cos(yaw)]
    )


def send_through(crowd: Crowd, door, start_s: float = 0.0) -> None:
    """Let the first person stand before the door, and walk through it from a time on."""
    middle, aside = door
    crowd.xy_m[0] = middle + 1.0 * aside
    crowd._path[0] = middle + np.linspace(1.0, -1.0, 21)[:, None] * aside
    crowd._stand_until_s[0] = start_s


def test_a_door_is_shut_until_somebody_passes_and_open_from_then_on(floor, scene, door):
    middle, aside = door
    crowd = Crowd(PeopleConfig(number=1, doors=1), floor, scene.starts[0].xy_m, ROBOT_M, 0)
    send_through(crowd, door, 2.0)
    far, shut_rad, sides, turned = scene.starts[0].xy_m, float(crowd.doors.yaw_rad[0]), [], []
    for k in range(60):
        crowd.follow((k + 1) * PERIOD_S, far)
        sides.append(float((crowd.xy_m[0] - middle) @ aside))
        turned.append(abs(float(crowd.doors.yaw_rad[0]) - shut_rad))
        assert gap_m(crowd.doors, crowd.xy_m[0], BODY.radius_m) > -1e-9

    assert max(turned[:19]) == 0.0
    assert turned[-1] == pytest.approx(math.pi / 2)
    assert np.diff(turned).min() >= 0.0
    assert sides[0] > 0.9
    assert min(sides) < -0.6


@pytest.mark.parametrize("aside_m", [-0.15, 0.0, 0.15])
def test_a_door_in_which_the_robot_begins_is_open(floor, scene, door, aside_m):
    middle, aside = door
    begins_m = middle + aside_m * aside
    crowd = Crowd(PeopleConfig(number=1, doors=1), floor, begins_m, ROBOT_M, 0)
    assert gap_m(crowd.doors, begins_m, ROBOT_M) > 0.0
    crowd.restart(scene.starts[0].xy_m)
    assert gap_m(crowd.doors, middle, ROBOT_M) < 0.0
    crowd.restart(begins_m)
    assert gap_m(crowd.doors, begins_m, ROBOT_M) > 0.0


def test_a_robot_of_torque_and_contact_stays_in_the_doorway_where_it_begins(scene, door):
    begin = pose_at(door[0], 0.0)
    with make_robot(scene, start=begin, image_px=16, drive="physics", people=PeopleConfig(number=1, doors=1)) as robot:
        result = robot.act(Action.TURN_LEFT)
        assert not result.collided
        assert result.moved_m < 0.01


def test_a_door_turns_into_nobody(floor, scene, door):
    middle, aside = door
    crowd = Crowd(PeopleConfig(number=1, doors=1), floor, scene.starts[0].xy_m, ROBOT_M, 0)
    send_through(crowd, door)
    behind = middle - 0.45 * aside

    crowd.follow(5.0, behind)
    assert gap_m(crowd.doors, behind, ROBOT_M) >= 0.0
    crowd.follow(12.0, scene.starts[0].xy_m)
    assert gap_m(crowd.doors, middle, 0.3) > 0.0


def test_a_follower_opens_the_door_at_once_on_its_way_to_the_robot(floor, scene, door):
    middle, aside = door
    people = PeopleConfig(number=1, followers=1, doors=1, longest_stand_s=1e4)
    crowd = Crowd(people, floor, scene.starts[0].xy_m, ROBOT_M, 0)
    crowd.xy_m[0] = middle + 1.0 * aside

    crowd.follow(8.0, middle - 1.8 * aside)
    assert float((crowd.xy_m[0] - middle) @ aside) < 0.0


@pytest.mark.parametrize("drive", ["kinematic", "physics"])
def test_a_shut_door_stops_the_robot_and_every_camera_sees_it(scene, door, drive):
    middle, aside = door
    yaw_rad = math.atan2(-aside[1], -aside[0])
    with make_robot(scene, people=PeopleConfig(number=1, doors=1), image_px=64, drive=drive) as robot:
        crowd_in(robot)._stand_until_s[:] = 1e5
        robot.place(pose_at(middle + 1.0 * aside, yaw_rad))
        seen, true, shown = robot.observe(), robot.true_view(), standing_shown(robot)
        results = [robot.act(Action.MOVE_FORWARD) for _ in range(16)]
        apart_m = gap_m(crowd_in(robot).doors, robot.pose.xy_m, ROBOT_M)

    assert shown.mean() > 0.2
    assert np.isnan(true.depth_m[shown]).all()
    assert seen.depth_m[32, 32] < 1.1
    assert results[-1].collided
    assert not results[-1].met_person
    assert -0.02 < apart_m < 0.1


def test_one_long_drive_does_not_lead_through_a_shut_door(scene, door):
    middle, aside = door
    with make_robot(scene, people=PeopleConfig(number=1, doors=1), image_px=64) as robot:
        crowd_in(robot)._stand_until_s[:] = 1e5
        robot.place(before := pose_at(middle + 0.7 * aside, math.atan2(-aside[1], -aside[0])))
        assert robot.drive(Twist(0.7, 0.0), 2.0).collided
        assert robot.pose == before
        crowd_in(robot).doors._turned_rad[:] = math.pi / 2
        crowd_in(robot).doors._side[:] = crowd_in(robot).doors._sides[0][0]
        assert not robot.drive(Twist(0.7, 0.0), 2.0).collided


def test_one_long_drive_around_meets_who_stands_on_its_circle(floor, scene):
    roomy = max(floor.places_m.tolist(), key=lambda place: floor.clearance(*place)[0])
    with make_robot(scene, people=PeopleConfig(number=1), image_px=64) as robot:
        crowd_in(robot)._stand_until_s[:] = 1e5
        robot.place(before := pose_at(np.subtract(roomy, (0.0, 0.4)), 0.0))
        for reach_m, meets in ((0.4, True), (1.0, False)):
            crowd_in(robot).xy_m[0] = np.add(roomy, (0.0, reach_m))
            assert robot.drive(Twist(0.4, 1.0), math.tau).collided is meets
            assert math.dist(robot.pose.xy_m, before.xy_m) < 1e-6


@pytest.mark.slow
def test_the_map_opens_with_the_door(scene, door):
    """Leaves a picture, ``build/people/door.png``: image and map before, while and after somebody opens the door."""
    middle, aside = door
    grid = DepthOccupancy(OccupancyConfig(), MovingConfig(detect=True))
    along = np.array([-aside[1], aside[0]])
    leaf = np.column_stack([middle + np.linspace(-0.25, 0.25, 9)[:, None] * along, np.full(9, HANDLE_M)])
    pictures, shut = [], []
    with make_robot(scene, people=PeopleConfig(number=1, doors=1), image_px=128) as robot:
        crowd = crowd_in(robot)
        send_through(crowd, (middle, -aside), 0.34 * BEFORE)
        robot.place(pose_at(middle + 1.7 * aside, math.atan2(-aside[1], -aside[0])))
        for frame in range(AFTER):
            told = judge_pixels(robot.observe())
            moved = grid.find_moved(told)
            told = told if moved is None else without_moved(told, moved)
            grid.integrate(told.depth_m, told.intrinsics, told.T_world_camera, told.range_m, told.moved_m)
            if frame in (BEFORE - 2, BEFORE + 5, AFTER - 1):
                pictures.append(np.vstack([told.rgb, map_slice(grid, middle, HANDLE_M)]))
                shut.append(np.mean(grid.state_at(leaf) == OCCUPIED))
            robot.act(Action.TURN_LEFT if frame % 2 else Action.TURN_RIGHT)
    save_picture("door", pictures)

    assert shut[0] > 0.9
    assert shut[-1] == 0.0


def test_doors_need_people_and_doorways(floor, scene):
    with pytest.raises(ConfigError, match=r"people.doors is 1, but people.number is 0, so that nobody opens them"):
        make_config("default", ["people.doors=1"], scene="home")
    with pytest.raises(ConfigError, match=r"people.doors is 1 and people.blocked_s is 60: a leaf would hang in the"):
        make_config("default", ["people.number=1", "people.doors=1", "people.blocked_s=60"], scene="home")
    with pytest.raises(SceneError, match=r"people.doors is 50, but \d doorways of the scene have room for a leaf"):
        Crowd(PeopleConfig(number=1, doors=50), floor, scene.starts[0].xy_m, ROBOT_M, 0)


def test_leaves_are_as_high_as_doors_and_hang_apart(floor, scene):
    doors = Crowd(PeopleConfig(number=1, doors=4), floor, scene.starts[0].xy_m, ROBOT_M, 0).doors
    middles = doors.hinge_m + doors.length_m[:, None] / 2 * np.column_stack(
        [np.cos(doors.yaw_rad), np.sin(doors.yaw_rad)]
    )

    assert LEAF.z_max_m > 1.9
    assert ((doors.length_m > 0.5) & (doors.length_m < 1.1)).all()
    assert min(math.dist(a, b) for i, a in enumerate(middles) for b in middles[:i]) > 0.5
