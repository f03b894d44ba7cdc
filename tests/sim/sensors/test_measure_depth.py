import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anm_mj.sim.sensors.camera_sensor import Sensor, depth_edges, incidence_cosine
from anm_mj.sim.sensors.sensor_config import SENSORS, SensorConfig
from anm_mj.types import Intrinsics

CAMERA = Intrinsics.from_fov(128, 96, math.radians(75.0))
BLACK = np.zeros((96, 128, 3), np.uint8)


def plane(normal: tuple[float, float, float], distance_m: float) -> np.ndarray:
    """Planar depth of the plane ``normal . x = distance`` in camera axes."""
    u = (np.arange(CAMERA.width) + 0.5 - CAMERA.cx) / CAMERA.fx
    v = (np.arange(CAMERA.height) + 0.5 - CAMERA.cy) / CAMERA.fy
    n = np.array(normal) / np.linalg.norm(normal)
    along = n[0] * u[None, :] + n[1] * v[:, None] + n[2]
    return np.where(along > 1e-6, distance_m / np.maximum(along, 1e-6), np.inf).astype(np.float32)


def measured(depth_m: np.ndarray, config: SensorConfig, seed: int = 0, step: int = 0) -> np.ndarray:
    return Sensor(config, seed).measure(BLACK, depth_m, CAMERA, step)[1]


def test_exact_sensor_changes_no_depth():
    wall = plane((0.3, 0.1, 1.0), 2.0)
    assert np.array_equal(measured(wall, SENSORS["exact"]), wall)


def test_exact_sensor_says_farther():
    assert np.isposinf(measured(np.full((96, 128), np.nan, np.float32), SENSORS["exact"])).all()


def test_flying_pixels_before_the_sky_are_missing():
    depth = np.full((96, 128), 1.0, np.float32)
    depth[:, 64:] = np.inf
    flown = measured(depth, SensorConfig(depth="tof", flying_share=1.0))
    assert np.isnan(flown[:, 64:]).all()
    assert not np.isinf(flown).any()


@pytest.mark.parametrize("name", ["d435i", "azure-kinect"])
def test_real_sensor_does_not_say_farther(name: str):
    assert np.isnan(measured(np.full((96, 128), np.inf, np.float32), SENSORS[name])).all()


@pytest.mark.parametrize("z_m", [1.0, 2.0, 4.0])
def test_stereo_error_grows_with_the_square(z_m: float):
    config = SensorConfig(depth="stereo", subpixel_sigma_px=0.1)
    focal_px = config.native_width_px / CAMERA.width * CAMERA.fx
    error = measured(plane((0, 0, 1), z_m), config) - z_m
    assert error.std() == pytest.approx(z_m**2 * 0.1 / (focal_px * config.baseline_m), rel=0.05)


def test_d435i_error_is_the_published_one():
    square = Intrinsics.from_fov(256, 256, math.radians(90.0))
    depth = np.full((256, 256), 2.0, np.float32)
    error = Sensor(SENSORS["d435i"], 0).measure(np.zeros((256, 256, 3), np.uint8), depth, square, 0)[1] - 2.0
    assert np.nanstd(error) == pytest.approx(0.0025 * 2.0**2, rel=0.1)


def test_disparity_is_quantized():
    config = SensorConfig(depth="stereo", disparity_step_px=1 / 4)
    focal_px = config.native_width_px / CAMERA.width * CAMERA.fx
    disparity = focal_px * config.baseline_m / measured(plane((0.5, 0, 1), 3.0), config)
    assert np.allclose(disparity * 4, np.rint(disparity * 4), atol=1e-2)


def test_time_of_flight_errs_by_its_scale():
    config = SensorConfig(depth="tof", tof_scale_error=0.01)
    ratio = [float(np.nanmean(measured(plane((0, 0, 1), z), config, seed=3))) / z for z in (1.0, 3.0)]
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-5)
    assert ratio[0] != pytest.approx(1.0, abs=1e-4)


def test_flying_pixels_lie_between_both_surfaces():
    depth = np.full((96, 128), 1.0, np.float32)
    depth[:, 64:] = 3.0
    flown = measured(depth, SensorConfig(depth="tof", flying_share=1.0))
    between = (flown > 1.01) & (flown < 2.99)
    assert between[:, 62:66].any()
    assert not between[:, :60].any()


@pytest.mark.parametrize("z_m", [0.2, 7.0])
def test_nothing_is_measured_out_of_range(z_m: float):
    assert np.isnan(measured(plane((0, 0, 1), z_m), SENSORS["d435i"])).all()


def test_half_of_the_edge_is_missing():
    depth = np.full((96, 128), 1.0, np.float32)
    depth[:, 64:] = 2.0
    config = SensorConfig(depth="stereo", edge_missing=0.5)
    missing = np.isnan(measured(depth, config))
    assert 0.35 < missing[1:-1, 63:65].mean() < 0.65
    assert not missing[:, :60].any()


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_planes_have_no_edges(a: float, b: float):
    wall = plane((a, b, 1.0), 2.0)
    inner = np.isfinite(wall) & (wall < 30.0)
    assert not depth_edges(1.0 / wall, 0.05)[inner].any()


@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_incidence_of_a_plane(a: float, b: float):
    normal = np.array([a, b, 1.0]) / np.linalg.norm([a, b, 1.0])
    u, v = 100, 20
    ray = np.array([(u + 0.5 - CAMERA.cx) / CAMERA.fx, (v + 0.5 - CAMERA.cy) / CAMERA.fy, 1.0])
    expected = max(float(normal @ ray / np.linalg.norm(ray)), 0.0)
    found = float(incidence_cosine(1.0 / plane((a, b, 1.0), 2.0), CAMERA)[v, u])
    assert found == pytest.approx(expected, abs=0.02)


def test_grazing_pixels_go_missing():
    config = SensorConfig(depth="stereo", grazing_missing_deg=60.0)
    floor = plane((0.0, 1.0, 0.02), 0.5)
    missing = np.isnan(measured(floor, config))
    near, far = missing[-8:], missing[52:56]
    assert near.mean() < 0.1 < 0.6 < far.mean()


def test_seed_and_step_decide_the_noise():
    wall = plane((0, 0, 1), 2.0)
    config = SENSORS["d435i"]
    assert np.array_equal(measured(wall, config, 1, 5), measured(wall, config, 1, 5), equal_nan=True)
    assert not np.array_equal(measured(wall, config, 1, 5), measured(wall, config, 1, 6), equal_nan=True)
    assert not np.array_equal(measured(wall, config, 1, 5), measured(wall, config, 2, 5), equal_nan=True)


def test_no_noise_at_scale_zero():
    wall = plane((0, 0, 1), 2.0)
    config = replace(SENSORS["d435i"], noise_scale=0.0, disparity_step_px=0.0)
    assert np.allclose(measured(wall, config), wall, rtol=1e-5)


@given(
    st.sampled_from(["stereo", "tof"]),
    st.lists(st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1.0, 5.0]), min_size=1, max_size=7),
)
def test_no_input_makes_nonsense(model: str, values: list[float]):
    depth = np.resize(np.array(values, np.float32), (96, 128))
    config = replace(SENSORS["d435i"], depth=model, tof_sigma_m=0.01)
    result = measured(depth, config)
    finite = result[np.isfinite(result)]
    assert ((finite > config.min_range_m) & (finite <= config.max_range_m)).all()
