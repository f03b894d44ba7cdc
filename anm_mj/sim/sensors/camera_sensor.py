"""The robot's camera as its maker would describe it: exact images in, measured ones out.

A pixel of measured depth, by a stereo or a time-of-flight camera, is planar depth, ``inf`` where the sensor says that
it looked farther than its range, or ``nan`` where it measured nothing. Real cameras cannot tell the two apart; only the
exact one says ``inf``.
"""

import math

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from anm_mj.sensing.pixel_state import is_measured
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


def measure_depth(
    depth_m: Float32[np.ndarray, "h w"],
    intrinsics: Intrinsics,
    config: SensorConfig,
    scale_error: float,
    generator: np.random.Generator,
) -> Float32[np.ndarray, "h w"]:
    """One depth image of a sensor with ``noise_scale`` multiplied in (:meth:`SensorConfig.scaled`).

    ``depth_m`` is exact planar depth [m], not finite where nothing was hit; ``scale_error`` is this camera's systematic
    error as a share of the depth.
    """
    hit = is_measured(depth_m)
    exact = depth_m if hit.all() else np.where(hit, depth_m, np.float32(np.inf))
    if config.depth == "exact":
        return _in_range(exact, exact, config, np.float32(np.inf))
    sampled = _jittered(exact, config.lateral_sigma_px, generator)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.float32(1.0) / sampled
    edge = depth_edges(inverse, config.edge_jump)
    missing = edge & (generator.random(edge.shape, np.float32) < config.edge_missing)
    cos_incidence = incidence_cosine(inverse, intrinsics)
    missing |= _lost_at_grazing(cos_incidence, config.grazing_missing_deg, generator) & ~edge
    spread = generator.standard_normal(exact.shape, np.float32)
    if config.depth == "stereo":
        measured = _stereo(inverse, spread, intrinsics, config)
    else:
        measured = _time_of_flight(sampled, spread, cos_incidence, edge, scale_error, config, generator)
    # A pixel between a surface and the sky is no measurement either.
    np.copyto(measured, np.nan, where=missing | ~np.isfinite(measured))
    return _in_range(measured, sampled, config, np.float32(np.nan))


def depth_edges(inverse_depth: Float32[np.ndarray, "h w"], jump: float) -> Bool[np.ndarray, "h w"]:
    """Pixels beside a step in depth of at least ``jump``, a share of the depth. Inverse depth [1/m], 0 where nothing
    was hit, is linear over a plane, so its second difference tells steps.
    """
    edge = np.zeros(inverse_depth.shape, bool)
    for axis in (0, 1):
        d = np.moveaxis(inverse_depth, axis, 0)
        bend = np.abs(d[2:] - 2.0 * d[1:-1] + d[:-2])
        np.moveaxis(edge, axis, 0)[1:-1] |= bend > jump * np.maximum(d[1:-1], 1e-3)
    return edge


def incidence_cosine(inverse_depth: Float32[np.ndarray, "h w"], intrinsics: Intrinsics) -> Float32[np.ndarray, "h w"]:
    """Cosine of the angle between each pixel's ray and the surface's normal, from the gradient of inverse depth."""
    dv, du = np.gradient(inverse_depth)
    u = (np.arange(intrinsics.width, dtype=np.float32) + 0.5 - intrinsics.cx)[None, :]
    v = (np.arange(intrinsics.height, dtype=np.float32) + 0.5 - intrinsics.cy)[:, None]
    ray = np.sqrt((u / intrinsics.fx) ** 2 + (v / intrinsics.fy) ** 2 + 1.0)
    along = inverse_depth - u * du - v * dv
    normal = np.sqrt((intrinsics.fx * du) ** 2 + (intrinsics.fy * dv) ** 2 + along**2)
    return np.minimum(inverse_depth / np.maximum(normal * ray, 1e-9), 1.0).astype(np.float32)


def _jittered(
    depth_m: Float32[np.ndarray, "h w"], sigma_px: float, generator: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    if sigma_px == 0.0:
        return depth_m
    height, width = depth_m.shape
    shift = sigma_px * generator.standard_normal((2, height, width), np.float32)
    row, col = np.rint(shift, out=shift).astype(np.int32)
    row += np.arange(height, dtype=np.int32)[:, None]
    col += np.arange(width, dtype=np.int32)
    np.clip(row, 0, height - 1, out=row)
    np.clip(col, 0, width - 1, out=col)
    row *= width
    row += col
    return depth_m.take(row)


def _lost_at_grazing(
    cos_incidence: Float32[np.ndarray, "h w"], from_deg: float, generator: np.random.Generator
) -> Bool[np.ndarray, "h w"]:
    """Pixels lost at grazing incidence: the probability rises from 0 at an angle to 1 at 90 degrees."""
    if from_deg >= 90.0:
        return np.zeros(cos_incidence.shape, bool)
    limit = math.cos(math.radians(from_deg))
    return generator.random(cos_incidence.shape, np.float32) * limit > cos_incidence


def _stereo(
    inverse_depth: Float32[np.ndarray, "h w"],
    spread: Float32[np.ndarray, "h w"],
    intrinsics: Intrinsics,
    config: SensorConfig,
) -> Float32[np.ndarray, "h w"]:
    """Depth from a noisy, quantized disparity: sigma_z = z^2 sigma_d / (f b)."""
    focal_baseline = np.float32(config.native_width_px / intrinsics.width * intrinsics.fx * config.baseline_m)
    disparity = focal_baseline * inverse_depth + np.float32(config.subpixel_sigma_px) * spread
    if config.disparity_step_px:
        disparity = np.rint(disparity / np.float32(config.disparity_step_px)) * np.float32(config.disparity_step_px)
    with np.errstate(divide="ignore"):
        return np.where(disparity > 0.0, focal_baseline / disparity, np.float32(np.nan)).astype(np.float32)


def _time_of_flight(
    depth_m: Float32[np.ndarray, "h w"],
    spread: Float32[np.ndarray, "h w"],
    cos_incidence: Float32[np.ndarray, "h w"],
    edge: Bool[np.ndarray, "h w"],
    scale_error: float,
    config: SensorConfig,
    generator: np.random.Generator,
) -> Float32[np.ndarray, "h w"]:
    """Depth with a spread that grows as the returned light falls, and flying pixels at edges."""
    with np.errstate(invalid="ignore"):
        sigma = np.float32(config.tof_sigma_m) * depth_m**2 / np.maximum(cos_incidence, np.float32(0.1))
        measured = depth_m * np.float32(1.0 + scale_error) + sigma * spread
    flying = edge & (generator.random(edge.shape, np.float32) < config.flying_share)
    flying[:, 0] = False
    row, col = np.nonzero(flying)
    share = generator.random(len(row), np.float32)
    with np.errstate(invalid="ignore"):
        measured[row, col] = share * depth_m[row, col - 1] + (1.0 - share) * depth_m[row, col]
    return measured


def _in_range(
    measured_m: Float32[np.ndarray, "h w"],
    looked_at_m: Float32[np.ndarray, "h w"],
    config: SensorConfig,
    beyond: np.float32,
) -> Float32[np.ndarray, "h w"]:
    """The measurement within the sensor's range; beyond it what the sensor says there, nearer nothing."""
    far = ~np.isfinite(looked_at_m)
    if config.max_range_m:
        far |= (looked_at_m > config.max_range_m) | (measured_m > config.max_range_m)
    near = (looked_at_m < config.min_range_m) | (measured_m <= config.min_range_m)
    out = measured_m.copy()
    np.copyto(out, beyond, where=far)
    np.copyto(out, np.float32(np.nan), where=near)
    return out


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
