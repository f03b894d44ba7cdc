"""Colour as a camera records it: shot and read noise, and an exposure that is never quite the same."""

import numpy as np
from jaxtyping import UInt8

from anm_mj.sim.sensors.sensor_config import SensorConfig


def measure_color(
    rgb: UInt8[np.ndarray, "h w 3"], config: SensorConfig, generator: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """One colour image of a camera, with ``noise_scale`` multiplied into its settings.

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
