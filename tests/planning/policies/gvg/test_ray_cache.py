"""How far rays reach."""

from dataclasses import replace

import numpy as np
import pytest

from anm_mj.errors import PlanError
from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from tests.planning.worlds import room

CAMERA = FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25)


def sector_gains(range_m):
    """Of a place in a room, for a camera that measures up to a range [m]."""
    gain = InformationGain(GvgConfig(), replace(CAMERA, range_m=range_m))
    grid = room(4, 3).occupancy
    gain.update(grid, (slice(0, grid.state.shape[1]), slice(0, grid.state.shape[2])))
    return gain.sector_gains(np.array([[2.0, 1.5]]))


@pytest.mark.parametrize("range_m", [0.2, 0.25])
def test_a_camera_that_measures_less_far_than_rays_begin_is_refused_in_a_sentence(range_m):
    with pytest.raises(PlanError, match=rf"up to {range_m} m, .* from 0\.25 m on; raise .*\(sensor\.max_range_m\)"):
        sector_gains(range_m)


def test_a_camera_that_measures_no_farther_than_one_cell_has_gains():
    assert sector_gains(0.27).shape == (1, 36)
