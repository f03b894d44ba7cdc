import numpy as np
import pytest

from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gain_tracker import GainTracker
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.views import Viewpoint
from anm_mj.types import Pose2

CONFIG = GvgConfig()
THERE, ELSEWHERE = Pose2(1.0, 2.0, 0.0), Pose2(5.0, 2.0, 0.0)


def close(tracker, *, expected_m2, brought_m2, expected_now_m2, pose):
    viewpoint = Viewpoint(np.array([1.0, 2.0]), 0)
    target = ActiveTarget(viewpoint, expected_gain_m2=expected_m2, seen_m2=100.0, config=CONFIG, view_side=4)
    return tracker.close(target, seen_m2=100.0 + brought_m2, expected_now_m2=expected_now_m2, pose=pose)


@pytest.mark.parametrize(
    ("brought_m2", "expected_now_m2", "pose", "failed"),
    [(0.1, 8.0, THERE, True), (0.1, 0.5, ELSEWHERE, True), (6.0, 0.0, THERE, False)],
)
def test_target_fails_without_its_gain(brought_m2, expected_now_m2, pose, failed):
    tracker = GainTracker(CONFIG)
    found = close(tracker, expected_m2=8.0, brought_m2=brought_m2, expected_now_m2=expected_now_m2, pose=pose)
    assert found == failed


def test_target_left_while_its_gain_stands_is_not_judged():
    tracker = GainTracker(CONFIG)
    assert not close(tracker, expected_m2=8.0, brought_m2=0.0, expected_now_m2=7.0, pose=ELSEWHERE)
    assert tracker.num_poor == 0


def test_poor_targets_exhaust_small_gains_first():
    tracker = GainTracker(CONFIG)
    for n in range(1, 2 * CONFIG.patience_targets + 1):
        close(tracker, expected_m2=1.0, brought_m2=0.0, expected_now_m2=1.0, pose=THERE)
        assert tracker.is_exhausted(0.5) == (n >= CONFIG.patience_targets)
        assert tracker.is_exhausted(2 * CONFIG.large_gain_m2) == (n >= 2 * CONFIG.patience_targets)


def test_good_target_ends_the_row_of_poor_ones():
    tracker = GainTracker(CONFIG)
    for brought_m2 in (0.0,) * CONFIG.patience_targets + (2.0,):
        close(tracker, expected_m2=1.0, brought_m2=brought_m2, expected_now_m2=0.0, pose=THERE)
    assert not tracker.is_exhausted(0.5)
