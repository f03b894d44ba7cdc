import math

import numpy as np

from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.oracle.visibility import count, pack, unpack
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.types import Pose2
from tests.evaluation.oracle.ray_robot import RayRobot
from tests.ground_truth.test_observable import CAMERA


def test_bits_are_flags():
    flags = np.random.default_rng(3).random((5, 128)) < 0.3

    assert all(np.array_equal(unpack(bits), row) for bits, row in zip(pack(flags), flags, strict=True))
    assert np.array_equal(count(pack(flags)), flags.sum(axis=1))


def test_a_place_shows_what_its_frames_cover(rooms, views):
    truth, area = rooms
    roadmap, samples, bits = views
    place = int(roadmap.nearest(np.array([[-1.5, 0.2]]))[0])
    coverage = Coverage(samples)
    for aside_m in (-0.05, 0.0, 0.05):
        for k in range(NUM_HEADINGS):
            x_m, y_m = (roadmap.places_m[place] + aside_m).tolist()
            pose = Pose2(x_m, y_m, math.radians(10.0 * k))
            seen = RayRobot(truth, area, pose).observe()
            coverage.add(reduce_depth(seen.depth_m), CAMERA, seen.T_world_camera)

    promised = unpack(np.bitwise_or.reduce(bits[place], axis=0))

    covered = coverage.distance_m < COVERED_M
    assert 0.1 < covered.mean() < 0.9
    assert (promised == covered).mean() > 0.9


def test_views_at_right_angles_share_no_sample(views):
    _, _, bits = views
    yaws = np.stack([count(bits[:, k] & bits[:, (k + 10) % NUM_HEADINGS]) for k in range(NUM_HEADINGS)])

    assert count(bits).mean() > 10
    assert yaws.max() == 0
