import numpy as np
import pytest

from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.stagnation import StagnationDetector

CONFIG = GvgConfig(stagnation_share=0.1)


def detector(*seen):
    found = StagnationDetector(CONFIG)
    for step, seen_m2 in seen:
        found.update(step, seen_m2)
    return found


@pytest.mark.parametrize(
    ("seen", "stagnating"),
    [
        ([(27, 40.0)], False),
        ([(900, 100.0), (950, 100.0), (1000, 100.0)], True),
        ([(900, 100.0), (950, 100.0), (1000, 100.0 * (1.0 + 2 * CONFIG.useful_share))], False),
        ([(890, 80.0), (900, 100.0), (950, 100.0), (1000, 100.1)], True),
        ([(895, 80.0), (901, 100.0), (1000, 100.0)], False),
    ],
)
def test_stagnation_is_a_tenth_of_all_steps_without_useful_gain(seen, stagnating):
    assert detector(*seen).is_stagnating() == stagnating


def test_path_across_a_room_is_no_stagnation():
    least = CONFIG.min_stagnation_steps
    assert not detector((100, 50.0), (100 + least - 1, 50.0)).is_stagnating()
    assert detector((100, 50.0), (100 + least, 50.0)).is_stagnating()


def test_a_continued_run_goes_on_in_the_window():
    prior = detector((0, 90.0), (890, 99.99), (995, 100.0), (1000, 100.0))
    assert prior.is_stagnating()
    next_ = StagnationDetector(CONFIG)
    next_.continue_from(prior.window)
    next_.update(0, 100.0)
    assert next_.is_stagnating()
    next_.update(20, 103.0)
    assert not next_.is_stagnating()
    np.testing.assert_array_equal(StagnationDetector(CONFIG).window, np.zeros((0, 2)))
