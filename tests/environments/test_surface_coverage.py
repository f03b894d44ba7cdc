"""New surface, frame by frame, against the evaluation's coverage."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.environments.surface_coverage import IncrementalCoverage, SampleGrid
from anm_mj.evaluation.completion import Coverage
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.reduced_depth import back_project_reduced, reduce_depth
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import CAMERA, observe, room_truth


def points(depth_m, intrinsics, T_world_camera):
    return back_project_reduced(reduce_depth(depth_m), intrinsics, T_world_camera)


def test_increments_match_the_coverage():
    truth = room_truth(20_000)
    coverage, covered = Coverage(truth.samples), IncrementalCoverage(SampleGrid(truth.samples))
    total = 0.0
    for i in range(8):
        observation = observe(i, Pose2(-1.0 + 0.2 * i, 0.3, math.radians(50.0 * i)))
        frame = (observation.intrinsics, observation.T_world_camera)
        new = covered.add(points(observation.depth_m, *frame))
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
    covered.add(points(observation.depth_m, observation.intrinsics, observation.T_world_camera))
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
        covered.add(points(depth_m, camera, T_world_camera))
        coverage.add(reduce_depth(depth_m), camera, T_world_camera)
        assert covered.fraction == pytest.approx(coverage.completion().ratio_percent / 100.0, abs=1e-12)
    assert covered.fraction > 0.01


def test_the_same_frame_again_is_worth_nothing():
    covered = IncrementalCoverage(SampleGrid(room_truth().samples))
    observation = observe(0, Pose2(0.0, 0.0, 0.0))
    frame = (observation.depth_m, observation.intrinsics, observation.T_world_camera)
    assert covered.add(points(*frame)) > 0.1
    assert covered.add(points(*frame)) == 0.0


def test_frames_without_coverage():
    covered = IncrementalCoverage(SampleGrid(room_truth().samples))
    nothing = np.full((CAMERA.height, CAMERA.width), np.nan, np.float32)
    far = np.eye(4)
    far[:3, 3] = 500.0
    assert covered.add(points(nothing, CAMERA, np.eye(4))) == 0.0
    assert covered.add(points(np.ones_like(nothing), CAMERA, far)) == 0.0
    assert covered.fraction == 0.0


@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([0.0, 0.06, 0.4, 3.0]), flat=st.booleans())
def test_covered_samples_are_those_of_all_pairs(seed: int, spread: float, flat: bool):
    random = np.random.default_rng(seed)
    # Whole centimetres: many distances are exactly 5 cm, and many samples lie on the borders of cells.
    samples = np.round(random.normal(0.0, spread, (int(random.integers(1, 800)), 3)) - 1.0, 2)
    if flat:
        samples[:, 2] = 0.5
    samples = samples.astype(np.float32)
    everywhere, covered = samples.astype(np.float64), np.zeros(len(samples), bool)
    coverage = IncrementalCoverage(SampleGrid(samples))
    for _ in range(4):
        points = np.round(random.normal(0.0, spread + 0.05, (int(random.integers(0, 200)), 3)) - 1.0, 2)
        points[random.random(len(points)) < 0.1] *= 1e3
        off = everywhere[:, None] - points[None]
        squared = off[:, :, 0] ** 2 + off[:, :, 1] ** 2 + off[:, :, 2] ** 2
        near = np.sqrt(squared.min(axis=1, initial=np.inf)) < COVERED_M
        assert coverage.add(points) == np.count_nonzero(near & ~covered) / len(samples)
        covered |= near
    assert coverage.add(everywhere) == np.count_nonzero(~covered) / len(samples)
    assert coverage.add(everywhere) == 0.0
    assert coverage.fraction == 1.0


def test_native_covering_refuses_arrays_that_do_not_fit():
    grid = SampleGrid(room_truth().samples)
    good = [np.zeros((1, 3)), grid.samples, grid.level, grid.column_start, grid.low_m, 0.1, 0.05]
    covered, near = np.zeros(len(grid.samples), np.uint8), grid.num_near.copy()
    _native.cover_samples(*good, covered, near)
    for place, wrong in ((0, np.zeros((1, 2))), (2, grid.level[:-1]), (3, grid.column_start[:-1]), (6, 0.2)):
        bad = list(good)
        bad[place] = wrong
        with pytest.raises(ValueError, match=r"coordinates|differ in size|one column|no smaller"):
            _native.cover_samples(*bad, covered, near)
