"""The template of a mapper: short, on the core alone, and right about a room that a policy explores with it."""

import ast
import runpy
from types import SimpleNamespace

import numpy as np

from anm_mj.explore import explore
from anm_mj.planning.policies.context import make_policy
from anm_mj.protocols import Mapper
from anm_mj.types import FREE, OCCUPIED, Pose2, StopReason
from tests.docs.pages import ROOT
from tests.fake_robot import FakeRobot
from tests.mapping.ray_room import TABLE, Room
from tests.test_import_arrows import _FLOOR, imported_modules

TEMPLATE = ROOT / "docs" / "templates" / "my_mapper.py"
SCREEN = (np.array([1.52, 0.0, 0.0]), np.array([1.73, 1.63, 2.4]))
"""What the robot has to go around."""
OUTSIDE = ((-1, -1, 0, 4), (4, -1, 5, 4), (-1, -1, 5, 0), (-1, 3, 5, 4))


class SeeingRobot(FakeRobot):
    """Drives in a furnished room and sees it."""

    def __init__(self, room):
        furniture = [(*low[:2], *high[:2]) for low, high in room.furniture]
        super().__init__(SimpleNamespace(boxes=np.array([*OUTSIDE, *furniture])), Pose2(0.7, 0.7, 0.0))
        self.room = room

    def observe(self):
        return self.room.observe(self.pose.x_m, self.pose.y_m, self.pose.yaw_rad, size=40, step=self.steps)


def test_the_template_has_sixty_lines_on_the_core_alone():
    source = TEMPLATE.read_text()
    assert len(source.splitlines()) <= 60
    names = [name.split(".")[1] for _, name in imported_modules(source) if name.startswith("anm_mj.")]
    assert {_FLOOR[name] for name in names} == {"core"}
    assert ast.get_docstring(ast.parse(source))


def test_the_map_of_an_explored_room_agrees_with_it():
    room, mapper = Room((SCREEN, TABLE)), runpy.run_path(str(TEMPLATE))["MyMapper"]()
    robot = SeeingRobot(room)
    outcome = explore(robot, mapper, make_policy("gvg", footprint=robot.footprint, goal="coverage"), num_steps=600)
    assert outcome.stop_reason is StopReason.COMPLETE
    assert isinstance(mapper, Mapper)
    grid = mapper.occupancy_grid()
    centres_m = (np.indices(grid.state.shape).reshape(3, -1).T[:, ::-1] + 0.5) * grid.resolution_m + grid.origin_m
    true_m, state = room.sdf(centres_m), grid.state.ravel()
    assert (state[true_m > 0.1] == FREE).mean() > 0.95
    assert np.abs(true_m[state == OCCUPIED]).max() < 0.05
    surface_m = mapper.surface(np.array([2.0, 1.5]), 5.0).xyz_m
    assert np.abs(room.sdf(surface_m)).mean() < 0.005
    near = (np.abs(true_m) > 0.03) & (np.abs(true_m) < 0.1) & (mapper.uncertainty(centres_m) < 0.1)
    assert (np.sign(mapper.sdf(centres_m[near])) == np.sign(true_m[near])).mean() > 0.95
