"""What images tell about the noise of the camera that took them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.frames import pixel_directions
from anm_mj.mapping import depth_noise
from anm_mj.mapping.depth_noise import NoiseMean, inverse_depth_noise, rough_noise
from anm_mj.sim.sensors.camera_sensor import measure_depth
from anm_mj.sim.sensors.sensor_config import sensor_config
from anm_mj.types import Intrinsics
from tests.mapping.ray_room import Room


@pytest.fixture
def depth_m(room: Room):
    return room.observe(1.5, 1.5, 0.4, size=128).depth_m


def test_exact_depth_has_none(depth_m):
    assert inverse_depth_noise(depth_m) < 1e-6


@pytest.mark.parametrize("sigma", [1e-4, 1e-3, 1e-2])
def test_known_noise_is_found(depth_m, sigma):
    rng = np.random.default_rng(0)
    noisy = 1.0 / (1.0 / depth_m + sigma * rng.standard_normal(depth_m.shape))
    assert inverse_depth_noise(noisy.astype(np.float32)) == pytest.approx(sigma, rel=0.25)


def test_missing_pixels_and_edges_do_not_change_it(depth_m):
    rng = np.random.default_rng(1)
    noisy = (1.0 / (1.0 / depth_m + 1e-3 * rng.standard_normal(depth_m.shape))).astype(np.float32)
    noisy[rng.random(noisy.shape) < 0.2] = np.nan
    noisy[40:60, 30:50] = 0.5
    noisy[:5] = np.inf
    assert inverse_depth_noise(noisy) == pytest.approx(1e-3, rel=0.15)


@pytest.mark.parametrize("name", ["d435i", "azure-kinect"])
def test_it_grows_with_the_noise_of_sensors(room, name):
    seen = room.observe(1.5, 1.5, 0.4, size=128)
    found = [
        inverse_depth_noise(
            measure_depth(
                seen.depth_m,
                seen.intrinsics,
                replace(sensor_config(name), noise_scale=scale).scaled(),
                0.0,
                np.random.default_rng(2),
            )
        )
        for scale in (0.25, 0.5, 1.0, 2.0)
    ]
    assert found == sorted(found)
    assert found[-1] > 2.0 * found[0]


@pytest.mark.parametrize("fill", [math.nan, math.inf, 0.0])
def test_an_empty_image_tells_nothing(fill):
    noise = NoiseMean()
    noise.add(np.full((64, 64), fill, np.float32))
    assert noise.value == math.inf


def test_state_survives(depth_m):
    noise, other = NoiseMean(), NoiseMean()
    for image in (depth_m, depth_m + np.float32(0.01) * np.indices(depth_m.shape).sum(axis=0) % 2):
        noise.add(image.astype(np.float32))
    other.set_array(noise.array())
    assert other.value == noise.value > 0.0


def test_of_many_images_only_some_are_looked_at(depth_m, monkeypatch):
    asked = []
    monkeypatch.setattr(depth_noise, "inverse_depth_noise", lambda image: asked.append(image) or 0.5)
    noise = NoiseMean()
    for _ in range(80):
        noise.add(depth_m)
    assert 8 <= len(asked) < 24
    assert noise.value == 0.5


def test_a_floor_is_rougher_than_a_wall_where_places_in_the_image_err() -> None:
    """Pixels whose place errs show no noise on a wall that is looked at squarely, and much on the floor before it."""
    rng = np.random.default_rng(0)
    intrinsics = Intrinsics.from_fov(192, 192, math.pi / 2)
    down = pixel_directions(intrinsics)[..., 1]
    inverse = np.maximum(np.maximum(down, 0.0) / 1.25, 0.25)
    at = np.indices(inverse.shape) + np.rint(0.6 * rng.standard_normal((2, *inverse.shape))).astype(int)
    shown = inverse[np.clip(at[0], 0, 191), np.clip(at[1], 0, 191)] + 0.001 * rng.standard_normal(inverse.shape)
    depth_m = (1.0 / shown).astype(np.float32)
    usual, rough = inverse_depth_noise(depth_m), rough_noise(depth_m)
    assert usual is not None
    assert rough is not None
    assert usual == pytest.approx(0.001, rel=0.5)
    slope = 1.0 / (1.25 * intrinsics.fy)
    assert rough == pytest.approx(math.hypot(0.001, 0.6 * slope), rel=0.4)


def test_clutter_is_not_taken_for_more_than_some_times_the_noise() -> None:
    rng = np.random.default_rng(0)
    # Two fifths of the image are a bush: more tiles than are left out, and too few to change the median.
    depth_m = 1.0 / (0.5 + 0.001 * rng.standard_normal((128, 128)))
    depth_m[77:] = rng.uniform(1.0, 3.0, (51, 128))
    noise = NoiseMean()
    noise.add(depth_m.astype(np.float32))
    rough = rough_noise(depth_m.astype(np.float32))
    assert rough is not None
    assert rough > 10.0 * noise.value
    assert noise.rough == pytest.approx(3.0 * noise.value)


def test_a_mean_of_an_earlier_version_has_no_rougher_figure() -> None:
    noise = NoiseMean()
    noise.set_array(np.array([0.02, 10.0, 20.0]))
    assert noise.rough == noise.value == pytest.approx(0.002)
