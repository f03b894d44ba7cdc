"""Settings that mount another camera on a robot than its file has; loads no simulator."""

import math
from dataclasses import dataclass

from anm_mj.errors import RobotError
from anm_mj.robot.robot_config import MAX_TILT_DEG

FOV_DEG = 10.0, 150.0
"""Fields of view that a pinhole can have [deg]."""
HEIGHT_M = 0.02, 3.0
IMAGE_PX = 16, 2048


@dataclass(frozen=True)
class CameraConfig:
    """Optics and mount of the robot's camera; 0 keeps what the robot's file says."""

    fov_deg: float = 0.0
    """Horizontal field of view [deg]; 0 = as in the robot's file."""
    height_m: float = 0.0
    """Height above the floor [m]; 0 = as in the robot's file."""
    tilt_deg: float = 0.0
    """Turn about the camera's own horizontal axis, on top of the robot's file, positive upwards [deg]."""
    width_px: int = 0
    """Columns of the image [px]; 0 = ``image_px``."""
    height_px: int = 0
    """Rows of the image [px]; 0 = ``image_px``."""

    def __post_init__(self) -> None:
        """Check the limits. Raises RobotError if a value lies outside of its limits."""
        for name, limits, unit in (("fov_deg", FOV_DEG, "degrees"), ("height_m", HEIGHT_M, "m")):
            value, (low, high) = getattr(self, name), limits
            if value != 0.0 and not low <= value <= high:
                raise RobotError(
                    f"camera.{name} is {value:g}; give {low:g} to {high:g} {unit}, or 0 for what the robot's file says."
                )
        if not abs(self.tilt_deg) <= MAX_TILT_DEG:
            raise RobotError(
                f"camera.tilt_deg is {self.tilt_deg:g}; give at most {MAX_TILT_DEG:g} degrees up or -{MAX_TILT_DEG:g} "
                "down."
            )
        for name in ("width_px", "height_px"):
            value, (low, high) = getattr(self, name), IMAGE_PX
            if value and not low <= value <= high:
                raise RobotError(f"camera.{name} is {value}; give {low} to {high}, or 0 for image_px.")

    def image_size(self, image_px: int) -> tuple[int, int]:
        """Columns and rows of the image [px]; ``image_px`` holds for a size that is not set."""
        return self.width_px or image_px, self.height_px or image_px

    def fov_y_deg(self, image_px: int) -> float:
        """Vertical field of view of an image with square pixels [deg]; 0 where the robot's file decides."""
        width, height = self.image_size(image_px)
        half = math.tan(math.radians(self.fov_deg) / 2.0) * height / width
        return math.degrees(2.0 * math.atan(half))
