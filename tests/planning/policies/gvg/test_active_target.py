import numpy as np
import pytest

from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import ExpectedView, PromisedRays
from anm_mj.planning.policies.gvg.place_kinds import KINDS
from anm_mj.planning.policies.gvg.views import Viewpoint
from anm_mj.types import Plan, Pose2, TopDownMap

CONFIG = GvgConfig()
MAP = TopDownMap(np.ones((1, 1), np.float32), np.zeros((1, 1), np.int8), 0.05, np.zeros(2))
PATH = np.array([[0.0, 2.0], [1.0, 2.0]])
BEGIN = Pose2(0.0, 2.0, 0.0)


def viewpoint(x, y, heading=0):
    return Viewpoint(np.array([x, y]), heading)


def decided(path=PATH, yaw=0.0, view_gain_m2=8.0):
    """A target at (1, 2) that looks along x, with a plan; 100 m2 were seen by then."""
    view = ExpectedView(np.zeros(0, int), np.zeros(0), view_gain_m2, np.zeros(len(KINDS)))
    given = {"expected_gain_m2": 8.0, "seen_m2": 100.0, "config": CONFIG, "view_side": 4}
    none = PromisedRays(np.zeros(2), np.zeros(0, np.float32))
    target = ActiveTarget(viewpoint(1.0, 2.0), promised=(none, none), view=view, **given)
    target.decide(target.viewpoint, Plan("", path, (yaw,)), view_gain_m2=view_gain_m2, seen_m2=100.0)
    return target


def reuse(target, path=PATH):
    return target.reuse(path, view_gain_m2=6.0, seen_m2=100.5, topdown=MAP, stage_ms={})


@pytest.mark.parametrize(
    ("pose", "reached"),
    [
        (Pose2(1.05, 2.0, 0.05), True),
        (Pose2(1.05, 2.0, 1.0), False),
        (Pose2(1.5, 2.0, 0.0), False),
    ],
)
def test_is_reached_at_its_place_and_heading(pose, reached):
    assert decided().is_reached(pose) == reached


def test_is_near_what_a_vertex_that_moved_stands_for():
    assert decided().is_near(np.array([1.3, 2.0]))
    assert not decided().is_near(np.array([1.7, 2.0]))


def test_follows_its_vertex():
    target = decided()
    target.decide(viewpoint(1.3, 2.0, 9), Plan("", PATH), view_gain_m2=8.0, seen_m2=100.0)
    assert target.is_reached(Pose2(1.3, 2.0, np.deg2rad(90.0)))


def test_does_not_creep_away_from_where_it_was_chosen():
    target = decided()
    assert target.is_same(viewpoint(1.4, 2.0, 35))
    target.decide(viewpoint(1.4, 2.0, 35), Plan("", PATH), view_gain_m2=8.0, seen_m2=100.0)
    assert target.is_same(viewpoint(1.0, 2.0, 4))
    assert not target.is_same(viewpoint(1.8, 2.0, 0))


def test_view_to_the_other_side_is_another_target():
    assert not decided().is_same(viewpoint(1.0, 2.0, 18))


def test_new_surface_asks_for_a_decision():
    assert not decided().needs_decision(BEGIN, 102.3)
    assert decided().needs_decision(BEGIN, 102.5)
    assert decided(view_gain_m2=0.5).needs_decision(BEGIN, 101.1)


def test_reuses_are_limited():
    target = decided()
    for _ in range(CONFIG.max_plan_reuse):
        assert not target.needs_decision(BEGIN, 100.0)
        reuse(target)
    assert target.needs_decision(BEGIN, 100.0)


def test_plan_that_was_followed_asks_for_a_decision_although_the_target_is_elsewhere():
    target = decided(np.array([[0.0, 2.0], [0.7, 2.0]]), yaw=0.5)
    there = Pose2(0.7, 2.0, 0.5)
    assert not target.is_reached(there)
    assert target.needs_decision(there, 100.0)


def test_is_worth_most_of_what_the_view_was_expected_to_show():
    assert decided().is_worth(5.0)
    assert not decided().is_worth(4.0)


def test_reused_plan_leads_along_the_rest_of_the_path():
    target = decided()
    rest = target.remaining_path(Pose2(0.4, 2.0, 0.0))
    plan = reuse(target, rest)
    assert plan.path_xy_m.tolist() == [[0.4, 2.0], [1.0, 2.0]]
    assert plan.headings_rad == (0.0,)
    assert plan.reason == "plan reused: expected gain 6.0 m², 0.5 m² seen since the last full decision"
