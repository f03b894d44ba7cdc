import math
from dataclasses import replace

import pytest

from anm_mj.errors import RobotError
from anm_mj.sim.sensors.sensor_config import SENSORS, SensorConfig, sensor_config


def test_unknown_sensor_is_named():
    with pytest.raises(RobotError, match="no sensor 'lidar'; choose one of exact, d435i"):
        sensor_config("lidar")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth": "sonar"}, "sensor.depth is 'sonar'"),
        ({"subpixel_sigma_px": -0.1}, "sensor.subpixel_sigma_px is -0.1"),
        ({"noise_scale": math.nan}, "sensor.noise_scale is nan"),
        ({"lateral_sigma_px": 1e9}, r"at most 1000000\."),
        ({"exposure_sigma": 1e9}, "sensor.exposure_sigma is 1000000000"),
        ({"edge_missing": 1.5}, "at most 1"),
        ({"min_range_m": 3.0, "max_range_m": 2.0}, "sensor.max_range_m is 2"),
        ({"depth": "stereo", "baseline_m": 0.0}, "sensor.baseline_m is 0"),
        ({"grazing_missing_deg": 120.0}, "at most 90"),
        ({"odometry_alpha": (0.1, -0.1, 0.0, 0.0)}, "sensor.odometry_alpha"),
    ],
)
def test_impossible_values_are_refused(values: dict, message: str):
    with pytest.raises(RobotError, match=message):
        SensorConfig(**values)


@pytest.mark.parametrize(
    ("values", "times"),
    [({"odometry_radius_error": 0.3}, "times the second"), ({"color_gain": 1e8}, "times the square of the second")],
)
def test_noise_that_the_scale_makes_impossible_is_named_with_the_scale(values: dict, times: str):
    ((name, value),) = values.items()
    with pytest.raises(RobotError, match=rf"sensor.{name} is {value} and sensor.noise_scale is 5; .* {times} must be"):
        SensorConfig(**values, noise_scale=5.0)


@pytest.mark.parametrize("name", list(SENSORS))
def test_twice_the_noise_is_possible(name: str):
    twice = SensorConfig(**{**vars(SENSORS[name]), "noise_scale": 2.0}).scaled()
    assert twice.noise_scale == 1.0
    assert twice.edge_missing <= 1.0


@pytest.mark.parametrize(
    ("config", "idle"),
    [
        (SensorConfig(), ()),
        (SensorConfig(edge_missing=0.5, color_sigma=2.0, max_range_m=4.0), ("edge_missing",)),
        (replace(SENSORS["d435i"], edge_missing=0.1, flying_share=0.2), ("flying_share",)),
        (replace(SENSORS["azure-kinect"], subpixel_sigma_px=0.1), ("subpixel_sigma_px",)),
        (SENSORS["d435i"], ()),
    ],
)
def test_settings_that_the_depth_model_does_not_read_are_told(config, idle):
    assert config.without_effect == idle
