import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.policies.gvg.unmeasured import UnmeasuredRays, hidden_sectors
from anm_mj.sensing.pixel_state import without_moved
from anm_mj.types import UNKNOWN, Observation, Pose2
from tests.box_room import CAMERA, camera_pose, room_depth
from tests.planning.worlds import room

RANGE_M = GvgConfig().gain_range_m


def view(pose, missing):
    """A view of a room in which some pixels measured nothing."""
    T_world_camera = camera_pose(pose)
    depth = np.abs(room_depth(T_world_camera))
    depth[missing] = np.nan
    return Observation(0, 0.0, np.zeros((*depth.shape, 3), np.uint8), depth, CAMERA, T_world_camera, pose)


def gain_in(world):
    gain = InformationGain(GvgConfig(), FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25))
    grid = world.occupancy
    gain.update(grid, (slice(0, grid.state.shape[1]), slice(0, grid.state.shape[2])))
    return gain


def test_cells_behind_missing_depth_expect_nothing_from_there():
    gain = gain_in(room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)]))
    pose = Pose2(3.5, 2.0, 0.0)
    before = gain.sector_gains(np.array([[3.5, 2.0]]))[0]
    rays = UnmeasuredRays()
    rays.add(view(pose, np.s_[:]))
    cells, distance_m = rays.take(gain.occupancy, RANGE_M)
    unknown = gain.occupancy.state.ravel()[cells] == UNKNOWN
    assert unknown.sum() > 100
    assert np.all((distance_m[unknown] > 1.2) & (distance_m[unknown] < RANGE_M))
    gain.suppress(cells, distance_m)
    after = gain.sector_gains(np.array([[3.5, 2.0]]))[0]
    # Ahead next to nothing is left; what lies beside the view is as before.
    assert after[[35, 0, 1]].sum() < 0.2 * before[[35, 0, 1]].sum()
    assert len(rays.take(gain.occupancy, RANGE_M)[0]) == 0


def test_a_camera_that_sees_everything_suppresses_nothing():
    gain, rays = gain_in(room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])), UnmeasuredRays()
    seen = view(Pose2(3.5, 2.0, 0.0), np.zeros((256, 256), bool))
    rays.add(seen)
    rays.add(replace(seen, depth_m=np.full_like(seen.depth_m, np.inf)))
    assert len(rays.take(gain.occupancy, RANGE_M)[0]) == 0


def test_single_lost_pixels_suppress_nothing():
    gain, rays = gain_in(room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])), UnmeasuredRays()
    rays.add(view(Pose2(3.5, 2.0, 0.0), np.random.default_rng(0).random((256, 256)) < 0.5))
    assert len(rays.take(gain.occupancy, RANGE_M)[0]) == 0


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 180.0])
def test_what_somebody_hides_was_not_looked_at(yaw_deg):
    gain = gain_in(room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)]))
    seen = view(Pose2(3.5, 2.0, math.radians(yaw_deg)), np.zeros((256, 256), bool))
    assert hidden_sectors(seen, 0.0) is None
    # Somebody in the left half of the image, as wide as 45 degrees.
    moved = np.zeros((256, 256), bool)
    moved[20:230, :128] = True
    among = without_moved(seen, moved)
    rays = UnmeasuredRays()
    rays.add(among)
    assert len(rays.take(gain.occupancy, RANGE_M)[0]) == 0
    hidden = hidden_sectors(among, 0.0)
    assert hidden is not None
    ahead = round(yaw_deg / 10.0)
    assert {(k - ahead) % 36 for k in np.flatnonzero(hidden)} == {0, 1, 2, 3, 4}
    aside = hidden_sectors(among, math.radians(20.0))
    assert aside is not None
    np.testing.assert_array_equal(aside, np.roll(hidden, -2))


def test_cells_behind_somebody_keep_their_gain():
    world = room(8, 4, unknown=[(5.2, 0.2, 8.2, 4.2)])
    pose, place = Pose2(3.5, 2.0, 0.0), np.array([[3.5, 2.0]])
    gain, hidden = gain_in(world), np.zeros(36, bool)
    hidden[[0, 1]] = True
    before = gain.sector_gains(place)[0]
    gain.suppress_view(pose, hidden)
    after = gain.sector_gains(place)[0]
    np.testing.assert_allclose(after[[0, 1]], before[[0, 1]], rtol=0.1)
    assert after[35] < 0.5 * before[35]
