"""The robot's camera as its maker would describe it: exact images in, measured ones out."""

import math

import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.sim.sensors.measure_color import measure_color
from anm_mj.sim.sensors.measure_depth import measure_depth
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.types import Intrinsics

_FRAME, _CAMERA = 0, 1
"""Streams of random numbers: one per frame, one for the camera's life."""


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
