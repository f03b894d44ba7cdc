"""Where people walk in the tests."""

import numpy as np
import pytest

from anm_mj.people.crowd import Crowd
from anm_mj.people.walking_floor import WalkingFloor
from anm_mj.scene.folder import load_scene
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import Pose2


@pytest.fixture(scope="module")
def scene():
    return load_scene("home")


@pytest.fixture(scope="module")
def floor(scene):
    return WalkingFloor(scene)


def crowd_in(robot: SimRobot) -> Crowd:
    """Those among whom a robot is."""
    assert robot._crowd is not None
    return robot._crowd


def write_crowd(robot: SimRobot) -> None:
    """Put everybody where the crowd says."""
    assert robot._drive.figures is not None
    robot._drive.figures.write(crowd_in(robot), robot.data)


def pose_at(xy_m: np.ndarray, yaw_rad: float) -> Pose2:
    """A pose at a place [m]."""
    x_m, y_m = xy_m.tolist()
    return Pose2(x_m, y_m, yaw_rad)


def standing_shown(robot: SimRobot) -> np.ndarray:
    """The pixels of the last view that show the chair or a leaf."""
    people = robot.true_view().people
    assert people is not None
    assert people.standing_shown is not None
    return people.standing_shown
