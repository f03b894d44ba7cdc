import numpy as np
import pytest

from anm_mj.evaluation.completion import Coverage
from anm_mj.evaluation.oracle.residual_tour import exact_bits, select_places
from anm_mj.evaluation.oracle.roadmap import Roadmap
from anm_mj.evaluation.oracle.visibility import count, unpack
from anm_mj.frames import pose_matrix
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.ground_truth import COVERED_M
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.ground_truth.pixel_rays import PixelRays
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.types import TURN_STEP_RAD, Pose2
from anm_mj.utils.raycast import RayCaster
from tests.evaluation.oracle.ray_robot import cast_depth
from tests.ground_truth.test_observable import CAMERA, CAMERA_ON_BASE, T_BASE_CAMERA, box, joined

RNG_SEED = 5


@pytest.fixture(scope="module")
def room():
    """A room with a cabinet open to one side, its area, and samples on the cabinet's back wall inside."""
    vertices, faces = joined(
        box((-2.0, -2.0, 0.0), (2.0, 2.0, 2.5)),
        box((1.0, -0.60, 0.0), (1.6, -0.55, 1.0)),
        box((1.0, 0.55, 0.0), (1.6, 0.60, 1.0)),
        box((1.6, -0.60, 0.0), (1.65, 0.60, 1.0)),
        box((1.0, -0.60, 1.0), (1.65, 0.60, 1.05)),
    )
    reachable = np.zeros((80, 80), bool)
    reachable[6:74, 6:74] = True
    reachable[22:58, 54:] = False
    area = ReachableArea(reachable, np.array([-2.0, -2.0]), 0.05)
    rng = np.random.default_rng(RNG_SEED)
    inside = np.stack([np.full(90, 1.6), rng.uniform(-0.5, 0.5, 90), rng.uniform(0.05, 0.95, 90)], axis=1)
    hidden = np.stack([np.full(10, 3.0), np.zeros(10), np.ones(10)], axis=1)
    samples = np.concatenate([inside, hidden]).astype(np.float32)
    return area, samples, RayCaster(vertices, faces)


def covered_by_a_frame(samples, caster, x_m, y_m, yaw):
    T_world_camera = pose_matrix(Pose2(x_m, y_m, yaw * TURN_STEP_RAD)) @ T_BASE_CAMERA
    depth_m = cast_depth(caster, T_world_camera)
    coverage = Coverage(samples)
    coverage.add(reduce_depth(depth_m), CAMERA, T_world_camera)
    return coverage.distance_m < COVERED_M


def test_few_places_show_all_visible_samples(room):
    area, samples, caster = room
    rays = PixelRays(caster, CAMERA_ON_BASE)

    places_m = select_places(samples, area, rays)

    assert 1 <= len(places_m) < 40
    assert (area.cells(places_m.astype(np.float32)) >= 0).all()
    shown = np.bitwise_or.reduce(exact_bits(samples, places_m, rays).reshape(-1, 2), axis=0)
    assert unpack(shown)[:90].mean() > 0.95
    assert not unpack(shown)[90:].any()


def test_exact_bits_are_what_frames_cover(room):
    area, samples, caster = room
    rays = PixelRays(caster, CAMERA_ON_BASE)
    places_m = select_places(samples, area, rays)[:3]

    bits = exact_bits(samples, places_m, rays)

    promised, covered = 0, 0
    for place, (x_m, y_m) in enumerate(places_m.tolist()):
        for yaw in range(NUM_HEADINGS):
            frame = covered_by_a_frame(samples, caster, x_m, y_m, yaw)
            flags = unpack(bits[place, yaw])[: len(samples)]
            assert not (flags & ~frame).any()
            promised += int(flags.sum())
            covered += int(frame.sum())
    assert promised > 0.9 * covered > 0


def test_invisible_samples_select_no_places(room):
    area, samples, caster = room

    assert select_places(samples[90:], area, PixelRays(caster, CAMERA_ON_BASE)).shape == (0, 2)


def test_selected_places_are_deterministic(room):
    area, samples, caster = room
    rays = PixelRays(caster, CAMERA_ON_BASE)

    assert np.array_equal(select_places(samples, area, rays), select_places(samples, area, rays))


def test_a_roadmap_reaches_further_places(room):
    area, samples, caster = room
    more_m = select_places(samples, area, PixelRays(caster, CAMERA_ON_BASE))

    roadmap = Roadmap(area, 0.25, more_m)

    assert len(roadmap.places_m) == len(Roadmap(area, 0.25).places_m) + len(more_m)
    assert np.linalg.norm(roadmap.places_m[roadmap.nearest(more_m)] - more_m, axis=1).max() < 0.06
    assert np.isfinite(roadmap.distance_m).all()
    assert int(count(exact_bits(samples, roadmap.places_m, PixelRays(caster, CAMERA_ON_BASE))).max()) > 10
