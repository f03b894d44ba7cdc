"""Tracking, losing and finding a camera in a room with a closed form."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from anm_mj.localisation.field_localiser import FieldLocaliser
from anm_mj.localisation.keyframe_graph import KeyframeGraph
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.localiser import Localiser, PoseEstimate, TrackingState
from anm_mj.localisation.map_probe import Agreement
from anm_mj.localisation.tracking import Tracked, Verdict
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import Observation, Pose2
from tests.mapping.ray_room import CAMERA_HEIGHT_M, Room, camera_pose

CONFIG = LocalisationConfig()
TURN = math.radians(10.0)


def walk(room: Room, count: int) -> list[Observation]:
    """A turn on the spot with a little forward motion."""
    return [room.observe(1.5 + 0.01 * k, 1.5, TURN * k, size=96, step=k) for k in range(count)]


def with_pose(observation: Observation, x: float, y: float, yaw: float) -> Observation:
    return replace(observation, T_world_camera=camera_pose(x, y, CAMERA_HEIGHT_M, yaw), pose=Pose2(x, y, yaw))


def drifting(frames: list[Observation]) -> list[Observation]:
    """The same by an odometry that turns 8 % too little and slips 2 mm a step to the side."""
    return [
        with_pose(frame, frame.pose.x_m, frame.pose.y_m + 0.002 * k, 0.92 * TURN * k) for k, frame in enumerate(frames)
    ]


def track(
    localiser: FieldLocaliser, neural_map: NeuralMap, frames: list[Observation], *, learn: bool = True
) -> list[PoseEstimate]:
    estimates = []
    for frame in frames:
        estimate = localiser.localise(frame)
        if learn and estimate.usable:
            localiser.integrate(estimate)
        estimates.append(estimate)
    return estimates


def offsets(estimates: list[PoseEstimate], frames: list[Observation]) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and turn [rad] between estimated and true poses."""
    pairs = [
        (estimate.observation.T_world_camera, frame.T_world_camera)
        for estimate, frame in zip(estimates, frames, strict=True)
    ]
    apart = np.array([np.linalg.norm(found[:3, 3] - true[:3, 3]) for found, true in pairs])
    turned = [
        np.arccos(np.clip((np.trace(found[:3, :3].T @ true[:3, :3]) - 1.0) / 2.0, -1, 1)) for found, true in pairs
    ]
    return apart, np.array(turned)


@pytest.fixture(scope="module")
def tracked(tiny_config: MappingConfig, room: Room) -> tuple[list[Observation], list[PoseEstimate], NeuralMap]:
    frames = walk(room, 30)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    return frames, track(localiser, neural_map, drifting(frames)), neural_map


@pytest.mark.parametrize("planar", [True, False])
def test_a_first_pose_that_was_estimated_is_no_better_than_it_says(tracked, planar: bool) -> None:
    frames, _, neural_map = tracked

    def first(**deviations: float) -> PoseEstimate:
        localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=planar, odometry=False)
        return localiser.localise(replace(frames[0], **deviations))

    told = first(position_deviation_m=0.03, heading_deviation_rad=0.02)
    assert told.position_deviation_m == pytest.approx(0.03)
    assert told.rotation_deviation_rad == pytest.approx(0.02)
    assert first().position_deviation_m == pytest.approx(1e-4)


def test_drift_is_taken_away(tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap]) -> None:
    frames, estimates, _ = tracked
    apart, turned = offsets(estimates, frames)
    drift = offsets([replace(e, observation=f) for e, f in zip(estimates, drifting(frames), strict=True)], frames)
    assert drift[1][-1] > math.radians(20.0)
    assert apart.max() < 0.03
    assert turned.max() < math.radians(0.8)
    assert all(estimate.usable and estimate.state is TrackingState.TRACKING for estimate in estimates)


