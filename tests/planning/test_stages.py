"""The stages together: what robots of any width find in a map."""

import numpy as np
import pytest

from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.stages import Stages
from anm_mj.types import Footprint, Pose2
from tests.box_room import observe
from tests.planning.worlds import room


def read(world, radius_m, pose, **settings):
    """What a robot of a radius reads out of a map that is known as a whole."""
    stages = Stages(PlanningConfig(horizon_m=100.0, **settings), Footprint(radius_m, 0.05, 1.35))
    return stages.read(world, observe(0, pose))


@pytest.mark.parametrize(("radius_m", "margin_m"), [(1.16, 0.04), (2.0, 0.04), (0.18, 1.8)])
def test_a_robot_that_needs_much_room_has_paths_in_a_hall(radius_m, margin_m):
    state = read(room(16, 8), radius_m, Pose2(4.0, 4.2, 0.0), margin_m=margin_m)
    assert np.isfinite(state.paths.distance_m).all()
    assert state.graph.vertex_xy_m[:, 0].max() > 10.0
    # And none where it has none.
    assert not len(read(room(16, 2.2), radius_m, Pose2(4.0, 1.3, 0.0), margin_m=margin_m).graph.vertex_xy_m)


def test_for_other_robots_clearance_is_capped():
    assert read(room(8, 6), 0.18, Pose2(4.0, 3.2, 0.0)).topdown.clearance_m.max() == pytest.approx(23.5 * 0.05)


def test_a_narrow_robot_has_paths_through_passages_that_it_fits_through():
    wall = [(4.2, 0.2, 4.3, 1.45), (4.2, 1.75, 4.3, 3.2)]
    world, pose = room(8, 3, boxes=wall), Pose2(2.0, 1.6, 0.0)
    for radius_m, fits in ((0.10, True), (0.18, False)):
        state = read(world, radius_m, pose)
        beyond = state.graph.vertex_xy_m[:, 0] > 5.0
        assert beyond.any()
        assert np.isfinite(state.paths.distance_m[beyond]).any() == fits
