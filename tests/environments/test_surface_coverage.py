"""New surface, frame by frame, against the evaluation's coverage."""

import math

import numpy as np
import pytest

from anm_mj.environments.surface_coverage import IncrementalCoverage, SampleGrid
from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.depth import reduce_depth
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
