"""Keyframes that are adjusted: a way round in a room in closed form, a loop that is true, loops that are not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.localisation.frame_points import draw_points
from anm_mj.localisation.frame_to_images import FrameToImages, coarse_gray_at
from anm_mj.localisation.key_images import KeyImages
from anm_mj.localisation.keyframe_graph import Correction, KeyframeGraph
from anm_mj.localisation.localisation_config import GraphConfig, KeyImageConfig
from anm_mj.localisation.pose_graph import Edge
from anm_mj.localisation.registration import PLANAR, Prior
from anm_mj.localisation.se3 import moved_camera
from anm_mj.localisation.wall_directions import Headings
from anm_mj.types import Observation
from tests.mapping.ray_room import Room

CONFIG = GraphConfig(loops=True, loop_keyframes=20)
TURN = math.radians(12.0)
COUNT = 34
"""Keyframes of a turn on the spot and a little more."""
STEP_COVARIANCE = np.diag([1e-4, 1e-4, 1e-4])


def true_frames(room: Room) -> list[Observation]:
    return [room.observe(1.5, 1.5, TURN * k, size=96, step=k) for k in range(COUNT)]


def drift(step: int) -> np.ndarray:
    return np.array([0.002 * step, -0.001 * step, 0.0, 0.0, 0.0, 0.0005 * step])


def turn_about(
    config: GraphConfig, frames: list[Observation], headings: Headings | None = None
) -> tuple[KeyframeGraph, list[Correction]]:
    """The graph of a camera that turns about while its pose drifts, and what it corrected."""
    images = KeyImages(KeyImageConfig())
    graph = KeyframeGraph(config, images, PLANAR)
    corrections, offset, is_closed = [], np.eye(4), False
    for step, frame in enumerate(frames):
        T = moved_camera(frame.T_world_camera, drift(step)) if not is_closed else offset @ frame.T_world_camera
        placed = replace(frame, T_world_camera=T)
        motion = None
        if step:
            between = np.linalg.inv(frames[step - 1].T_world_camera) @ frame.T_world_camera
            motion = Prior(graph.poses[-1] @ between, STEP_COVARIANCE, PLANAR)
        images.add(placed, 0.0)
        points = draw_points(placed, 500, 0.0, 8.0, np.random.default_rng(step))
        gray = coarse_gray_at(images.images[-1], points)
        correction = graph.add(FrameToImages(images, [], points, gray, 0.0, 1.0), T, motion, headings)
        if correction is not None:
            corrections.append(correction)
            is_closed |= correction.closed
            offset = correction.T_world_camera[-1] @ np.linalg.inv(frame.T_world_camera)
    return graph, corrections


def pulled_back(config: GraphConfig, frames: list[Observation]) -> tuple[KeyframeGraph, list[Correction]]:
    """The graph of a camera whose pose drifts, until what it saw at first comes into view and pulls it back slowly."""
    images = KeyImages(KeyImageConfig())
    graph = KeyframeGraph(config, images, PLANAR)
    corrections = []
    for step, frame in enumerate(frames):
        share = float(np.clip((26 - step) / 8, 0.0, 1.0))
        T = moved_camera(frame.T_world_camera, share * drift(min(step, 18)))
        placed = replace(frame, T_world_camera=T)
        images.add(placed, 0.0)
        points = draw_points(placed, 500, 0.0, 8.0, np.random.default_rng(step))
        gray = coarse_gray_at(images.images[-1], points)
        motion = Prior(T, STEP_COVARIANCE, PLANAR) if step else None
        correction = graph.add(FrameToImages(images, [], points, gray, 0.0, 1.0), T, motion)
        if correction is not None:
            corrections.append(correction)
    return graph, corrections


def off_m(graph: KeyframeGraph, frames: list[Observation]) -> np.ndarray:
    true = np.array([frame.T_world_camera for frame in frames])
    return np.linalg.norm(graph.poses[:, :3, 3] - true[:, :3, 3], axis=1)


@pytest.fixture(scope="module")
def frames(room: Room) -> list[Observation]:
    return true_frames(room)


def test_a_place_that_is_seen_again_closes_a_loop(frames: list[Observation]) -> None:
    graph, corrections = turn_about(CONFIG, frames)
    closed = [correction for correction in corrections if correction.closed]
    assert len(closed) >= 1
    assert closed[0].nodes[0] == 1
    before = np.array([moved_camera(frame.T_world_camera, drift(step)) for step, frame in enumerate(frames)])
    moved = closed[0].T_world_camera - before[list(closed[0].nodes)]
    assert np.linalg.norm(moved[:, :3, 3], axis=1).max() > 0.03
    assert np.linalg.norm(drift(COUNT - 1)[:3]) > 0.07
    assert off_m(graph, frames).max() < 0.02
    # Images and poses go together.
    for image in graph._images.images:
        np.testing.assert_array_equal(image.T_world_camera, graph.poses[image.node])


def test_a_graph_of_one_image_a_keyframe_closes_loops_too(frames: list[Observation]) -> None:
    _, corrections = turn_about(replace(CONFIG, images=1), frames)
    assert any(correction.closed for correction in corrections)


def test_walls_that_are_far_off_forbid_no_loop(frames: list[Observation]) -> None:
    askew = Headings(frames[0].T_world_camera, (0.3,), (0.0005,), (10.0, 3.0))
    graph, corrections = turn_about(CONFIG, frames, askew)
    assert len(graph.headings) == COUNT - 1
    assert [correction.closed for correction in corrections] == [True]


def test_a_pose_that_was_pulled_back_corrects_the_way(frames: list[Observation]) -> None:
    graph, corrections = pulled_back(replace(CONFIG, loop_every=3), frames)
    assert [correction.closed for correction in corrections] == [True]
    assert off_m(graph, frames).max() < 0.015


def test_what_is_asked_for_too_rarely_corrects_nothing(frames: list[Observation]) -> None:
    graph, corrections = pulled_back(replace(CONFIG, loop_every=100), frames)
    assert not corrections
    # The last poses were right before, too.
    assert off_m(graph, frames)[18] > 0.035
    assert off_m(graph, frames)[26:].max() < 0.001


def test_without_loops_and_adjustment_nothing_moves(frames: list[Observation]) -> None:
    graph, corrections = turn_about(replace(CONFIG, loops=False), frames)
    assert not corrections
    assert off_m(graph, frames)[-1] > 0.07


def test_adjusting_the_latest_keyframes_takes_drift_away(frames: list[Observation]) -> None:
    graph, corrections = turn_about(replace(CONFIG, adjust=True, loops=False, window=10), frames)
    assert not any(correction.closed for correction in corrections)
    assert max(len(correction.nodes) for correction in corrections) == 10
    # What the window has left behind stays.
    assert np.median(off_m(graph, frames)[:20]) < 0.5 * np.median([np.linalg.norm(drift(k)[:3]) for k in range(20)])


def way(count: int = 30) -> KeyframeGraph:
    """A straight way of keyframes, each measured from the one before to a millimetre or two."""
    graph = KeyframeGraph(CONFIG, KeyImages(KeyImageConfig()), PLANAR)
    graph.poses = np.tile(np.eye(4), (count, 1, 1))
    graph.poses[:, 0, 3] = 0.1 * np.arange(count)
    graph.edges = [edge(graph, k, k + 1, 0.0) for k in range(count - 1)]
    return graph


def edge(graph: KeyframeGraph, first: int, second: int, error_m: float, information: float = 4e5) -> Edge:
    T = moved_camera(graph.poses[second], np.array([0.0, error_m, 0.0, 0.0, 0.0, 0.0]))
    return Edge(first, second, np.linalg.inv(graph.poses[first]) @ T, information * np.eye(6), 0.0)


def test_a_loop_that_the_way_does_not_allow_is_refused() -> None:
    graph = way()
    before = graph.edges
    for k in range(27, 30):
        # All say alike, and are wrong by a metre.
        assert not graph._take_loops([edge(graph, 0, k, 1.0)])
    assert graph.edges == before


def test_a_loop_needs_several_keyframes_that_say_alike() -> None:
    graph = way()
    small = [edge(graph, 0, k, 0.03, 1e4) for k in (27, 28, 29)]
    assert not graph._take_loops(small[:1])
    assert not graph._take_loops([])
    assert not graph._take_loops(small[1:2])
    assert not graph._take_loops([edge(graph, 0, 28, -0.08, 1e4)])
    assert not graph._take_loops(small[2:])
    assert len(graph.edges) == 29
    graph = way()
    assert [graph._take_loops([one]) for one in small] == [False, False, True]
    assert len(graph.edges) == 29 + len(small)


def test_walls_hold_the_headings_of_keyframes() -> None:
    """A row of keyframes that bends as it goes, measured from one to the next with that error."""
    bend, count = 0.002, 20
    observation = Room().observe(1.5, 1.5, 0.0, size=64)

    def graph_of(walls: bool) -> KeyframeGraph:
        images = KeyImages(KeyImageConfig())
        graph = KeyframeGraph(GraphConfig(adjust=True, window=count), images, PLANAR)
        T = observation.T_world_camera
        for step in range(count):
            straight = moved_camera(observation.T_world_camera, np.array([0.05 * step, 0.0, 0.0, 0.0, 0.0, 0.0]))
            images.add(replace(observation, T_world_camera=T), 0.0)
            points = draw_points(observation, 50, 0.0, 0.1, np.random.default_rng(step))
            compared = FrameToImages(images, [], points, coarse_gray_at(images.images[-1], points), 0.0, 1.0)
            headings = Headings(straight, (0.0,), (0.0005,), (10.0, 3.0)) if walls else None
            graph.add(compared, T, Prior(T, STEP_COVARIANCE, PLANAR) if step else None, headings)
            T = moved_camera(graph.poses[-1], np.array([0.05, 0.0, 0.0, 0.0, 0.0, bend]))
        return graph

    def last_heading(graph: KeyframeGraph) -> float:
        R = graph.poses[-1][:3, :3] @ observation.T_world_camera[:3, :3].T
        return abs(math.atan2(R[1, 0], R[0, 0]))

    assert last_heading(graph_of(walls=False)) > 0.9 * bend * (count - 1)
    assert last_heading(graph_of(walls=True)) < 1.5 * bend
