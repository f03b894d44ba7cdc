import numpy as np
import pytest

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.active_target import ActiveTarget
from anm_mj.planning.policies.gvg.gain_tracker import GainTracker, GainYield
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import ExpectedView, InformationGain, PromisedRays
from anm_mj.planning.policies.gvg.place_kinds import KINDS
from anm_mj.planning.policies.gvg.views import Viewpoint
from anm_mj.types import Pose2

CONFIG = GvgConfig()
OPENING = np.eye(len(KINDS))[KINDS.index("opening")]
THERE, ELSEWHERE = Pose2(1.0, 2.0, 0.0), Pose2(5.0, 2.0, 0.0)


class Gain(InformationGain):
    """A view that shows nothing but openings, and records what is done to it."""

    def __init__(self, seen_m2, view, left_m2):
        super().__init__(CONFIG, FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25))
        self._seen_m2, self.view, self.left_m2 = seen_m2, view, left_m2
        self.suppressed = None

    seen_m2 = property(lambda self: self._seen_m2)

    def expected_view(self, viewpoint):
        return self.view

    def done_m2(self, promised, looked=None):
        """Of a single ray; all of it where its direction was looked along."""
        left_m2 = 0.0 if looked is not None and looked[0] else min(self.left_m2, promised.gain_m2[0])
        return float(promised.gain_m2[0] - left_m2)

    def suppress(self, cells, distance_m):
        self.suppressed = cells


def view_of(gain_m2):
    return ExpectedView(np.zeros(1, int), np.ones(1), gain_m2, gain_m2 * OPENING)


def promise(gain_m2):
    return PromisedRays(np.zeros(2), np.array([gain_m2], np.float32))


def close(tracker, *, expected_m2, brought_m2, expected_now_m2, pose, turns_m2=0.0, turns_left_m2=0.0, learns=True):
    """The view at the target is expected to show ``expected_m2``, the turns before another ``turns_m2``."""
    given = {"expected_gain_m2": expected_m2 + turns_m2, "seen_m2": 100.0, "config": CONFIG, "view_side": 4}
    promised = promise(turns_m2), promise(expected_m2)
    target = ActiveTarget(Viewpoint(np.array([1.0, 2.0]), 0), promised=promised, view=view_of(expected_m2), **given)
    gain = Gain(100.0 + brought_m2, view_of(expected_now_m2), turns_left_m2 if turns_m2 else expected_now_m2)
    return tracker.close(target, gain, pose, learns=learns), gain.suppressed is not None


@pytest.mark.parametrize(
    ("brought_m2", "expected_now_m2", "pose", "failed"),
    [(0.1, 8.0, THERE, True), (0.1, 0.5, ELSEWHERE, True), (6.0, 0.0, THERE, False)],
)
def test_target_fails_without_its_gain(brought_m2, expected_now_m2, pose, failed):
    outcome, suppressed = close(
        GainTracker(CONFIG), expected_m2=8.0, brought_m2=brought_m2, expected_now_m2=expected_now_m2, pose=pose
    )
    assert suppressed == failed
    # On the way, what the view still expects was not looked at.
    done_m2 = 8.0 if pose is THERE else 8.0 - expected_now_m2
    assert (outcome.kind, outcome.expected_m2, outcome.judged) == ("opening", done_m2, True)
    assert outcome.realised_m2 == pytest.approx(brought_m2)


def test_target_left_while_its_gain_stands_is_not_judged():
    # Most was expected of the turns on the way; what the view alone expects stands, but for what was seen of it.
    tracker = GainTracker(CONFIG)
    left = {"expected_m2": 8.0, "brought_m2": 0.0, "expected_now_m2": 7.0, "pose": ELSEWHERE}
    outcome, suppressed = close(tracker, turns_m2=20.0, turns_left_m2=7.5, **left)
    assert not outcome.judged
    assert not suppressed
    assert tracker.num_poor == 0
    assert (tracker.gain_yield.evidence_m2 == 0.0).all()
    assert (outcome.promised_m2, outcome.expected_m2) == (28.0, 12.5 + 0.5)


@pytest.mark.parametrize(("left_m2", "expected_m2"), [(0.0, 24.0), (20.0, 4.0)])
def test_turns_that_were_not_made_are_not_counted(left_m2, expected_m2):
    view = {"expected_m2": 4.0, "brought_m2": 3.0, "expected_now_m2": 0.0, "pose": THERE}
    outcome, _ = close(GainTracker(CONFIG), turns_m2=20.0, turns_left_m2=left_m2, **view)
    assert (outcome.promised_m2, outcome.expected_m2) == (24.0, expected_m2)


def test_poor_look_tells_about_its_likes():
    tracker = GainTracker(CONFIG)
    close(tracker, expected_m2=40.0, brought_m2=1.0, expected_now_m2=0.0, pose=THERE)
    before = tracker.gain_yield.of_kind
    opening = KINDS.index("opening")
    assert before[opening] < 0.4
    assert (np.delete(before, opening) == np.delete(GainYield().of_kind, opening)).all()
    # What pays as it was expected to changes nothing.
    expected_m2 = 40.0 * float(before[opening])
    close(tracker, expected_m2=expected_m2, brought_m2=expected_m2, expected_now_m2=0.0, pose=THERE)
    assert np.allclose(tracker.gain_yield.of_kind, before, atol=1e-6)


def test_yields_go_on_in_a_continued_run():
    first, second = GainYield(), GainYield()
    first.learn(np.array([10.0, 0.0, 0.0, 30.0, 0.0, 0.0]), np.array([4.0, 0.0, 0.0, 2.0, 0.0, 0.0]))
    second.continue_from(first.evidence_m2)
    assert (second.of_kind == first.of_kind).all()
    assert 0.0 < second.of_kind[3] < second.of_kind[0] < 1.0


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


def test_targets_that_improve_the_map_tell_nothing_of_the_patience_that_is_left():
    tracker = GainTracker(CONFIG)
    poor = {"expected_m2": 1.0, "brought_m2": 0.0, "expected_now_m2": 0.0, "pose": THERE}
    for learns in (False, True, False):
        close(tracker, learns=learns, **poor)
    assert tracker.num_poor == 1
    close(tracker, learns=False, **(poor | {"brought_m2": 2.0}))
    assert tracker.num_poor == 1
