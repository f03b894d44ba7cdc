"""What the contact sheet of a scene draws."""

import numpy as np
import trimesh

from anm_mj.viz.scene_sheet import cut_lines


def test_the_cut_of_a_box_is_its_outline():
    box = trimesh.creation.box(bounds=[[1.0, 2.0, 0.0], [1.1, 5.0, 2.5]])
    for sign in (1.0, -1.0):  # Triangles with one corner above the cut, and with two.
        lines = cut_lines(np.asarray(box.vertices) * [1.0, 1.0, sign], box.faces, sign * 2.0)
        assert lines.min(axis=(0, 1)).tolist() == [1.0, 2.0]
        assert lines.max(axis=(0, 1)).tolist() == [1.1, 5.0]
        length_m = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum()
        assert np.isclose(length_m, 2.0 * (0.1 + 3.0))


def test_what_does_not_reach_the_cut_has_no_line():
    table = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [1.0, 1.0, 0.7]])
    assert cut_lines(np.asarray(table.vertices), table.faces, 2.0).shape == (0, 2, 2)
