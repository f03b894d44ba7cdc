from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.policies.gvg.pooled_occupancy import PooledOccupancy
from anm_mj.planning.policies.gvg.unexplored import unexplored_patches
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.types import OCCUPIED, UNKNOWN, Footprint, Pose2
from tests.planning.worlds import room, topdown_map

CAMERA = FieldOfView(1.0, 1.0, 1.0, 1.0, 0.0, 1.25)


def left_in(world):
    grid = world.occupancy
    grid.state[:2] = grid.state[-2:] = OCCUPIED
    grid.state[:, :3] = grid.state[:, :, :3] = OCCUPIED
    pose = Pose2(1.0, 1.7, 0.0)
    grid_below = grid.state.copy()
    grid.state[1] = grid_below[5]  # The body's lowest heights are free.
    topdown = topdown_map(TopDownMapper(PlanningConfig(), Footprint(0.18, 0.1, 1.35)), grid, world.sdf, pose)
    occupancy = PooledOccupancy(5.5)
    occupancy.update(grid, (slice(0, grid.state.shape[1]), slice(0, grid.state.shape[2])))
    return unexplored_patches(occupancy, topdown, pose, safe_m=0.22, range_m=4.5, camera=CAMERA)


def test_room_seen_whole_leaves_nothing():
    assert left_in(room(4, 3)) == ()


def test_narrow_gap_is_told_from_a_wall():
    # A slit of 0.3 m lets no body of 0.44 m through.
    slit = [(4.2, 0.2, 4.3, 1.5), (4.2, 1.8, 4.3, 3.2)]
    unknown = [(9.6, 0.2, 10.2, 3.2)]
    (narrow,) = left_in(room(10, 3, boxes=slit, unknown=unknown))
    assert narrow.why == "too narrow a way"
    assert abs(narrow.centre_m[0] - 9.6) < 0.2
    (closed,) = left_in(room(10, 3, boxes=[(4.2, 0.2, 4.3, 3.2)], unknown=unknown))
    assert closed.why == "unreachable"
    assert closed.area_m2 > 2.0


def test_patch_in_reach_is_hidden_or_too_high():
    world = room(4, 3)
    world.occupancy.state[10:20, 40:50, 75:84] = UNKNOWN
    (patch,) = left_in(world)
    assert patch.why == "hidden"
    world = room(4, 3)
    world.occupancy.state[34:38, 25:35, 20:30] = UNKNOWN
    (patch,) = left_in(world)
    assert patch.why == "too high"
