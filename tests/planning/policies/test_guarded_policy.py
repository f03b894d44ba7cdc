"""What a faulty policy does ends the run in a sentence that names it."""

import copy
import math
from unittest.mock import Mock

import numpy as np
import pytest

from anm_mj.checkpoint.known_classes import attributes_of
from anm_mj.errors import MapError, PlanError
from anm_mj.planning.policies.guarded_policy import GuardedPolicy
from anm_mj.protocols import Mapper
from anm_mj.types import Action, Candidate, Plan, Pose2, Region, StopReason, TargetOutcome, TopDownMap, VoronoiGraph
from tests.box_room import observe

HERE = Pose2(0.5, 0.5, 0.0)
NOWHERE = np.zeros((0, 2))
TOPDOWN = TopDownMap(np.ones((2, 2), np.float32), np.zeros((2, 2), np.int8), 0.05, np.zeros(2))
GRAPH = VoronoiGraph(np.zeros((2, 2)), np.ones(2), np.array([[0, 1]]), np.ones(1))
PLACE = Candidate(np.zeros(2), 1.0, 1.0, 3.0)
WALL = Region(np.zeros(3), np.array([1.0, 0.0, 0.0]), 12, 1.0, 0)
CLOSED = TargetOutcome(np.zeros(2), "corner", 1.0, 1.0, 0.5, judged=True)


class Fake:
    def __init__(self, plan=None, raises=None, where="plan"):
        self.answer, self.raises, self.where = plan, raises, where
        self.calls = 0

    def _maybe(self, where):
        self.calls += 1
        if self.raises is not None and self.where == where:
            raise self.raises

    def observe(self, observation):
        self._maybe("observe")

    def plan(self, mapper, observation):
        self._maybe("plan")
        return self.answer

    def on_collision(self, pose, action):
        self._maybe("on_collision")


def replaced(thing, **values):
    """A copy with values that the checks of the tests would not let through."""
    other = copy.copy(thing)
    for name, value in values.items():
        object.__setattr__(other, name, value)
    return other


def wrong(**values):
    """A plan with such values."""
    return replaced(Plan("x", NOWHERE), **values)


def test_what_a_sentence_says_is_in_no_checkpoint():
    """Checkpoints of versions that said something else can be read."""
    assert "_outcome" not in attributes_of(GuardedPolicy(Fake(), "my:Own"))


def decided(policy):
    return GuardedPolicy(policy, "my:Own").plan(Mock(Mapper), observe(3, HERE))


