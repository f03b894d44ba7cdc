"""Cells of tables."""

import numpy as np
import pytest

from anm_mj.bench.markdown_table import with_interval
from anm_mj.bench.statistics import LEAST_SCENES


@pytest.mark.parametrize(
    ("by_scene", "cell"),
    [
        (np.zeros(0), "–"),
        (np.arange(float(LEAST_SCENES - 1)), "+2.0"),
        (np.full(LEAST_SCENES, 2.0), "+2.0 [+2.0, +2.0]"),
    ],
)
def test_a_mean_has_its_interval_where_there_are_scenes_enough(by_scene, cell):
    assert with_interval(by_scene, "+.1f") == cell
