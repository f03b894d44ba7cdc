"""Cells of tables."""

import numpy as np
import pytest
from markdown_it import MarkdownIt

from anm_mj.bench.markdown_table import with_interval
from anm_mj.bench.statistics import LEAST_SCENES
from anm_mj.utils.markdown import table


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


def test_a_name_with_a_bar_stays_in_its_column():
    text = table(["scene", "AUC [%]"], [["a|b", "69.3"]])
    page = MarkdownIt("commonmark").enable("table").render(text)
    assert "<td>a|b</td>" in page
    assert '<td style="text-align:right">69.3</td>' in page
