"""The robot's camera as its maker would describe it: exact images in, measured ones out."""

import math

import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.sim.sensors.measure_depth import measure_depth
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Intrinsics

_FRAME, _CAMERA = 0, 1
"""Streams of random numbers: one per frame, one for the camera's life."""


def measure_color(
    rgb: UInt8[np.ndarray, "h w 3"], config: SensorConfig, generator: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """One colour image of a camera, with ``noise_scale`` multiplied into its settings: shot and read noise, and an
    exposure that is never quite the same.

    The variance of a value is ``color_sigma^2 + color_gain * value`` (Foi et al., Practical Poissonian-Gaussian noise
    modeling and fitting for single-image raw-data, IEEE Transactions on Image Processing 17(10), 2008).
    """
    if config.color_sigma == config.color_gain == config.exposure_sigma == 0.0:
        return rgb
    value = rgb * np.float32(np.exp(config.exposure_sigma * generator.standard_normal()))
    # In place: fresh memory takes as long as the arithmetic.
    spread = config.color_gain * value
    spread += config.color_sigma**2
    np.sqrt(spread, out=spread)
    spread *= generator.standard_normal(rgb.shape, np.float32)
    value += spread
    np.rint(value, out=value)
    np.clip(value, 0, 255, out=value)
    return value.astype(np.uint8)


class Sensor:
    """Adds a sensor's errors to exact images; the same seed and frame always give the same noise."""

    def __init__(self, config: SensorConfig, seed: int) -> None:
        """Draw what is fixed for the camera's life; ``seed`` is that of all its noise."""
        self._config = config.scaled()
        self._seed = seed
        drawn = np.random.default_rng([seed, 7, _CAMERA]).standard_normal()
        self._scale_error = self._config.tof_scale_error * float(drawn)

    @property
    def range_m(self) -> float:
        """Largest depth that is measured [m]; +inf where the sensor sets no limit."""
        return self._config.max_range_m or math.inf

    def measure(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        frame: int,
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        """Colours, and planar depth [m] with ``inf`` beyond the range and ``nan`` where unmeasured, of exact images.

        ``depth_m`` is planar depth [m], not finite where nothing was hit; ``frame`` is a number of the frame's own, not
        negative.
        """
        generator = np.random.default_rng([self._seed, 7, _FRAME, frame])
        measured = measure_depth(depth_m, intrinsics, self._config, self._scale_error, generator)
        return measure_color(rgb, self._config, generator), measured
