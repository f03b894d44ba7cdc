import numpy as np
import pytest

from anm_mj.planning.paths import ShortestPathTree
from anm_mj.planning.policies.anm_s.candidate_vertices import own_room, room_distance, room_name
from anm_mj.planning.policies.anm_s.region_stages import RegionState
from anm_mj.types import Pose2, TopDownMap, VoronoiGraph


def situation(room, distance_m):
    """What anm-s reads of rooms: that of each vertex, and how far each is."""
    num = len(room)
    graph = VoronoiGraph(np.zeros((num, 2)), np.ones(num), np.zeros((0, 2), np.int64), np.zeros(0))
    topdown = TopDownMap(np.ones((1, 1), np.float32), np.zeros((1, 1), np.int8), 0.05, np.zeros(2))
    pose = Pose2(0.0, 0.0, 0.0)
    paths = ShortestPathTree(np.array(distance_m, float), [], {}, graph, topdown, 0.22, pose)
    none = np.zeros(0, np.int64)
    rooms = np.array(room, np.int64)
    return RegionState(
        pose, topdown, graph, paths, regions=(), decisions=none, frontier_xy_m=np.zeros((0, 2)), room=rooms
    )


def test_the_robots_own_room_is_the_one_it_reaches_first_and_no_other_is_nearer():
    now = situation([0, 1, 1, -1], [5.0, 1.0, 9.0, 2.0])
    assert own_room(now) == 1
    assert room_distance(now, np.arange(4)).tolist() == [5.0, 0.0, 0.0, 2.0]
    assert [room_name(now, vertex) for vertex in (0, 2, 3)] == ["room 0", "the rest of the room", "a nook"]


def test_from_a_nook_other_nooks_are_as_far_as_they_are():
    now = situation([0, -1, -1], [3.0, 4.0, 0.5])
    assert own_room(now) == -1
    assert room_distance(now, np.arange(3)).tolist() == [3.0, 4.0, 0.5]
    assert room_name(now, 1) == "a nook"


@pytest.mark.parametrize("room", [[], [0, 1]])
def test_a_robot_that_reaches_no_vertex_is_in_no_room(room):
    assert own_room(situation(room, [np.inf] * len(room))) == -1