@pytest.mark.parametrize(("turned_deg", "forward_m"), [(20.0, 0.0), (-17.0, -0.05), (0.0, 0.12), (25.0, 0.08)])
def test_wheels_may_slip_once(tiny_config: MappingConfig, room: Room, turned_deg: float, forward_m: float) -> None:
    """Odometry is wrong by far more than it usually is, in one step: beside an obstacle wheels spin."""
    frames, slip = walk(room, 20), math.radians(turned_deg)
    told = drifting(frames)
    for k in range(12, 20):
        x, y, yaw = (getattr(told[k].pose, name) for name in ("x_m", "y_m", "yaw_rad"))
        told[k] = with_pose(told[k], x + forward_m, y, yaw + slip)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    estimates = track(localiser, neural_map, told)
    apart, turned = offsets(estimates, frames)
    assert apart.max() < 0.03
    assert turned.max() < math.radians(0.8)
    assert all(estimate.usable for estimate in estimates)


def test_base_and_camera_go_together(tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap]) -> None:
    for estimate in tracked[1]:
        pose = estimate.observation.pose
        expected = camera_pose(pose.x_m, pose.y_m, CAMERA_HEIGHT_M, pose.yaw_rad)
        np.testing.assert_allclose(estimate.observation.T_world_camera, expected, atol=1e-9)


def test_one_seed_gives_the_same_bytes(
    tiny_config: MappingConfig, room: Room, tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap]
) -> None:
    frames = drifting(walk(room, 6))
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    again = track(FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True), neural_map, frames)
    for one, other in zip(again, tracked[1], strict=False):
        np.testing.assert_array_equal(one.observation.T_world_camera, other.observation.T_world_camera)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_free_camera_is_tracked_without_odometry(tiny_config: MappingConfig, room: Room) -> None:
    frames = [room.observe(1.5 + 0.02 * k, 1.5, 0.05 * k, size=96, step=k) for k in range(12)]
    unknown = [with_pose(frame, 1.5, 1.5, 0.0) for frame in frames]
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False)
    apart, turned = offsets(track(localiser, neural_map, unknown), frames)
    assert apart.max() < 0.03
    assert turned.max() < math.radians(1.0)


def test_a_free_camera_that_turns_by_fits_and_starts_is_tracked_in_a_map_without_odometry(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room
) -> None:
    _, _, neural_map = tracked
    # Stands, turns, turns back, turns again: no motion goes on as the one before.
    turns = [0, 0, 1, 2, 3, 2, 1, 0, 0, 1, 0, 1, 2]
    frames = [room.observe(1.6, 1.5, TURN * k, size=96, step=step) for step, k in enumerate(turns)]
    unknown = [frames[0], *(with_pose(frame, 1.6, 1.5, 0.0) for frame in frames[1:])]
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False)
    estimates = track(localiser, neural_map, unknown, learn=False)
    assert all(estimate.usable for estimate in estimates)
    apart, turned = offsets(estimates, frames)
    assert apart.max() < 0.03
    assert turned.max() < math.radians(1.0)


def without_depth(frame: Observation) -> Observation:
    return replace(frame, depth_m=np.full_like(frame.depth_m, np.nan))


def swaying(room: Room, count: int) -> list[Observation]:
    """A camera in the hand that goes on steadily, and has no odometry."""
    return [room.observe(1.5 + 0.01 * k, 1.5, 0.03 * k, size=96, step=k) for k in range(count)]


def of_nowhere(frames: list[Observation]) -> list[Observation]:
    """The same, all with the pose of the first."""
    return [with_pose(frame, 1.5, 1.5, 0.0) for frame in frames]


