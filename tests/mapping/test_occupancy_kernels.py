"""The native occupancy kernels give what NumPy's give, to the last bit, whatever comes in."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj import _native
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.occupancy_kernels import OccupancyKernels
from anm_mj.types import Intrinsics
from tests.mapping.numpy_occupancy import NumpyKernels


def grid_with(config, kernels):
    grid = DepthOccupancy(config)
    grid._kernels = kernels
    return grid


def reference_of(config):
    return grid_with(config, NumpyKernels(config))


def native_of(config, *arguments):
    return grid_with(config, OccupancyKernels(config, *arguments))


def camera(yaw, pitch, roll, position):
    """A pose with camera axes x right, y down, z forward."""
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    T = np.eye(4)
    T[:3, 0] = math.cos(roll) * right + math.sin(roll) * down
    T[:3, 1] = math.cos(roll) * down - math.sin(roll) * right
    T[:3, 2], T[:3, 3] = forward, position
    return T


def image(rng, height, width, kind):
    """Depth of planes with noise and holes."""
    v, u = np.indices((height, width))
    depth = 1.0 / np.maximum(rng.uniform(0.05, 1.2) + rng.normal(0, 0.004) * u + rng.normal(0, 0.004) * v, 0.02)
    if kind != "exact":
        depth += rng.normal(0.0, 0.05, depth.shape)
        depth[rng.random(depth.shape) < 0.1] = np.nan
        depth[rng.random(depth.shape) < 0.05] = np.inf
        depth[: height // 8] = np.nan if kind == "holes" else np.inf
    return depth.astype(np.float32)


def arrays(grid):
    return grid.voxels._asdict()


def assert_equal(left, right):
    for name, value in arrays(left).items():
        assert np.array_equal(value, arrays(right)[name]), name


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1 << 30),
    shape=st.sampled_from([(48, 64), (33, 20), (3, 5), (130, 40)]),
    fov_deg=st.floats(30.0, 120.0),
    kind=st.sampled_from(["exact", "noisy", "holes"]),
    sky_is_free=st.booleans(),
    voxel_m=st.sampled_from([0.05, 0.1, 0.07]),
)
def test_both_fuse_the_same_grid(seed, shape, fov_deg, kind, sky_is_free, voxel_m):
    rng = np.random.default_rng(seed)
    config = OccupancyConfig(no_depth_is_free=sky_is_free, voxel_m=voxel_m, carve_range_m=2.0, hit_range_m=2.5)
    pinhole = Intrinsics.from_fov(shape[1], shape[0], math.radians(fov_deg))
    reference = reference_of(config)
    natives = [native_of(config, threads) for threads in (1, 2)]
    for _ in range(2):
        pose = camera(*rng.uniform(-3, 3, 1), *rng.uniform(-1, 1, 2), rng.uniform(-0.5, 0.5, 3))
        depth = image(rng, *shape, kind)
        for grid in (reference, *natives):
            grid.integrate(depth, pinhole, pose)
        for native in natives:
            assert_equal(reference, native)
            assert np.array_equal(
                reference.observation_count(depth, pinhole, pose), native.observation_count(depth, pinhole, pose)
            )


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_camera_along_an_axis_at_a_voxels_face(yaw):
    grids = [reference_of(OccupancyConfig()), native_of(OccupancyConfig(), 2)]
    pinhole = Intrinsics.from_fov(64, 64, math.pi / 2)
    depth = np.full((64, 64), 2.0, np.float32)
    for z in (1.25, 1.0, 0.975):
        for grid in grids:
            grid.integrate(depth, pinhole, camera(yaw, 0.0, 0.0, (0.025, 0.0, z)))
    assert_equal(*grids)


def test_a_voxel_changes_its_mind_the_same_way():
    grids = [reference_of(OccupancyConfig()), native_of(OccupancyConfig(), 2)]
    pinhole = Intrinsics.from_fov(64, 64, math.pi / 2)
    pose = camera(0.3, 0.1, 0.0, (0.0, 0.0, 1.0))
    for depth_m in [1.0] * 3 + [3.0] * 16 + [1.0, 2.0, math.inf, math.nan]:
        for grid in grids:
            grid.integrate(np.full((64, 64), depth_m, np.float32), pinhole, pose)
    assert_equal(*grids)


@pytest.mark.parametrize("kernel", _native.kernel_names())
def test_all_instruction_sets_agree(kernel):
    rng = np.random.default_rng(3)
    reference = reference_of(OccupancyConfig())
    native = native_of(OccupancyConfig(), 2, kernel)
    pinhole = Intrinsics.from_fov(96, 96, math.pi / 2)
    for step in range(2):
        depth = image(rng, 96, 96, "noisy")
        for grid in (reference, native):
            grid.integrate(depth, pinhole, camera(0.7 * step, 0.2, 0.0, (0.1 * step, 0.0, 1.25)))
    assert_equal(reference, native)


def test_voxels_outside_the_grid_are_refused():
    kernels = OccupancyKernels(OccupancyConfig(), 1)
    grid = grid_with(OccupancyConfig(), kernels)
    grid.integrate(np.full((16, 16), 1.0, np.float32), Intrinsics.from_fov(16, 16, 1.5), camera(0, 0, 0, (0, 0, 1.0)))
    with pytest.raises(ValueError, match="outside the grid"):
        kernels.mark(grid.voxels, np.array([[9999, 0, 0]]), np.ones(1, np.float32), 2)


@pytest.mark.parametrize("name", ["log_odds", "state", "seen_range_m", "num_hits", "block_stamp", "column_version"])
def test_arrays_in_another_order_or_type_are_refused(name):
    kernels = OccupancyKernels(OccupancyConfig(), 1)
    grid = grid_with(OccupancyConfig(), kernels)
    grid.integrate(np.full((16, 16), 1.0, np.float32), Intrinsics.from_fov(16, 16, 1.5), camera(0, 0, 0, (0, 0, 1.0)))
    array = getattr(grid.voxels, name)
    for other in (np.asfortranarray(array), array.astype(np.float64)):
        # A copy of them would be gone when the arrays are used.
        with pytest.raises(TypeError):
            kernels.mark(grid.voxels._replace(**{name: other}), np.zeros((0, 3), np.int64), np.ones(0, np.float32), 2)
