import pytest

from anm_mj.planning.policies.gvg.config import GvgConfig
from anm_mj.planning.policies.gvg.stagnation import LEAST_STEPS, USEFUL_SHARE, Progress


def progress(*seen):
    record = Progress(GvgConfig(stagnation_share=0.1))
    for step, seen_m2 in seen:
        record.note(step, seen_m2)
    return record


@pytest.mark.parametrize(
    ("seen", "lull"),
    [
        ([(27, 40.0)], False),
        ([(900, 100.0), (950, 100.0), (1000, 100.0)], True),
        ([(900, 100.0), (950, 100.0), (1000, 100.0 * (1.0 + 2 * USEFUL_SHARE))], False),
        ([(890, 80.0), (900, 100.0), (950, 100.0), (1000, 100.1)], True),
        ([(895, 80.0), (901, 100.0), (1000, 100.0)], False),
    ],
)
def test_a_lull_is_a_tenth_of_all_steps_without_anything_useful(seen, lull):
    assert progress(*seen).is_lull() == lull


def test_a_way_across_a_room_is_no_lull():
    assert not progress((100, 50.0), (100 + LEAST_STEPS - 1, 50.0)).is_lull()
    assert progress((100, 50.0), (100 + LEAST_STEPS, 50.0)).is_lull()
