"""Sensors by name: a perfect one, the Intel RealSense D435i and the Azure Kinect, with the sources of their figures."""

from anm_mj.errors import RobotError
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.utils.close_names import close_name

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


def sensor_config(name: str) -> SensorConfig:
    """The settings of a sensor by its name. Raises RobotError if there is no sensor of that name."""
    if name not in SENSORS:
        raise RobotError(f"There is no sensor '{name}'{close_name(name, SENSORS)}; choose one of {', '.join(SENSORS)}.")
    return SENSORS[name]
