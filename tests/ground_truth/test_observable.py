import math

import numpy as np
import pytest

from anm_mj.evaluation.completion import Coverage
from anm_mj.frames import pixel_directions, pose_matrix
from anm_mj.ground_truth.ground_truth import COVERED_M, sample_triangles
from anm_mj.ground_truth.observable import ReachableArea, observable_samples
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics, PixelRays
from anm_mj.ground_truth.reduced_depth import back_project_reduced, reduce_depth
from anm_mj.types import Intrinsics, Pose2
from anm_mj.utils.raycast import RayCaster

CAMERA = Intrinsics.from_fov(32, 32, math.pi / 2.0)
T_BASE_CAMERA = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.25], [0.0, 0.0, 0.0, 1.0]])
CAMERA_ON_BASE = CameraExtrinsics(CAMERA, T_BASE_CAMERA)


def sample_surface(vertices, faces, num_samples):
    return sample_triangles(vertices, faces, num_samples, seed=0)[0].astype(np.float32)


def box(low, high):
    """Vertices and faces of an axis-aligned box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [[a, b, c] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    return np.asarray(low) + corners * (np.asarray(high) - low), np.array(faces)


def joined(*boxes):
    vertices = np.concatenate([v for v, _ in boxes]).astype(np.float32)
    starts = np.cumsum([0] + [len(v) for v, _ in boxes[:-1]])
    return vertices, np.concatenate([f + s for (_, f), s in zip(boxes, starts, strict=True)]).astype(np.int32)


@pytest.fixture(scope="module")
def world():
    """A room with a cupboard, a thin sheet, a box within a box, and something outside that nobody sees."""
    vertices, faces = joined(
        box((-2.0, -1.5, 0.0), (2.0, 1.5, 2.5)),
        box((0.8, -1.5, 0.0), (1.6, -0.9, 1.6)),
        box((1.0, -1.4, 0.2), (1.4, -1.0, 1.2)),
        box((-1.2, 0.6, 0.4), (-0.4, 0.63, 1.0)),
        box((3.0, 0.0, 0.0), (3.5, 0.5, 1.0)),
    )
    # Two parts of the floor; the robot gets to one of them.
    reachable = np.zeros((5, 7), bool)
    reachable[1:4, 1:4] = True
    floor = ReachableArea(reachable, np.array([-1.75, -1.25]), 0.5)
    return vertices, faces, floor


def slow_depth(vertices, faces, T_world_camera):
    """Planar depth by testing every ray with every triangle (Möller and Trumbore, 1997)."""
    origin = T_world_camera[:3, 3]
    rays = pixel_directions(CAMERA).reshape(-1, 3) @ T_world_camera[:3, :3].T
    depth = np.full(len(rays), np.nan)
    for a, b, c in vertices[faces].astype(float):
        normal = np.cross(rays, c - a)
        det = normal @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = normal @ (origin - a) / det
            across = np.cross(origin - a, b - a)
            v = rays @ across / det
            t = (c - a) @ across / det
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0.0)
        depth = np.where(hit, np.fmin(depth, t), depth)
    return depth.reshape(CAMERA.height, CAMERA.width).astype(np.float32)


@pytest.fixture(scope="module")
def slowly_covered(world):
    """Which samples the frames from every place at every yaw cover: the definition, taken at its word."""
    vertices, faces, floor = world
    samples = sample_surface(vertices, faces, 4_000)
    coverage = Coverage(samples)
    for x, y in floor.centres(np.flatnonzero(floor.reachable.ravel()).astype(np.int32)):
        for k in range(36):
            T_world_camera = pose_matrix(Pose2(float(x), float(y), math.radians(10.0 * k))) @ T_BASE_CAMERA
            depth_mm = reduce_depth(slow_depth(vertices, faces, T_world_camera))
            coverage.add(depth_mm, CAMERA, T_world_camera)
    return samples, coverage.distance_m < COVERED_M


def test_what_every_pose_covers_is_found_and_nothing_else(world, slowly_covered):
    vertices, faces, floor = world
    samples, covered = slowly_covered

    found = observable_samples(samples, RayCaster(vertices, faces), floor, CAMERA_ON_BASE)

    assert 0.3 < covered.mean() < 0.9
    assert np.count_nonzero(found & ~covered) == 0
    assert np.count_nonzero(covered & ~found) < 0.02 * covered.sum()


def test_the_same_call_gives_the_same_samples(world):
    vertices, faces, floor = world
    samples = sample_surface(vertices, faces, 500)
    caster = RayCaster(vertices, faces)

    first = observable_samples(samples, caster, floor, CAMERA_ON_BASE)

    assert np.array_equal(first, observable_samples(samples, caster, floor, CAMERA_ON_BASE))


def test_progress_is_told_and_ends_at_the_whole(world):
    vertices, faces, floor = world
    told = []

    observable_samples(
        sample_surface(vertices, faces, 100),
        RayCaster(vertices, faces),
        floor,
        CAMERA_ON_BASE,
        lambda a, b: told.append((a, b)),
    )

    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1][0] == told[-1][1]


def test_without_floor_nothing_can_be_seen(world):
    vertices, faces, floor = world
    nowhere = ReachableArea(np.zeros_like(floor.reachable), floor.origin_xy_m, floor.resolution_m)

    assert not observable_samples(
        sample_surface(vertices, faces, 100), RayCaster(vertices, faces), nowhere, CAMERA_ON_BASE
    ).any()


def test_a_cell_and_its_centre_belong_together():
    floor = ReachableArea(np.array([[True, False, True], [True, True, True]]), np.array([-1.0, 2.0]), 0.5)
    cells = np.flatnonzero(floor.reachable.ravel()).astype(np.int32)

    centres = floor.centres(cells)

    assert np.array_equal(floor.cells(centres), cells)
    assert centres[0] == pytest.approx([-0.75, 2.25])
    outside = np.array([[-1.1, 2.2], [0.6, 2.2], [-0.25, 2.25], [-0.9, 3.1]], np.float32)
    assert (floor.cells(outside) == -1).all()


def test_a_pixel_hits_what_a_frame_of_the_same_pose_shows(world):
    vertices, faces, _ = world
    rays = PixelRays(RayCaster(vertices, faces), CAMERA_ON_BASE)
    rng = np.random.default_rng(3)
    targets = rng.uniform((-2.0, -1.5, 0.0), (2.0, 1.5, 2.5), (40, 3)).astype(np.float32)
    place, k = np.array([-0.5, -0.25], np.float32), 7
    T_world_camera = pose_matrix(Pose2(-0.5, -0.25, math.radians(70.0))) @ T_BASE_CAMERA
    seen = back_project_reduced(reduce_depth(slow_depth(vertices, faces, T_world_camera)), CAMERA, T_world_camera)

    hits = rays.hits(targets, np.tile(place, (40, 1)), np.full(40, k))

    ahead = np.isfinite(hits[:, 0])
    assert 10 < ahead.sum() < 40
    distance = np.linalg.norm(hits[ahead, None] - seen[None], axis=2).min(axis=1)
    assert distance.max() < 1e-3


def test_the_camera_turns_towards_what_it_is_told(world):
    vertices, faces, _ = world
    rays = PixelRays(RayCaster(vertices, faces), CAMERA_ON_BASE)
    delta = np.array([[1.0, 0.0], [0.0, 2.0], [-1.0, 0.0], [0.0, -1.0]], np.float32)

    assert rays.yaw_towards(delta).tolist() == [0, 9, 18, 27]
    assert rays.eye_z_m == pytest.approx(1.25)
    assert rays.yaws_aside.tolist() == list(range(-4, 5))


@pytest.mark.parametrize(("tilt_deg", "widest"), [(0.0, 4), (-20.0, 5), (-40.0, 8), (40.0, 8), (-60.0, 18)])
def test_the_turns_that_keep_a_target_in_the_image_are_those_of_a_tilted_camera(world, tilt_deg, widest):
    vertices, faces, _ = world
    tilt = math.radians(tilt_deg)
    T_level_tilted = np.eye(4)
    T_level_tilted[1:3, 1:3] = [[math.cos(tilt), -math.sin(tilt)], [math.sin(tilt), math.cos(tilt)]]
    rays = PixelRays(RayCaster(vertices, faces), CameraExtrinsics(CAMERA, T_BASE_CAMERA @ T_level_tilted))
    assert rays.yaws_aside.max() == -rays.yaws_aside.min() == widest

    # Ahead, from the foot of the camera to as high above it.
    height = np.linspace(-1.25, 1.25, 60)
    away, height = (grid.ravel() for grid in np.meshgrid(np.linspace(0.1, 3.0, 60), height))
    targets = np.stack([away, np.zeros_like(away), 1.25 + height], axis=1).astype(np.float32)
    shown = np.arange(-18, 18)[
        [rays.in_image(targets, np.zeros(2, np.float32), np.full(len(targets), k)).any() for k in range(-18, 18)]
    ]
    assert set(shown) <= set(rays.yaws_aside)
