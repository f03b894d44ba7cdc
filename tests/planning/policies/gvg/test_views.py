import math

import numpy as np
import pytest

from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS, sector_of, signed_turns


@pytest.mark.parametrize(("yaw_deg", "sector"), [(0.0, 0), (4.9, 0), (5.1, 1), (-4.9, 0), (-5.1, 35), (180.0, 18)])
def test_sector_is_the_nearest(yaw_deg, sector):
    assert sector_of(math.radians(yaw_deg)) == sector


@pytest.mark.parametrize(("to", "start", "turns"), [(3, 1, 2), (35, 1, -2), (1, 35, 2), (19, 1, -18)])
def test_turns_go_the_shorter_way(to, start, turns):
    assert signed_turns(to, start) == turns


def test_turns_lead_from_start_to_end():
    to, start = (a.ravel() for a in np.meshgrid(np.arange(NUM_AZIMUTHS), np.arange(NUM_AZIMUTHS)))
    assert ((start + signed_turns(to, start)) % NUM_AZIMUTHS == to).all()
