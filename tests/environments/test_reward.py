"""New surface, frame by frame, against the evaluation's coverage."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.environments.reward import IncrementalCoverage, SampleGrid, native_search, numpy_search
from anm_mj.evaluation.completion import COVERED_M, Coverage
from anm_mj.evaluation.depth import reduce_depth
from anm_mj.mapping.native_functions import native_function
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import CAMERA, observe, room_truth


def test_increments_match_the_coverage():
    truth = room_truth(20_000)
    coverage, covered = Coverage(truth.samples), IncrementalCoverage(SampleGrid(truth.samples))
    total = 0.0
    for i in range(8):
        observation = observe(i, Pose2(-1.0 + 0.2 * i, 0.3, math.radians(50.0 * i)))
        frame = (observation.intrinsics, observation.T_world_camera)
        new = covered.add(observation.depth_m, *frame)
        coverage.add(reduce_depth(observation.depth_m), *frame)
        total += new
        assert new >= 0.0
        assert covered.fraction == pytest.approx(total)
        assert covered.fraction == pytest.approx(coverage.completion().ratio_percent / 100.0, abs=1e-12)
    assert covered.fraction > 0.5


def test_observable_samples():
    truth = room_truth(20_000)
    observable = truth.samples[:, 2] > 1.0
    coverage, covered = Coverage(truth.samples, observable), IncrementalCoverage(SampleGrid(truth.samples[observable]))
    observation = observe(0, Pose2(0.0, 0.0, 0.4))
    covered.add(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    coverage.add(reduce_depth(observation.depth_m), observation.intrinsics, observation.T_world_camera)
    assert covered.fraction == pytest.approx(coverage.completion().observable_ratio_percent / 100.0, abs=1e-12)


def test_random_frames():
    random = np.random.default_rng(0)
    camera = Intrinsics.from_fov(64, 64, math.radians(90.0))
    samples = random.uniform(-3.0, 3.0, (20_000, 3)).astype(np.float32)
    coverage, covered = Coverage(samples), IncrementalCoverage(SampleGrid(samples))
    for _ in range(6):
        depth_m = random.uniform(0.1, 8.0, (64, 64)).astype(np.float32)
        rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
        T_world_camera[:3, 3] = random.uniform(-3.0, 3.0, 3)
        covered.add(depth_m, camera, T_world_camera)
        coverage.add(reduce_depth(depth_m), camera, T_world_camera)
        assert covered.fraction == pytest.approx(coverage.completion().ratio_percent / 100.0, abs=1e-12)
    assert covered.fraction > 0.01


def test_the_same_frame_again_is_worth_nothing():
    covered = IncrementalCoverage(SampleGrid(room_truth().samples))
    observation = observe(0, Pose2(0.0, 0.0, 0.0))
    frame = (observation.depth_m, observation.intrinsics, observation.T_world_camera)
    assert covered.add(*frame) > 0.1
    assert covered.add(*frame) == 0.0


def test_frames_without_coverage():
    covered = IncrementalCoverage(SampleGrid(room_truth().samples))
    nothing = np.full((CAMERA.height, CAMERA.width), np.nan, np.float32)
    far = np.eye(4)
    far[:3, 3] = 500.0
    assert covered.add(nothing, CAMERA, np.eye(4)) == 0.0
    assert covered.add(np.ones_like(nothing), CAMERA, far) == 0.0
    assert covered.fraction == 0.0


needs_native = pytest.mark.skipif(native_function("samples_within") is None, reason="the native engine was not built")


@needs_native
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(0, 60), st.integers(1, 300), st.sampled_from([0.1, 0.5, 3.0]))
def test_the_native_search_finds_what_the_tree_finds(seed, num_samples, num_points, size_m):
    rng = np.random.default_rng(seed)
    samples, points = rng.uniform(-size_m, size_m, (num_samples, 3)), rng.uniform(-size_m, size_m, (num_points, 3))
    which = rng.permutation(num_samples)[: num_samples // 2]
    assert np.array_equal(native_search(samples, which, points), numpy_search(samples, which, points))


@needs_native
@pytest.mark.parametrize("axis", range(3))
def test_at_the_radius_both_agree_to_the_last_bit(axis):
    at = np.array([[0.3, -0.7, 1.1]])
    beside = [at.copy() for _ in range(9)]
    for step, point in zip(range(-4, 5), beside, strict=True):
        point[0, axis] += COVERED_M
        for _ in range(abs(step)):
            point[0, axis] = np.nextafter(point[0, axis], np.inf * step)
    found = [len(native_search(at, np.zeros(1, np.int64), point)) for point in beside]
    assert found == [len(numpy_search(at, np.zeros(1, np.int64), point)) for point in beside]
    assert len(set(found)) == 2  # The radius lies between them.


@needs_native
def test_both_searches_cover_the_same_of_a_room():
    grid = SampleGrid(room_truth().samples)
    runs = [IncrementalCoverage(grid, search) for search in (numpy_search, native_search)]
    for yaw in (0.0, 0.9, 2.5):
        seen = observe(0, Pose2(0.3, 0.2, yaw))
        new = [run.add(seen.depth_m, seen.intrinsics, seen.T_world_camera) for run in runs]
        assert new[0] == new[1]
    assert runs[0].fraction == runs[1].fraction > 0.2
