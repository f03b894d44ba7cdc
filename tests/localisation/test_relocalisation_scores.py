"""From which scores on a lost camera's place is believed."""

import math

import numpy as np
import pytest

from anm_mj.localisation.localisation_config import RelocalisationConfig
from anm_mj.localisation.relocaliser import Hypothesis, believable

CONFIG = RelocalisationConfig()


def place(x_m: float, mean: float, num_frames: int) -> Hypothesis:
    T = np.eye(4)
    T[0, 3] = x_m
    return Hypothesis(T, mean * num_frames, num_frames)


@pytest.mark.parametrize(
    ("usual_score", "believed"),
    [
        # Without any experience the fixed bound counts.
        (math.nan, False),
        # A sensor whose frames never fit better asks for no more.
        (0.7, True),
        # The bound is never higher than the fixed one.
        (0.95, False),
    ],
)
def test_a_place_has_to_fit_as_frames_usually_do(usual_score: float, believed: bool) -> None:
    assert (believable([place(0.0, 0.65, 12)], CONFIG, usual_score) is not None) == believed


def test_a_place_is_believed_when_no_other_is_nearly_as_good() -> None:
    best = place(0.0, 0.9, 6)
    assert believable([best, place(5.0, 0.5, 6)], CONFIG) is best
    assert believable([best, place(5.0, 0.88, 6)], CONFIG) is None
    assert believable([place(0.0, 0.9, CONFIG.frames - 1)], CONFIG) is None
    assert believable([], CONFIG) is None


def test_the_place_where_odometry_puts_the_camera_needs_less() -> None:
    usual, score = 0.7, 0.55
    assert believable([place(0.0, score, 12)], CONFIG, usual) is None
    expected = place(0.0, score, 12)
    expected.expected = True
    assert believable([expected], CONFIG, usual) is expected
    # Not where the map contradicts it, or another place fits better.
    elsewhere = place(5.0, 0.6, 12)
    assert believable([expected, elsewhere], CONFIG, usual) is None
    poor = place(0.0, 0.45, 12)
    poor.expected = True
    assert believable([poor], CONFIG, usual) is None


@pytest.mark.parametrize("expected_score", [0.1, 0.6])
def test_a_room_that_looks_alike_far_away_is_not_believed(expected_score: float) -> None:
    here, twin = place(0.3, expected_score, 20), place(11.0, 0.78, 20)
    here.expected = True
    assert believable([twin, here], CONFIG, 0.7, np.eye(4)) is (here if expected_score > 0.5 else None)
    # Nobody knows where a robot was that begins at an unknown place.
    assert believable([twin, here], CONFIG, 0.7) is twin


def test_a_robot_that_was_pushed_is_found_at_once() -> None:
    pushed, here = place(2.0, 0.78, 8), place(0.0, 0.2, 8)
    assert believable([pushed, here], CONFIG, 0.7, np.eye(4)) is pushed
