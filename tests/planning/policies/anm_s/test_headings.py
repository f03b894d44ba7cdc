import math

import numpy as np
import pytest

from anm_mj.frames import wrap_angle
from anm_mj.planning.policies.anm_s.headings import view_headings
from anm_mj.types import Region

WELL_IN_VIEW_RAD = math.radians(30)


@pytest.mark.parametrize(("bearing_deg", "num_turns"), [(0, 0), (25, 0), (80, 1), (-80, 1), (180, 1)])
def test_the_robot_turns_no_farther_than_until_a_region_is_well_in_view(bearing_deg, num_turns):
    bearing = math.radians(bearing_deg)
    centre = np.array([2 * math.cos(bearing), 2 * math.sin(bearing), 1.0])
    headings = view_headings((Region(centre, np.array([-1.0, 0, 0]), 9, 5.0, 0),), np.zeros(2), 0.0, WELL_IN_VIEW_RAD)
    assert len(headings) == num_turns
    if headings:
        assert abs(wrap_angle(bearing - headings[-1])) == pytest.approx(math.radians(30))
        assert abs(headings[-1]) < abs(bearing)


def test_regions_on_one_side_are_taken_in_by_one_sweep_that_ends_when_the_last_is_well_in_view():
    places = [(0.0, 2.0), (0.5, 2.0), (-0.5, 2.0)]
    regions = tuple(Region(np.array([*xy, 1.0]), np.array([0, -1.0, 0]), 9, 5.0, 0) for xy in places)
    headings = view_headings(regions, np.zeros(2), 0.0, WELL_IN_VIEW_RAD)
    assert list(headings) == sorted(headings)
    assert headings[-1] == pytest.approx(math.atan2(2.0, -0.5) - math.radians(30))


@pytest.mark.parametrize(("bearing_deg", "heading_deg"), [(0, None), (55, None), (80, 20), (-20, -20), (-80, -80)])
def test_a_camera_that_looks_aside_is_turned_by_its_axis(bearing_deg: int, heading_deg: int | None):
    bearing = math.radians(bearing_deg)
    region = Region(np.array([2 * math.cos(bearing), 2 * math.sin(bearing), 1.0]), np.array([-1.0, 0, 0]), 9, 5.0, 0)
    headings = view_headings((region,), np.zeros(2), 0.0, WELL_IN_VIEW_RAD + 1e-9, math.radians(30))
    assert [math.degrees(heading) for heading in headings] == pytest.approx([heading_deg] if heading_deg else [])
