"""How well views bind the position."""

import numpy as np

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS
from tests.planning.policies.gvg.test_information_gain import everywhere, gain_in, with_lid
from tests.planning.worlds import room

EAST, NORTH, WEST = 0, 9, 18


def unbound(grid, x, y):
    return gain_in(grid).unbound_shares(np.array([[x, y]]), 0.05)[0]


def test_a_wall_alone_leaves_a_direction_free():
    hall = unbound(with_lid(room(16, 9)), 8.2, 8.5)

    assert hall.shape == (NUM_AZIMUTHS,)
    assert hall[NORTH] > 0.8


def test_parallel_walls_leave_a_direction_free():
    corridor = unbound(with_lid(room(16, 2)), 8.2, 1.2)

    # Cells of walls and floor meet, which leaves a little.
    assert corridor[[EAST, WEST]].min() > 0.6


def test_corners_and_furniture_bind_both():
    assert unbound(with_lid(room(4, 3)), 2.2, 1.7)[EAST + 4] == 0.0
    corridor = with_lid(room(16, 2, boxes=[(9.7, 0.2, 10.2, 0.9)]))
    assert unbound(corridor, 8.2, 1.2)[EAST] < 0.3


def test_a_single_row_of_rays_tells_nothing_of_directions():
    gain = InformationGain(GvgConfig(num_elevations=1), FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25))
    grid = with_lid(room(4, 3))
    gain.update(grid, everywhere(grid))
    assert (gain.unbound_shares(np.array([[2.2, 1.7]]), 0.05) == 1.0).all()


def test_the_unknown_binds_nothing():
    assert unbound(with_lid(room(4, 3, unknown=[(2.4, 0.2, 4.2, 3.2)])), 2.2, 1.7)[EAST] > 0.9