def test_a_free_camera_that_sees_nothing_is_held_in_growing_doubt_and_then_lost(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room
) -> None:
    _, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False)
    frames = swaying(room, 26)
    seen = track(localiser, neural_map, of_nowhere(frames[:6]), learn=False)
    assert not any(estimate.guessed for estimate in seen)
    blind = track(localiser, neural_map, [without_depth(frame) for frame in of_nowhere(frames[6:])], learn=False)
    last = seen[-1].observation.T_world_camera
    for estimate in blind:
        np.testing.assert_array_equal(estimate.observation.T_world_camera, last)
        assert estimate.guessed
        assert not estimate.usable
    # A lasting error of the velocity: twice the time, twice the deviation.
    deviations = np.array([(each.position_deviation_m, each.rotation_deviation_rad) for each in blind])
    np.testing.assert_allclose(deviations[19] / deviations[9], 2.0, rtol=0.05)
    apart, turned = offsets(blind, frames[6:])
    assert (apart < deviations[:, 0]).all()
    assert (turned < deviations[:, 1]).all()
    assert blind[0].state is TrackingState.TRACKING
    lost = [k for k, estimate in enumerate(blind) if estimate.state is TrackingState.LOST]
    assert lost[0] <= 3 + CONFIG.tracking.lost_frames
    assert lost[-1] == 19


@pytest.mark.parametrize("turn", [0.03, TURN])
def test_a_free_camera_goes_on_after_a_few_frames_without_depth(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room, turn: float
) -> None:
    _, _, neural_map = tracked
    frames = [room.observe(1.5 + 0.01 * k, 1.5, turn * k, size=96, step=k) for k in range(14)]
    told = [without_depth(frame) if k in (6, 7) else frame for k, frame in enumerate(of_nowhere(frames))]
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False)
    estimates = track(localiser, neural_map, told, learn=False)
    assert [k for k, estimate in enumerate(estimates) if not estimate.usable] == [6, 7]
    apart, turned = offsets(estimates[8:], frames[8:])
    assert apart.max() < 0.03
    assert turned.max() < math.radians(1.0)


def test_a_free_camera_that_was_blind_for_long_is_found_in_the_map(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room
) -> None:
    _, _, neural_map = tracked
    frames = [room.observe(1.5, 1.5, 0.03 * min(k, 6), size=96, step=k) for k in range(40)]
    # It turns while it sees nothing.
    frames[25:] = [room.observe(1.5, 1.4, 2.0 + 0.1 * k, size=96, step=25 + k) for k in range(15)]
    told = [without_depth(frame) if 6 <= k < 25 else frame for k, frame in enumerate(of_nowhere(frames))]
    # Of the map's own camera another height is known: that of this one is the one from before it was lost.
    low = camera_pose(0.0, 0.0, 0.4, 0.0)
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False, tilts=(low,))
    estimates = track(localiser, neural_map, told, learn=False)
    assert estimates[24].state is TrackingState.LOST
    assert estimates[-1].usable
    apart, turned = offsets(estimates[-1:], frames[-1:])
    assert apart[0] < 0.03
    assert turned[0] < math.radians(1.0)


@pytest.mark.parametrize("first", [Verdict.UNKNOWN, Verdict.CONTRADICTS])
def test_a_free_camera_before_unknown_space_is_lost_once_no_image_follows_it(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap],
    room: Room,
    monkeypatch: pytest.MonkeyPatch,
    first: Verdict,
) -> None:
    _, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=False, odometry=False)
    frames = swaying(room, 26)
    seen = track(localiser, neural_map, of_nowhere(frames[:6]), learn=False)
    verdicts, true_track = iter([first]), localiser._tracker.track

    def not_found(*arguments: Any, **options: Any) -> Tracked:
        tracked = true_track(*arguments, **options)
        return replace(tracked, verdict=next(verdicts, Verdict.UNKNOWN), prior=tracked.expected, is_followed=False)

    monkeypatch.setattr(localiser._tracker, "track", not_found)
    monkeypatch.setattr(localiser._image_odometry, "follow", lambda *_, **__: None)
    monkeypatch.setattr(localiser._relocaliser, "look", lambda *_: None)
    estimates = track(localiser, neural_map, of_nowhere(frames[6:]), learn=False)
    for estimate in estimates:
        np.testing.assert_array_equal(estimate.observation.T_world_camera, seen[-1].observation.T_world_camera)
    assert estimates[9].state is TrackingState.LOST


