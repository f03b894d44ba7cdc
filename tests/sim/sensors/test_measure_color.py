import numpy as np
import pytest

from anm_mj.sim.sensors.camera_sensor import measure_color
from anm_mj.sim.sensors.sensor_config import SensorConfig

GREY = np.full((200, 200, 3), 100, np.uint8)


def test_without_noise_the_picture_is_the_same():
    assert measure_color(GREY, SensorConfig(), np.random.default_rng(0)) is GREY


def test_variance_is_read_plus_shot_noise():
    config = SensorConfig(color_sigma=2.0, color_gain=0.09)
    picture = measure_color(GREY, config, np.random.default_rng(0))
    assert picture.std() == pytest.approx(np.sqrt(4.0 + 9.0 + 1 / 12), rel=0.02)


def test_exposure_moves_the_whole_frame():
    means = [measure_color(GREY, SensorConfig(exposure_sigma=0.1), np.random.default_rng(k)).mean() for k in range(200)]
    assert np.std(np.log(np.array(means) / 100.0)) == pytest.approx(0.1, rel=0.2)


def test_colours_stay_in_range():
    bright = measure_color(np.full((8, 8, 3), 250, np.uint8), SensorConfig(color_sigma=50.0), np.random.default_rng(0))
    assert bright.max() == 255
