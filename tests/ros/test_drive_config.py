"""What settings of a live robot are refused."""

import pytest

from anm_mj.errors import RobotError
from anm_mj.ros.drive_config import RosConfig


def test_a_radius_in_centimetres_is_refused():
    with pytest.raises(RobotError, match=r"^ros.radius_m is 18.0; it must be a number above zero and at most 2.$"):
        RosConfig(radius_m=18.0)
    assert RosConfig(radius_m=2.0).footprint.radius_m == 2.0
