import math

import numpy as np
import pytest

from anm_mj.planning.paths import (
    clearance_at,
    path_steps,
    quantize_headings,
    remaining_path,
    segments_clear,
    shortest_paths,
)
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.planning.topdown_mapper import TopDownMapper
from anm_mj.planning.voronoi_graph import voronoi_graph
from anm_mj.types import TURN_STEP_RAD, Footprint, Pose2, VoronoiGraph
from tests.planning.worlds import room, topdown_map

SAFE_M = 0.22
CONFIG = PlanningConfig(horizon_m=20.0)


def situation(world, pose):
    topdown = topdown_map(TopDownMapper(CONFIG, Footprint(0.18, 0.05, 1.35)), world.occupancy, world.sdf, pose)
    return voronoi_graph(topdown, pose.xy_m, CONFIG, SAFE_M), topdown


def nearest(graph, x, y):
    return int(np.argmin(np.linalg.norm(graph.vertex_xy_m - [x, y], axis=1)))


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_path_through_a_door_is_nearly_shortest():
    wall = [(4.2, 0.2, 4.3, 1.2), (4.2, 2.1, 4.3, 3.2)]
    pose = Pose2(1.0, 0.8, 0.0)
    graph, topdown = situation(room(8, 3, boxes=wall), pose)
    target = nearest(graph, 7.0, 2.6)
    path = shortest_paths(graph, topdown, pose, SAFE_M).path_to(target)
    # The shortest way rounds the door posts at the safe distance.
    through_door = math.dist((1.0, 0.8), (4.2, 1.45)) + math.dist((4.2, 1.45), graph.vertex_xy_m[target])
    assert np.allclose(path[0], pose.xy_m)
    assert np.allclose(path[-1], graph.vertex_xy_m[target])
    assert length(path) < through_door * 1.08
    assert segments_clear(topdown, path[:-1], path[1:], SAFE_M, pose).all()


def test_path_is_never_longer_than_along_the_graph():
    pose = Pose2(1.0, 0.8, 0.0)
    graph, topdown = situation(room(8, 3, boxes=[(3, 1, 3.5, 2)]), pose)
    paths = shortest_paths(graph, topdown, pose, SAFE_M)
    for vertex in range(0, len(graph.vertex_xy_m), 7):
        if np.isfinite(paths.distance_m[vertex]):
            assert length(paths.path_to(vertex)) <= paths.distance_m[vertex] + 1e-9


def test_edges_are_joined_between_their_vertices():
    # A graph of one edge through a narrow door, whose near end lies behind the robot.
    pose, safe_m = Pose2(2.5, 1.2, 0.0), 0.24
    _, topdown = situation(room(8, 3, boxes=[(4.2, 0.2, 4.3, 1.4), (4.2, 2.0, 4.3, 3.2)]), pose)
    ends_m = np.array([[1.0, 1.7], [6.0, 1.7]])
    graph = VoronoiGraph(ends_m, np.ones(2), np.array([[0, 1]]), np.array([5.0]))
    behind = shortest_paths(graph, topdown, pose, safe_m).path_to(1)
    joined = shortest_paths(graph, topdown, pose, safe_m, joins_edges=True).path_to(1)
    assert behind[1].tolist() == [1.0, 1.7]
    assert joined[:, 0].min() == pose.x_m
    assert np.allclose(joined[-1], ends_m[1])
    assert segments_clear(topdown, joined[:-1], joined[1:], safe_m, pose).all()


def test_no_path_leads_behind_a_closed_wall():
    pose = Pose2(1.0, 1.5, 0.0)
    graph, topdown = situation(room(8, 3, boxes=[(4.2, 0.2, 4.3, 3.2)]), pose)
    paths = shortest_paths(graph, topdown, pose, SAFE_M)
    behind = nearest(graph, 6.5, 1.7)
    assert not np.isfinite(paths.distance_m[behind])
    assert len(paths.path_to(behind)) == 0


def test_robot_in_a_tight_corner_finds_a_path():
    # 0.19 m from both walls: nearer than any planned way may lead, yet not touching.
    pose = Pose2(0.39, 0.39, 0.0)
    graph, topdown = situation(room(4, 3), pose)
    paths = shortest_paths(graph, topdown, pose, SAFE_M)
    assert np.isfinite(paths.distance_m).any()
    assert len(paths.path_to(nearest(graph, 2.2, 1.7))) >= 2


def test_segments_are_clear_over_their_whole_length():
    pose = Pose2(1.0, 1.5, 0.0)
    _, topdown = situation(room(4, 3, boxes=[(2.2, 1.5, 2.25, 1.55)]), pose)
    ends = np.array([[3.5, 1.5], [3.5, 2.8]])
    clear = segments_clear(topdown, np.array([[1.0, 1.5], [1.0, 2.8]]), ends, SAFE_M)
    assert clear.tolist() == [False, True]
    assert clearance_at(topdown, np.array([[99.0, 99.0]]))[0] == -np.inf


def test_path_steps_count_metres_and_turns():
    path = np.array([[0.0, 0.0], [0.65, 0.0], [0.65, 0.65]])
    assert path_steps(path, 0.0) == pytest.approx(10 + 9 + 10)
    assert path_steps(path, math.pi / 2) == pytest.approx(9 + 10 + 9 + 10)
    assert path_steps(path, 0.0, final_yaw_rad=math.pi) == pytest.approx(10 + 9 + 10 + 9)
    assert path_steps(np.zeros((0, 2)), 0.0, final_yaw_rad=math.radians(-30)) == pytest.approx(3)


def test_quantized_legs_have_headings_of_the_robot_and_are_hardly_longer():
    pose = Pose2(1.0, 1.0, 0.3)
    _, topdown = situation(room(8, 6), pose)
    straight = np.array([[1.0, 1.0], [6.0, 2.0], [7.0, 5.0]])
    path = quantize_headings(straight, topdown, SAFE_M, pose)
    legs = np.diff(path, axis=0)
    turns = (np.arctan2(legs[:, 1], legs[:, 0]) - pose.yaw_rad) / TURN_STEP_RAD
    assert np.allclose(turns, np.round(turns), atol=1e-6)
    assert all(np.isclose(path, corner).all(axis=1).any() for corner in straight)
    assert length(path) < 1.005 * length(straight)


def test_path_without_space_beside_it_is_not_quantized():
    pose = Pose2(0.7, 0.44, TURN_STEP_RAD / 2)
    _, topdown = situation(room(8, 0.5), pose)
    straight = np.array([[0.7, 0.44], [7.5, 0.46]])
    assert np.array_equal(quantize_headings(straight, topdown, SAFE_M, pose), straight)


def test_remaining_path_begins_at_the_robot():
    way = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    assert np.allclose(remaining_path(way, Pose2(1.0, 0.05, 0.0)), [[1.0, 0.05], [2.0, 0.0], [2.0, 2.0]])
    assert np.allclose(remaining_path(way, Pose2(2.0, 0.0, 0.0)), [[2.0, 0.0], [2.0, 2.0]])
