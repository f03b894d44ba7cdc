"""What the benchmark of the graph builds and prints, without a look at its times."""

import numpy as np
import pytest
from scipy import ndimage

from scripts import bench_graph


def test_a_large_building_is_made_of_several_and_all_of_its_rooms_can_be_reached():
    plan = bench_graph.building(1000.0, "apartment", 0)
    assert plan.room.max() >= bench_graph.MOST_ROOMS
    assert np.count_nonzero(plan.room >= 0) * bench_graph.CELL_M**2 == pytest.approx(1000.0, rel=0.1)
    label = np.empty(plan.obstacles.shape, np.int32)
    ndimage.label(~plan.obstacles, output=label)
    main = label == np.bincount(label[label > 0]).argmax()
    assert set(plan.room[main]) - {-1} == set(range(plan.room.max() + 1))


def test_the_rooms_found_are_held_against_the_true_ones():
    true = np.array([0, 0, 1, 1, -1, 2])
    assert bench_graph.agreement(true, true, np.ones(6)) == (1.0, 1.0)
    # Rooms 0 and 1 are taken for one, and half of room 2 for another.
    assert bench_graph.agreement(np.array([0, 0, 0, 0, 1, 1]), true, np.ones(6)) == (0.6, 1.0)
    assert bench_graph.agreement(np.array([0, 3, 1, 1, 1, 2]), true, np.ones(6)) == (1.0, 0.8)


def test_a_row_is_printed_for_both_kinds_of_graph(capsys):
    bench_graph.main(areas_m2=(45.0,), repeats=1)
    lines = capsys.readouterr().out.splitlines()
    assert sum(" fine " in line for line in lines) == sum(" coarse far field " in line for line in lines) == 2
    found = [line.split("|")[4] for line in lines if "%" in line]
    assert len(found) == 2
    assert all(int(cell) >= 2 for cell in found)
