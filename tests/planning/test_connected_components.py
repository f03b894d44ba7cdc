import numpy as np

from anm_mj.planning.connected_components import connected_components


def test_things_are_in_one_group_if_links_lead_from_each_to_each_and_others_stand_alone():
    group = connected_components(np.array([(4, 0), (2, 4), (1, 5)]), 6)
    assert group[0] == group[2] == group[4]
    assert group[1] == group[5]
    assert len(set(group[[0, 1, 3]])) == 3
    assert set(group) == {0, 1, 2}


def test_without_links_everything_stands_alone():
    assert connected_components(np.zeros((0, 2), np.int64), 3).tolist() == [0, 1, 2]
    assert connected_components(np.zeros((0, 2), np.int64), 0).tolist() == []
