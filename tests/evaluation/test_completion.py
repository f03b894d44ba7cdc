import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from anm_mj.evaluation.completion import Coverage, uncapped_completion_cm
from anm_mj.ground_truth.reduced_depth import back_project_reduced, reduce_depth
from anm_mj.types import Pose2
from tests.box_room import CAMERA, camera_pose, room_depth, room_truth


def slow_distance(samples, clouds):
    """The paper's script in three lines: a tree per frame, all samples, running minimum."""
    nearest = np.full(len(samples), np.inf)
    for cloud in clouds:
        if len(cloud):
            nearest = np.minimum(nearest, KDTree(cloud).query(samples.astype(np.float64))[0])
    return nearest


def room_frames(num_frames):
    poses = [Pose2(0.05 * k, 0.3 * np.sin(k), 0.4 * k) for k in range(num_frames)]
    for pose in poses:
        T_world_camera = camera_pose(pose)
        yield reduce_depth(room_depth(T_world_camera)), T_world_camera


def test_numbers_equal_the_obvious_implementation_to_the_last_digit():
    truth = room_truth(4_000)
    coverage = Coverage(truth.samples)
    slow = np.full(len(truth.samples), np.inf)
    for count, (depth_mm, T_world_camera) in enumerate(room_frames(13), start=1):
        coverage.add(depth_mm, CAMERA, T_world_camera)
        cloud = back_project_reduced(depth_mm, CAMERA, T_world_camera)
        slow = np.minimum(slow, slow_distance(truth.samples, [cloud]))
        if count in (1, 4, 13):
            now = coverage.completion()
            assert now.ratio_percent == 100.0 * np.mean(slow < 0.05)
            assert now.completion_cm == 100.0 * np.mean(np.minimum(slow, 1.0))
            assert np.array_equal(coverage.distance_m, np.where(slow < 1.0, slow, np.inf))
    # Far from trivial: some covered, some not, some beyond the cap.
    assert 5.0 < now.ratio_percent < 99.0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=1, max_size=25))
def test_scattered_clouds_and_any_checkpoints_give_the_same_distances(seed, checkpoints):
    rng = np.random.default_rng(seed)
    samples = rng.uniform(-1.5, 1.5, (400, 3)).astype(np.float32)
    # Beyond the samples' box too, where the pruning grid has no cells.
    clouds = [rng.uniform(-4.0, 4.0, (rng.integers(0, 60), 3)) for _ in checkpoints]
    coverage = Coverage(samples)
    for cloud, ask in zip(clouds, checkpoints, strict=True):
        coverage.add_points(cloud)
        if ask:
            coverage.completion()
    slow = slow_distance(samples, clouds)
    assert np.array_equal(coverage.distance_m, np.where(slow < 1.0, slow, np.inf))
    uncapped = uncapped_completion_cm(samples, coverage.distance_m, iter(clouds))
    assert uncapped == (None if np.isinf(slow).any() else 100.0 * float(np.mean(slow)))


def test_nothing_seen_is_nothing_complete():
    coverage = Coverage(room_truth(100).samples)
    assert coverage.completion().ratio_percent == 0.0
    assert coverage.completion().completion_cm == 100.0
    assert uncapped_completion_cm(room_truth(100).samples, coverage.distance_m, iter([])) is None


def test_samples_that_were_hit_are_complete():
    samples = room_truth(500).samples
    coverage = Coverage(samples)
    coverage.add_points(samples.astype(np.float64))
    assert coverage.completion().ratio_percent == 100.0
    assert coverage.completion().completion_cm == 0.0


def test_five_centimetres_themselves_do_not_count_as_covered():
    samples = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=np.float32)
    coverage = Coverage(samples)
    coverage.add_points(np.array([[0.0, 0.0, 0.05], [1.0, 0.0, 0.0499]]))
    assert coverage.completion().ratio_percent == 50.0
    assert coverage.completion().completion_cm == pytest.approx((5.0 + 4.99) / 2.0)


def test_observable_ratio_counts_observable_samples_only():
    samples = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], dtype=np.float32)
    coverage = Coverage(samples, np.array([True, False, True]))
    coverage.add_points(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert coverage.completion().observable_ratio_percent == 50.0
    assert coverage.completion().ratio_percent == pytest.approx(200.0 / 3.0)
