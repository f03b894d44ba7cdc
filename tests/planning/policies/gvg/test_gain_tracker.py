import numpy as np

from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.gain_tracker import GainTracker
from anm_mj.types import Pose2

CONFIG = GvgConfig()
THERE, ELSEWHERE = Pose2(1.0, 2.0, 0.0), Pose2(5.0, 2.0, 0.0)


def ledger_for(promised_m2):
    ledger = GainTracker(CONFIG)
    ledger.open(np.array([1.0, 2.0]), 0, promised_m2, 100.0)
    return ledger


def test_a_promise_fails_when_it_comes_to_nothing_there_or_vanishes_on_the_way():
    assert ledger_for(8.0).settle(100.1, 8.0, THERE)
    assert ledger_for(8.0).settle(100.1, 0.5, ELSEWHERE)
    assert not ledger_for(8.0).settle(106.0, 0.0, THERE)


def test_a_target_left_on_the_way_while_its_promise_stands_counts_for_nothing():
    ledger = ledger_for(8.0)
    assert not ledger.settle(100.0, 7.0, ELSEWHERE)
    assert ledger.poor_in_a_row == 0
    assert ledger.target_xy_m is None


def test_poor_targets_in_a_row_exhaust_small_promises_first():
    ledger = GainTracker(CONFIG)
    for n in range(1, 2 * CONFIG.patience_targets + 1):
        ledger.open(THERE.xy_m, 0, 1.0, 100.0)
        ledger.settle(100.0, 1.0, THERE)
        assert ledger.is_exhausted(0.5) == (n >= CONFIG.patience_targets)
        assert ledger.is_exhausted(2 * CONFIG.large_gain_m2) == (n >= 2 * CONFIG.patience_targets)
    ledger.open(THERE.xy_m, 0, 1.0, 100.0)
    ledger.settle(102.0, 0.0, THERE)
    assert not ledger.is_exhausted(0.5)


def test_a_target_is_done_when_the_robot_stands_there_and_looks_along_its_heading():
    ledger = ledger_for(1.0)
    assert ledger.is_done(Pose2(1.05, 2.0, 0.05))
    assert not ledger.is_done(Pose2(1.05, 2.0, 1.0))
    assert not ledger.is_done(Pose2(1.5, 2.0, 0.0))
    assert ledger.is_target(np.array([1.3, 2.0]))
    assert not ledger.is_target(np.array([1.7, 2.0]))


def test_a_target_whose_vertex_moves_is_followed_with_its_promise():
    ledger = ledger_for(8.0)
    moved = Pose2(1.3, 2.0, np.deg2rad(90.0))
    assert not ledger.is_done(moved)

    ledger.follow(moved.xy_m, 9)

    assert ledger.is_done(moved)
    assert ledger.settle(101.0, 0.0, moved), "8 m2 were promised and 1 m2 was seen"


def test_a_promise_does_not_creep_away_with_its_target_nor_pass_to_a_view_to_the_other_side():
    ledger = ledger_for(8.0)
    assert ledger.is_promised(np.array([1.4, 2.0]), 35)
    ledger.follow(np.array([1.4, 2.0]), 35)

    assert ledger.is_promised(np.array([1.0, 2.0]), 4)
    assert not ledger.is_promised(np.array([1.8, 2.0]), 0)
    assert not ledger.is_promised(np.array([1.4, 2.0]), 18)
