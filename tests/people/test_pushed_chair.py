"""What the map makes of a chair that is pushed: surface where it stays, and free where it was."""

import math

import numpy as np
import pytest

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import MovingConfig, OccupancyConfig
from anm_mj.people.people_config import PeopleConfig
from anm_mj.people.walking_floor import WalkingFloor
from anm_mj.scene.folder import load_scene
from anm_mj.sensing.pixel_state import judge_pixels, without_moved
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import OCCUPIED, Action, PixelState, Pose2
from tests.people.conftest import crowd_in, pose_at, standing_shown
from tests.people.pictures import map_slice, save_picture

SEAT_M = 0.45
BEFORE, AFTER = 40, 120
"""Frames; a turn lasts 0.34 s."""


def view_point(floor: WalkingFloor, chair_m: np.ndarray, pushed_m: np.ndarray) -> Pose2:
    """Where the robot sees a chair pushed sideways."""
    middle = (chair_m + pushed_m) / 2
    for place in floor.places_m:
        along, sideways = middle - place, pushed_m - chair_m
        away_m = math.hypot(*along)
        on_line = [place + share * along for share in np.linspace(0.0, 1.0, 30)]
        is_sideways = abs(along @ sideways) < 0.6 * away_m * math.hypot(*sideways)
        if 1.4 < away_m < 3.0 and is_sideways and min(floor.clearance(*xy)[0] for xy in on_line) > 0.2:
            return pose_at(place, math.atan2(along[1], along[0]))
    raise AssertionError("The chair cannot be watched from anywhere.")


def seat(grid: DepthOccupancy, chair_m: np.ndarray) -> np.ndarray:
    """States of the map about a seat."""
    r, angle = np.meshgrid([0.05, 0.12, 0.18], np.arange(0.0, 6.0, 0.5))
    around = np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])
    return grid.state_at(np.column_stack([chair_m + around, np.full(len(around), SEAT_M)]))


@pytest.mark.slow
def test_the_map_follows_a_pushed_chair():
    """Leaves a picture, ``build/people/chair.png``: image and map before, just after and long after the push."""
    scene = load_scene("home")
    people = PeopleConfig(chair_pushed_s=0.34 * BEFORE)
    grid = DepthOccupancy(OccupancyConfig(), MovingConfig(detect=True))
    pictures, states, moved_shares = [], [], []
    with make_robot(scene, people=people, image_px=128) as robot:
        crowd = crowd_in(robot)
        places = crowd.xy_m[0].copy(), crowd._path[0][0].copy()
        robot.place(view_point(WalkingFloor(scene), *places))
        for frame in range(AFTER):
            told = judge_pixels(robot.observe())
            moved = grid.find_moved(told)
            told = told if moved is None else without_moved(told, moved)
            view = told.intrinsics, told.T_world_camera, told.range_m
            grid.integrate(told.depth_m, *view, moved_m=told.moved_m)
            shown = standing_shown(robot)
            assert told.pixel_state is not None
            moved_shares.append((told.pixel_state[shown] == PixelState.MOVED).mean())
            if frame in (BEFORE - 2, BEFORE + 10, AFTER - 1):
                pictures.append(np.vstack([told.rgb, map_slice(grid, (places[0] + places[1]) / 2, SEAT_M)]))
                states.append([seat(grid, place) for place in places])
            robot.act(Action.TURN_LEFT if frame % 2 else Action.TURN_RIGHT)
    save_picture("chair", pictures)

    before, _, after = states
    assert np.mean(before[0] == OCCUPIED) > 0.5
    assert not (before[1] == OCCUPIED).any()
    assert max(moved_shares[: BEFORE - 1]) < 0.05
    assert max(moved_shares[BEFORE : BEFORE + 15]) > 0.5
    assert not (after[0] == OCCUPIED).any()
    assert np.mean(after[1] == OCCUPIED) > 0.5
