"""The template of a policy: short, on the core alone, and at work in the loop."""

import ast
import runpy

import numpy as np
from scipy.spatial.distance import cdist

from anm_mj.explore import explore
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guarded_policy import plan_fault
from anm_mj.types import UNKNOWN, Pose2, StopReason
from tests.box_room import observe
from tests.docs.pages import ROOT
from tests.fake_robot import FakeRobot, ListRecorder
from tests.planning.worlds import room
from tests.test_import_arrows import _FLOOR, imported_modules

TEMPLATE = ROOT / "docs" / "templates" / "my_policy.py"


def seen(world):
    """A world of which only what lies within 1.5 m of the robot's places is known."""
    state, take_in = world.occupancy.state.copy(), world.integrate
    world.occupancy.state[:] = UNKNOWN

    def integrate(observation):
        rows, cols = np.ogrid[: state.shape[1], : state.shape[2]]
        away = np.hypot((cols + 0.5) * 0.05 - observation.pose.x_m, (rows + 0.5) * 0.05 - observation.pose.y_m)
        world.occupancy.state[:, away < 1.5] = state[:, away < 1.5]
        return take_in(observation)

    world.integrate = integrate
    return world


def test_the_template_has_sixty_lines_on_the_core_alone():
    source = TEMPLATE.read_text()
    assert len(source.splitlines()) <= 60
    names = [name.split(".")[1] for _, name in imported_modules(source) if name.startswith("anm_mj.")]
    assert names
    assert {_FLOOR[name] for name in names} == {"core"}
    assert ast.get_docstring(ast.parse(source))


def template(**settings):
    module = runpy.run_path(str(TEMPLATE))
    return module["MyPolicy"](PolicyContext(FakeRobot.footprint, module["MyConfig"](**settings)))


def test_the_template_explores_a_room_in_the_loop():
    policy = template()
    world = seen(room(6, 4))
    robot, recorder = FakeRobot(world, Pose2(1.0, 1.0, 0.0)), ListRecorder()
    outcome = explore(robot, world, policy, num_steps=600, observers=(recorder,))
    assert outcome.stop_reason is StopReason.COMPLETE
    known = world.occupancy.state != UNKNOWN
    assert known.mean() > 0.9


def test_the_template_goes_somewhere_from_where_it_was_stopped():
    """A place at the border where the robot happens to stand, looking at the border, is no target."""
    world, start = room(6, 4, unknown=[(3.0, 0.2, 6.2, 4.2)]), Pose2(1.0, 1.0, 0.0)
    policy = template()
    policy.plan(world, observe(0, start))
    state = policy.stages.read(world, observe(1, start))
    away_m = cdist(state.graph.vertex_xy_m, state.topdown.frontier_xy_m)
    beside = np.flatnonzero((away_m.min(axis=1) < 1.0) & (state.paths.distance_m > 1.0))
    assert len(beside) > 3
    for vertex in beside[:: len(beside) // 3]:
        x, y = state.topdown.frontier_xy_m[away_m[vertex].argmin()] - state.graph.vertex_xy_m[vertex]
        stopped = Pose2(*state.graph.vertex_xy_m[vertex], float(np.arctan2(y, x)))
        policy.targets = [start.xy_m]
        assert plan_fault(policy.plan(world, observe(2, stopped)), stopped) is None