@pytest.mark.parametrize(
    "plan",
    [
        Plan("go", np.array([[0.5, 0.5], [1.5, 0.5]])),
        Plan("look", NOWHERE, headings_rad=(1.0, -2.0)),
        Plan("turn", NOWHERE, actions=(Action.TURN_LEFT,)),
        Plan("done", NOWHERE, stop=StopReason.COMPLETE),
        wrong(headings_rad=[1.0], valid_steps=np.int64(8), regions=[], candidates=[]),
        Plan("seen", headings_rad=(1.0,), topdown=TOPDOWN, graph=GRAPH, candidates=(PLACE,), closed=CLOSED),
        Plan("regions", headings_rad=(1.0,), regions=(WALL, replaced(WALL, score=1e9))),
    ],
)
def test_a_plan_that_can_be_executed_passes(plan):
    assert decided(Fake(plan)) is plan


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (None, "it is nothing, not an anm_mj.types.Plan"),
        ((1.0, 2.0), "of type tuple"),
        (wrong(path_xy_m=np.zeros(2)), r"path_xy_m has shape \(2,\)"),
        (wrong(path_xy_m=np.array([[1.0, 2.0, 3.0]])), r"path_xy_m has shape \(1, 3\)"),
        (wrong(path_xy_m=np.array([["a", "b"]])), "not .* numbers"),
        (wrong(path_xy_m=np.array([[1.0, math.nan]])), "not finite"),
        (wrong(path_xy_m=np.array([[1.0, 1e300]])), "farther than 1e"),
        (wrong(headings_rad=(math.inf,)), "headings_rad is"),
        (wrong(headings_rad=0.5), "headings_rad is 0.5"),
        (wrong(actions=("left",)), "moves and turns"),
        (wrong(actions=(Action.STOP,)), "moves and turns"),
        (wrong(stop="COMPLETE!"), "not a StopReason"),
        (wrong(path_xy_m=np.array([[0.5, 0.51]])), "asks for nothing"),
        (wrong(), "asks for nothing"),
        (wrong(headings_rad=(HERE.yaw_rad, HERE.yaw_rad + 0.05)), "asks for nothing"),
        (wrong(path_xy_m=[[0.0, 0.0], [1.0, 1.0]]), "path_xy_m is of type list, not an array"),
        (wrong(path_xy_m=[[0.0], [1.0, 1.0]]), "path_xy_m is of type list, not an array"),
        (wrong(headings_rad=np.array([0.0, 1.0])), "not a tuple of finite numbers"),
        (wrong(actions=(action for action in [Action.TURN_LEFT])), "they must be moves and turns"),
        (wrong(actions=np.array([1, 1])), "they must be moves and turns"),
        (wrong(path_xy_m=np.array([[1.0, 2.0]]), valid_steps=-1), "valid_steps is -1"),
        (wrong(reason=None, headings_rad=(1.0,)), "reason is None"),
        (wrong(headings_rad=(1.0,), valid_steps=2.5), "valid_steps is 2.5"),
        (wrong(headings_rad=(1.0,), valid_steps="8"), "valid_steps is '8'"),
        (wrong(headings_rad=(1.0,), graph=Mock()), "graph is of type Mock, not an anm_mj.types.VoronoiGraph"),
        (wrong(headings_rad=(1.0,), topdown=np.zeros((3, 3))), "topdown is of type ndarray, not an anm_mj.types"),
        (wrong(headings_rad=(1.0,), graph=replaced(GRAPH, edges=[])), "graph.edges is of type list, not an array"),
        (wrong(headings_rad=(1.0,), topdown=replaced(TOPDOWN, resolution_m="5 cm")), "resolution_m is '5 cm', not a"),
        (wrong(headings_rad=(1.0,), regions=None), "regions is None, not a tuple of anm_mj.types.Region"),
        (wrong(headings_rad=(1.0,), regions=("wall",)), r"regions is \('wall',\), not a tuple of"),
        (wrong(headings_rad=(1.0,), regions=(WALL, replaced(WALL, vertex=None))), "regions holds Region"),
        (wrong(headings_rad=(1.0,), regions=(replaced(WALL, centre_m=np.zeros(2)),)), "regions holds Region"),
        (wrong(headings_rad=(1.0,), regions=(replaced(WALL, score=math.nan),)), "regions holds Region"),
        (wrong(headings_rad=(1.0,), regions=(replaced(WALL, centre_m=np.full(3, 1e300)),)), "regions holds Region"),
        (wrong(headings_rad=(1.0,), candidates=PLACE.xy_m), "candidates is array.*, not a tuple of"),
        (wrong(headings_rad=(1.0,), closed="all"), "closed is of type str, not an anm_mj.types.TargetOutcome"),
        (wrong(headings_rad=(1.0,), stage_ms=None), "stage_ms is None, not milliseconds"),
        (wrong(stop=StopReason.COMPLETE, unexplored=None), "unexplored is None, not a tuple of"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_what_cannot_be_executed_stops_the_run(plan, said, caplog):
    stopped = decided(Fake(plan))
    assert stopped.stop is StopReason.POLICY_ERROR
    with pytest.raises(AssertionError, match=f"policy my:Own returned a plan at step 3 .*{said}"):
        raise AssertionError(stopped.reason)
    assert "The run ends because policy my:Own" in caplog.text


@pytest.mark.parametrize("where", ["observe", "plan", "on_collision"])
@pytest.mark.parametrize(
    "error", [ZeroDivisionError("division by zero"), PlanError("no way"), GeneratorExit("gone"), BaseException("own")]
)
def test_what_a_policy_raises_stops_the_run_at_the_next_decision(where, error):
    fake = Fake(Plan("turn", NOWHERE, actions=(Action.TURN_LEFT,)), error, where)
    policy = GuardedPolicy(fake, "my:Own")
    policy.observe(observe(3, HERE))
    policy.on_collision(HERE, Action.MOVE_FORWARD)
    stopped = policy.plan(Mock(Mapper), observe(3, HERE))
    assert stopped.stop is StopReason.POLICY_ERROR
    assert f"policy my:Own failed in {where}" in stopped.reason
    assert f"{type(error).__name__}: {error} (test_guarded_policy.py, line " in stopped.reason
    calls = fake.calls
    policy.observe(observe(4, HERE))
    assert fake.calls == calls  # It is not asked again.


def test_an_error_of_the_map_is_not_the_policys():
    with pytest.raises(MapError, match="loss"):
        decided(Fake(raises=MapError("the loss is not finite")))


def test_a_policy_cannot_end_the_program_as_if_all_were_well():
    policy = GuardedPolicy(Fake(raises=SystemExit(0)), "my:Own")
    assert policy.plan(Mock(Mapper), observe(3, HERE)).stop is StopReason.POLICY_ERROR


def test_memory_that_no_file_holds_does_not_end_a_run_without_its_files():
    class Remembers(Fake):
        def memory(self):
            words, things = np.array(["a"]), np.array([{"a": 1}], object)
            return {
                "a": words,
                "b": things,
                "c": np.zeros(1, complex),
                "d": np.zeros(1, np.longdouble),
                "e": np.ones(2),
            }

        def continue_from(self, prior, mapper): ...

    assert list(GuardedPolicy(Remembers(), "my:Own").memory()) == ["e"]
