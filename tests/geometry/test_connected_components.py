import numpy as np

from anm_mj.geometry.connected_components import connected_components


def test_links_make_components():
    group = connected_components(np.array([(4, 0), (2, 4), (1, 5)]), 6)
    assert group[0] == group[2] == group[4]
    assert group[1] == group[5]
    assert len(set(group[[0, 1, 3]])) == 3
    assert set(group) == {0, 1, 2}


def test_nodes_without_links_are_components():
    assert connected_components(np.zeros((0, 2), np.int64), 3).tolist() == [0, 1, 2]
    assert connected_components(np.zeros((0, 2), np.int64), 0).tolist() == []
