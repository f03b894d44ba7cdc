"""How the robot's sensors differ from perfect ones: settings and presets; light enough for the command line."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

from anm_mj.errors import RobotError
from anm_mj.utils.close_names import close_name
from anm_mj.utils.settings import Settings, broken_limits, setting

DEPTH_MODELS = ("exact", "stereo", "tof")
_READ_BY = {
    ("stereo", "tof"): ("lateral_sigma_px", "edge_missing", "edge_jump", "grazing_missing_deg"),
    ("stereo",): ("baseline_m", "native_width_px", "subpixel_sigma_px", "disparity_step_px"),
    ("tof",): ("tof_sigma_m", "tof_scale_error", "flying_share"),
}
"""Settings that only some depth models read."""
"""What a depth image is made by: the renderer alone, stereo matching, or a time-of-flight measurement."""
_DEVIATIONS = ("lateral_sigma_px", "subpixel_sigma_px", "tof_sigma_m", "tof_scale_error", "color_sigma")
_DEVIATIONS += ("exposure_sigma", "odometry_radius_error", "odometry_yaw_bias_deg_per_m")
_PROBABILITIES = ("edge_missing", "flying_share", "odometry_slip_share")
_VARIANCES = ("color_gain", "odometry_alpha")
_from_zero = functools.partial(setting, at_least=0.0, at_most=1e9)


def sensor_config(name: str) -> SensorConfig:
    """The settings of a sensor by its name. Raises RobotError if there is no sensor of that name."""
    if name not in SENSORS:
        raise RobotError(f"There is no sensor '{name}'{close_name(name, SENSORS)}; choose one of {', '.join(SENSORS)}.")
    return SENSORS[name]


@dataclass(frozen=True)
class SensorConfig(Settings, group="sensor", error=RobotError):
    """Settings of the camera's depth and colour noise and of the wheel odometry's noise.

    ``noise_scale`` multiplies every standard deviation, every systematic error and every probability, of missing pixels
    or of slips, at once; 0 leaves quantization and range.
    """

    name: str = "exact"
    """Name of the sensor in ``SENSORS`` that the settings were taken from."""
    depth: str = setting("exact", choices=DEPTH_MODELS)
    """One of ``DEPTH_MODELS``."""
    noise_scale: float = _from_zero(1.0)
    """Factor on all noise below."""
    min_range_m: float = _from_zero(0.0)
    """No depth is measured nearer than this [m]."""
    max_range_m: float = _from_zero(0.0)
    """No depth is measured beyond this [m]; 0 = up to the camera's far plane."""
    lateral_sigma_px: float = _from_zero(0.0, at_most=1e6)
    """Standard deviation of the place in the image that a depth value comes from [px]."""
    edge_missing: float = _from_zero(0.0, at_most=1.0)
    """Probability that a pixel at a depth edge is not measured."""
    edge_jump: float = _from_zero(0.05)
    """A step in depth of more than this share of the depth is an edge."""
    grazing_missing_deg: float = _from_zero(90.0, at_most=90.0)
    """From this angle of incidence on pixels go missing; at 90 degrees all are [deg]."""
    baseline_m: float = _from_zero(0.05)
    """Distance of the two imagers of a stereo camera [m]."""
    native_width_px: float = _from_zero(848.0)
    """Columns of a stereo camera's own image, which sets the focal length that disparity is measured with [px]."""
    subpixel_sigma_px: float = _from_zero(0.0)
    """Standard deviation of the disparity of a stereo camera [px of its own image]."""
    disparity_step_px: float = _from_zero(0.0)
    """Disparities are multiples of this [px of its own image]; 0 = any."""
    tof_sigma_m: float = _from_zero(0.0)
    """Standard deviation of a time-of-flight depth at 1 m on a frontal surface [m]; it grows with the square of the
    depth and with the inverse of the cosine of incidence, as the returned light falls."""
    tof_scale_error: float = _from_zero(0.0)
    """Systematic error of a time-of-flight camera as a share of the depth, one draw for the camera's life."""
    flying_share: float = _from_zero(0.0, at_most=1.0)
    """Share of the pixels at a depth edge that a time-of-flight camera puts between both surfaces."""
    color_sigma: float = _from_zero(0.0)
    """Standard deviation of a colour value in the dark [0..255]."""
    color_gain: float = _from_zero(0.0)
    """Growth of a colour value's variance with the value (shot noise) [0..255]."""
    exposure_sigma: float = _from_zero(0.0, at_most=10.0)
    """Standard deviation of the logarithm of a frame's exposure."""
    delay_s: float = _from_zero(0.0, at_most=2.0)
    """Images arrive so long after they were taken [s]: each shows the world as it was that long before the pose that it
    comes with. Its stamp says when that was, and wheel odometry how the robot has moved since."""
    stamp_error_s: float = setting(0.0, at_least=-0.5, at_most=0.5)
    """The stamp of an image is later than when it was taken by this, at most by ``delay_s`` [s]: what calibration
    leaves, milliseconds."""
    odometry_alpha: tuple[float, float, float, float] = _from_zero((0.0, 0.0, 0.0, 0.0))
    """Noise of wheel odometry: variance of a rotation from rotation [rad^2/rad^2] and from translation [rad^2/m^2], of
    a translation from translation [m^2/m^2] and from rotation [m^2/rad^2]. Source: Thrun, Burgard and Fox,
    Probabilistic Robotics, 2005, table 5.6."""
    odometry_radius_error: float = setting(0.0, at_least=-0.5, at_most=1.0)
    """Systematic error of wheel odometry: it takes the wheels for larger than they are by this share of their radius,
    so that distances and turns come out too large by it."""
    odometry_yaw_bias_deg_per_m: float = setting(0.0, at_least=-90.0, at_most=90.0)
    """Systematic error of wheel odometry: its heading turns to the left by this much with every metre driven [deg/m],
    as with wheels of unequal radius."""
    odometry_slip_share: float = _from_zero(0.0, at_most=1.0)
    """Share of actions during which wheels spin, as beside an obstacle that they push against: the reading of odometry
    is then wrong by ``odometry_slip_m`` and ``odometry_slip_deg``, far more than it usually errs."""
    odometry_slip_m: float = _from_zero(0.1)
    """A slip makes the way longer or shorter by up to this, uniformly [m],"""
    odometry_slip_deg: float = _from_zero(25.0, at_most=180.0)
    """and turns the heading to either side by up to this, uniformly [deg]."""

    def __post_init__(self) -> None:
        """Refuse what no sensor does. Raises RobotError if a choice is unknown, or a number is out of its range as it
        is or as ``noise_scale`` makes it.
        """
        super().__post_init__()
        for name, value in self._scaled_values().items():
            if wanted := broken_limits(self, name, value):
                raise RobotError(
                    f"sensor.{name} is {getattr(self, name)} and sensor.noise_scale is {self.noise_scale:g}; "
                    f"the first times {'the square of ' * (name in _VARIANCES)}the second must be {wanted}."
                )
        if self.depth == "stereo" and not (self.baseline_m > 0.0 and self.native_width_px > 0.0):
            raise RobotError(
                f"sensor.baseline_m is {self.baseline_m:g} and sensor.native_width_px is {self.native_width_px:g}; "
                "a stereo camera needs both above 0."
            )
        if 0.0 < self.max_range_m <= self.min_range_m:
            raise RobotError(
                f"sensor.max_range_m is {self.max_range_m:g} m and sensor.min_range_m {self.min_range_m:g} m; "
                "the range must end beyond where it begins."
            )
        if self.stamp_error_s > self.delay_s:
            raise RobotError(
                f"sensor.stamp_error_s is {self.stamp_error_s:g} s and sensor.delay_s {self.delay_s:g} s; no image "
                "arrives before its stamp: give a delay_s as long as stamp_error_s, or longer."
            )

    @property
    def is_late(self) -> bool:
        """Whether images show another time than that of the pose they come with, or say so."""
        return self.delay_s > 0.0 or self.stamp_error_s != 0.0

    @property
    def misses(self) -> bool:
        """Whether a pixel without depth may have looked at something: then it tells nothing about free space."""
        return self.depth != "exact"

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Names of settings that differ from those of the named sensor, and that nothing reads: neither its depth
        model, nor wheels that never slip.
        """
        usual = SENSORS.get(self.name, SensorConfig())
        unread = set[str]().union(*(names for model, names in _READ_BY.items() if self.depth not in model))
        unread.update(("odometry_slip_m", "odometry_slip_deg") if self.odometry_slip_share == 0.0 else ())
        return tuple(name for name in sorted(unread) if getattr(self, name) != getattr(usual, name))

    def scaled(self) -> SensorConfig:
        """The same with ``noise_scale`` multiplied in and set to 1; probabilities end at 1. The angle from which pixels
        go missing moves from 90 degrees towards the camera's axis with the scale.
        """
        return replace(self, noise_scale=1.0, **self._scaled_values())

    def _scaled_values(self) -> dict[str, Any]:
        """What ``noise_scale`` changes, by the names of the fields."""
        k = self.noise_scale
        scaled: dict[str, Any] = {name: k * getattr(self, name) for name in _DEVIATIONS}
        scaled |= {name: min(k * getattr(self, name), 1.0) for name in _PROBABILITIES}
        scaled["grazing_missing_deg"] = max(90.0 - k * (90.0 - self.grazing_missing_deg), 0.0)
        scaled["color_gain"] = k**2 * self.color_gain
        scaled["odometry_alpha"] = tuple(k**2 * alpha for alpha in self.odometry_alpha)
        return scaled


SENSORS: dict[str, SensorConfig] = {
    "exact": SensorConfig(),
    # Intel RealSense D435i. Baseline, resolution, field of view and range: Intel RealSense D400 Series Product Family
    # Datasheet (848 x 480, 50 mm, 0.28 m; nothing beyond 6 m, where the error passes 9 cm). Disparity steps of 1/32 px:
    # Grunnet-Jepsen et al., Subpixel Linearity Improvement for Intel RealSense Depth Camera D400 Series. A disparity
    # error of 0.053 px makes 0.0025 z^2 at 90 degrees, within the "0.05 to 0.1 px" of Grunnet-Jepsen, Sweetser and
    # Woodfill, Best-Known-Methods for Tuning Intel RealSense D400 Depth Cameras, 2018.
    "d435i": SensorConfig(
        name="d435i",
        depth="stereo",
        min_range_m=0.28,
        max_range_m=6.0,
        lateral_sigma_px=0.5,
        edge_missing=0.5,
        grazing_missing_deg=80.0,
        baseline_m=0.05,
        native_width_px=848.0,
        subpixel_sigma_px=0.053,
        disparity_step_px=1.0 / 32.0,
        color_sigma=2.0,
        color_gain=0.05,
        exposure_sigma=0.02,
    ),
    # Azure Kinect DK, narrow field of view, 2 x 2 binned. Range 0.5 to 5.46 m, random error of at most 17 mm,
    # systematic error below 11 mm + 0.1 % of the distance: Azure Kinect DK hardware specification. The spread grows
    # with distance and at grazing incidence, and pixels fly between both surfaces at edges: Toelgyessy et al.,
    # Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2, Sensors 21(2), 2021.
    "azure-kinect": SensorConfig(
        name="azure-kinect",
        depth="tof",
        min_range_m=0.5,
        max_range_m=5.46,
        edge_missing=0.3,
        grazing_missing_deg=80.0,
        tof_sigma_m=0.0014,
        tof_scale_error=0.002,
        flying_share=0.3,
        color_sigma=2.0,
        color_gain=0.05,
        exposure_sigma=0.02,
    ),
}
"""By name: a perfect one, the Intel RealSense D435i and the Azure Kinect, with the sources of their figures."""
