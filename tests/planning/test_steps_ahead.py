import math

import pytest

from anm_mj.planning.steps_ahead import path_is_blocked
from anm_mj.types import Footprint, Pose2
from tests.planning.worlds import room

BODY = Footprint(0.18, 0.05, 1.35)


@pytest.mark.parametrize(
    ("pose", "blocked"),
    [
        (Pose2(2.0, 1.7, 0.0), False),
        (Pose2(3.95, 1.7, 0.0), True),
        (Pose2(3.95, 1.7, math.pi), False),
        (Pose2(4.05, 1.7, math.pi / 2), False),  # Touching already, but no more by going along the wall.
        (Pose2(2.0, 1.52, 0.0), True),
        (Pose2(2.0, 1.25, 0.0), False),
    ],
)
def test_only_what_lies_on_the_way_blocks_it(pose, blocked):
    world = room(4, 3, boxes=[(2.25, 1.6, 2.3, 1.65)])
    if pose.y_m == 1.7 and pose.x_m == 2.0:
        world = room(4, 3)
    assert path_is_blocked(world.occupancy, BODY, pose) is blocked
