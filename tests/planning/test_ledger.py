import numpy as np

from anm_mj.planning.config import PlanningConfig
from anm_mj.planning.ledger import Ledger
from anm_mj.types import Pose2

CONFIG = PlanningConfig()
CELLS = np.array([3, 5])


def ledger_for(promised_m2):
    ledger = Ledger(CONFIG)
    ledger.open(np.array([1.0, 2.0]), 0.0, promised_m2, 100.0, CELLS, 1)
    return ledger


def test_a_promise_that_fails_gives_up_what_made_it_and_one_that_holds_does_not():
    assert np.array_equal(ledger_for(8.0).settle(100.1, 1), CELLS)
    assert len(ledger_for(8.0).settle(106.0, 1)) == 0
    assert len(ledger_for(8.0).settle(100.1, 2)) == 0  # The grid was laid out anew: the indices mean nothing now.


def test_poor_targets_in_a_row_exhaust_small_promises_first():
    ledger = Ledger(CONFIG)
    for n in range(1, 2 * CONFIG.patience_targets + 1):
        ledger.open(np.zeros(2), 0.0, 1.0, 100.0, CELLS, 1)
        ledger.settle(100.0, 1)
        assert ledger.is_exhausted(0.5) == (n >= CONFIG.patience_targets)
        assert ledger.is_exhausted(2 * CONFIG.large_gain_m2) == (n >= 2 * CONFIG.patience_targets)
    ledger.open(np.zeros(2), 0.0, 1.0, 100.0, CELLS, 1)
    ledger.settle(102.0, 1)
    assert not ledger.is_exhausted(0.5)


def test_a_target_is_done_when_the_robot_stands_there_and_looks_along_its_heading():
    ledger = ledger_for(1.0)
    assert ledger.is_done(Pose2(1.05, 2.0, 0.05))
    assert not ledger.is_done(Pose2(1.05, 2.0, 1.0))
    assert not ledger.is_done(Pose2(1.5, 2.0, 0.0))
    assert ledger.is_target(np.array([1.3, 2.0]))
    assert not ledger.is_target(np.array([1.7, 2.0]))