def test_a_blind_frame_keeps_the_prior_and_its_doubt(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room
) -> None:
    frames, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    first, second = frames[:2]
    localiser.localise(first)
    blind = replace(second, depth_m=np.full_like(second.depth_m, np.nan))
    before = localiser.localise(first)
    after = localiser.localise(blind)
    np.testing.assert_allclose(after.observation.pose.yaw_rad - before.observation.pose.yaw_rad, TURN, atol=1e-6)
    assert after.rotation_deviation_rad > before.rotation_deviation_rad
    assert after.quality.bound == 0


def test_a_run_that_begins_blind_closes_loops_as_others_do(tiny_config: MappingConfig, room: Room) -> None:
    first, *seen = walk(room, 4)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    config = replace(CONFIG, tracking=replace(CONFIG.tracking, fresh_keyframe_every=2))
    localiser = FieldLocaliser(neural_map, config, seed=0, planar=True, odometry=True)
    blind = replace(first, depth_m=np.full_like(first.depth_m, np.nan))
    localiser.integrate(localiser.localise(blind))
    track(localiser, neural_map, seen)
    assert len(localiser._graph.poses) == len(neural_map.field.keyframes) == 2


def test_small_corrections_add_up_until_the_map_is_built_again(
    tiny_config: MappingConfig, room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each new keyframe moves all others but the first by 1 cm."""
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    config = replace(CONFIG, graph=replace(CONFIG.graph, adjust=True, loops=False, rebuild_m=0.025))
    localiser = FieldLocaliser(neural_map, config, seed=0, planar=True, odometry=True)
    built = []
    monkeypatch.setattr(neural_map, "rebuild", lambda frames, iterations, moved: built.append(moved))

    def nudged(graph: KeyframeGraph, edges: object, **options: object) -> np.ndarray:
        poses = graph.poses.copy()
        poses[1:, 0, 3] += 0.01
        return poses

    monkeypatch.setattr(KeyframeGraph, "_optimised", nudged)
    track(localiser, neural_map, walk(room, 8))
    assert len(built) >= 1
    before, after = built[0]
    # Of all keyframes, so that what lies about the first one stays.
    np.testing.assert_array_equal(before[0], after[0])
    np.testing.assert_allclose(after[1, 0, 3] - before[1, 0, 3], 0.03, atol=1e-6)


def test_a_frame_that_shows_no_wall_has_no_heading_of_an_earlier_one(tiny_config: MappingConfig, room: Room) -> None:
    frames = walk(room, 8)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    seen = drifting(frames)
    track(localiser, neural_map, seen[:7])
    assert localiser._graph.headings
    num_headings = len(localiser._graph.headings)
    blind = replace(seen[7], depth_m=np.full_like(seen[7].depth_m, np.nan))
    estimate = localiser.localise(blind)
    assert estimate.usable
    localiser.integrate(estimate)
    assert len(localiser._graph.headings) == num_headings


def test_the_stated_covariance_holds_that_of_the_map(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap],
) -> None:
    _, estimates, _ = tracked
    within = np.array([estimate.observation.position_deviation_m for estimate in estimates])
    stated = np.array([estimate.position_deviation_m for estimate in estimates])
    assert (stated >= within).all()
    assert (stated[10:] > within[10:]).all()


def test_a_map_that_stands_still_adds_no_doubt_with_every_frame(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap],
) -> None:
    frames, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    estimates = track(localiser, neural_map, frames[:25], learn=False)
    stated = np.array([estimate.position_deviation_m for estimate in estimates])
    assert stated[20:].max() < 1.5 * stated[3:8].max()


@pytest.mark.parametrize("slipped", [0.0, math.radians(8.0)])
def test_an_odometry_that_errs_once_by_far_is_overruled_by_images(
    tiny_config: MappingConfig, room: Room, slipped: float
) -> None:
    frames = walk(room, 20)
    neural_map = NeuralMap(tiny_config, seed=0, device="cpu")
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    track(localiser, neural_map, frames[:14])
    # From now on odometry is off by one slip.
    after = [with_pose(f, f.pose.x_m, f.pose.y_m, f.pose.yaw_rad - slipped) for f in frames[14:]]
    estimates = track(localiser, neural_map, after)
    assert all(estimate.usable for estimate in estimates)
    _, turned = offsets(estimates, frames[14:])
    assert turned.max() < math.radians(1.5)


def test_images_follow_a_camera_where_the_map_is_wrong(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True)
    track(localiser, neural_map, frames[:5], learn=False)
    wrong = Agreement(np.zeros(1, bool), np.ones(1, bool))
    with monkeypatch.context() as patch:
        patch.setattr(localiser._probe, "agreement", lambda *_: wrong)
        # Odometry errs by 6 degrees in the first of these turns, and by 2 in each of the others.
        seen = [
            with_pose(f, f.pose.x_m, f.pose.y_m, f.pose.yaw_rad - math.radians(6.0 + 2.0 * k))
            for k, f in enumerate(frames[5:12])
        ]
        estimates = track(localiser, neural_map, seen, learn=False)
    apart, turned = offsets(estimates, frames[5:12])
    assert apart.max() < 0.03
    assert turned.max() < math.radians(1.0)
    assert not any(estimate.usable for estimate in estimates)
    assert estimates[-1].state is TrackingState.LOST
    # Where the map is right again it is found, without a rotation.
    after = [with_pose(f, f.pose.x_m, f.pose.y_m, f.pose.yaw_rad - math.radians(20.0)) for f in frames[12:20]]
    found = track(localiser, neural_map, after, learn=False)
    assert found[-1].usable
    assert offsets(found[-1:], frames[19:20])[0].max() < 0.03


@pytest.mark.parametrize("num_images", [CONFIG.key_images.num_images, 0])
def test_a_kidnapped_camera_is_noticed_and_found(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room, num_images: int
) -> None:
    frames, _, neural_map = tracked
    config = replace(CONFIG, key_images=replace(CONFIG.key_images, num_images=num_images))
    localiser = FieldLocaliser(neural_map, config, seed=0, planar=True, odometry=True)
    track(localiser, neural_map, frames[:3], learn=False)
    # Carried 0.7 m away and turned by 90 degrees; odometry goes on as if nothing had happened.
    there = [room.observe(1.0, 1.0, math.pi / 2 + TURN * k, size=96, step=k) for k in range(30)]
    believed = [with_pose(frame, 1.52, 1.5, TURN * (3 + k)) for k, frame in enumerate(there)]
    estimates = track(localiser, neural_map, believed, learn=False)
    lost = [k for k, estimate in enumerate(estimates) if estimate.state is TrackingState.LOST]
    assert lost
    assert lost[0] <= CONFIG.tracking.lost_frames
    assert not any(estimates[k].usable for k in range(lost[-1] + 1))
    found = [k for k, estimate in enumerate(estimates) if estimate.relocalised]
    assert len(found) == 1
    apart, turned = offsets(estimates[found[0] :], there[found[0] :])
    assert apart.max() < 0.06
    assert turned.max() < math.radians(2.0)


def test_it_is_found_in_a_saved_map(
    tracked: tuple[list[Observation], list[PoseEstimate], NeuralMap], room: Room
) -> None:
    frames, _, neural_map = tracked
    localiser = FieldLocaliser(neural_map, CONFIG, seed=0, planar=True, odometry=True, lost=True)
    assert isinstance(localiser, Localiser)
    unknown = [with_pose(frame, -3.0, 2.0, 1.0 + TURN * k) for k, frame in enumerate(frames)]
    estimates = track(localiser, neural_map, unknown, learn=False)
    assert estimates[0].state is TrackingState.LOST
    assert not estimates[0].usable
    apart, _ = offsets(estimates[-1:], frames[-1:])
    assert estimates[-1].state is TrackingState.TRACKING
    assert apart[0] < 0.06
