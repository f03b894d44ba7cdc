import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anm_mj.io.bag_poses import FrameTree, Track


def test_poses_in_between():
    track = Track("poses")
    for time_s, yaw in ((1.0, 0.4), (1.2, 0.8)):
        quaternion = Rotation.from_euler("z", yaw).as_quat()
        track.add(time_s, np.array([time_s, 0.0, 0.0, *quaternion]))
    T = track.at(1.05)
    assert T is not None
    assert T[0, 3] == pytest.approx(1.05)
    assert math.atan2(T[1, 0], T[0, 0]) == pytest.approx(0.5)
    # The last pose is that of no later frame, however large a gap is bridged; clocks differ by a little.
    assert track.at(0.9) is None
    assert track.at(1.3) is None
    assert track.at(0.99) is not None
    assert track.at(1.21) is not None
    track.add(9.0, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    assert track.at(5.0) is None


def test_a_static_frame_that_is_stated_anew_takes_the_place_of_the_one_before():
    tree = FrameTree()
    for height_m in (0.2, 1.4):
        tree.add("base", "camera", 0.0, np.array([0.0, 0.0, height_m, 0.0, 0.0, 0.0, 1.0]), static=True)
    (link,) = tree.links("camera")
    T_base_camera = link.at(7.0)
    assert T_base_camera is not None
    assert T_base_camera[2, 3] == 1.4
