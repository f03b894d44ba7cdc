"""Settings of the robot and of its camera; loads no simulator."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from anm_mj.errors import RobotError

DEFAULT_ROBOT = "diff_drive"
MAX_TILT_DEG = 45.0
"""A camera looks within this angle of the horizontal [deg]."""
MAX_ASIDE_DEG = 30.0
"""A camera looks within this angle of the robot's forward direction, seen from above [deg]."""
MAX_ASIDE_M = 2.0
"""A camera is within this distance of the base, forwards and sideways [m]."""
FOV_DEG = 10.0, 150.0
"""Fields of view that a pinhole can have [deg]."""
HEIGHT_M = 0.02, 3.0
IMAGE_PX = 16, 2048


class CameraPose(NamedTuple):
    """Where a camera is mounted that the robot's file lacks, in the base frame: x forward, y to the left, z above the
    floor; pitched downwards from the horizontal, with a vertical field of view.
    """

    x_m: float
    y_m: float
    z_m: float
    pitch_deg: float
    fovy_deg: float


@dataclass(frozen=True)
class RobotConfig:
    """How to read a robot's MJCF where its parts cannot be told from the file, and the noise of its encoders."""

    left_wheel: str = ""
    """Name of the left wheel's hinge, of several with commas between them; empty = found by name or by geometry."""
    right_wheel: str = ""
    """Name of the right wheel's hinge, or of several; empty = found by name or by geometry."""
    camera: str = ""
    """Name of the camera; empty = ``camera``, the only one, or the first that looks forward and is on no arm or hand,
    colour cameras before depth cameras."""
    camera_pose: str = ""
    """``x,y,z,pitch,fovy`` [m, m, m, deg, deg] of a camera to mount instead of one from the file, in the base frame;
    pitch is positive downwards. Empty = a camera of the file."""
    keyframe: str = ""
    """Key frame of the file at which all joints but the wheels' are locked; empty = the first of ``stow``, ``stowed``,
    ``tucked``, ``retract``, ``home`` that the file has, else the joints' reference positions."""
    skid_steer: bool = False
    """Whether all driven wheels of a side turn alike and the robot turns by letting them slip."""
    track_scale: float = 1.0
    """Effective track over the measured one, by which odometry computes turns; above 1 for skid steering."""
    wheel_noise: float = 0.0
    """Standard deviation of a wheel's measured rotation after one radian [rad]; it grows with the square root of the
    rotation and affects wheel odometry only. 0.02 causes two to three degrees of drift in a hundred actions."""

    def __post_init__(self) -> None:
        """Check the values. Raises RobotError if a value is out of range, or two exclude each other."""
        if not 0.0 <= self.wheel_noise <= 0.5:
            raise RobotError(f"model.wheel_noise is {self.wheel_noise}; it must lie within 0 and 0.5.")
        if not 0.5 <= self.track_scale <= 5.0:
            raise RobotError(f"model.track_scale is {self.track_scale}; it must lie within 0.5 and 5.")
        if self.camera_pose and self.camera:
            raise RobotError(
                f'model.camera names "{self.camera}" and model.camera_pose mounts another camera; give one of the two.'
            )
        _ = self.mounted_camera

    @property
    def mounted_camera(self) -> CameraPose | None:
        """The camera that ``camera_pose`` describes; None = one of the file. Raises RobotError if it is not five
        numbers in their ranges.
        """
        if not self.camera_pose:
            return None
        try:
            pose = CameraPose(*(float(part) for part in self.camera_pose.split(",")))
        except (TypeError, ValueError) as err:
            raise RobotError(
                f"model.camera_pose is '{self.camera_pose}'; give x,y,z,pitch,fovy in m, m, m, deg, deg, as in "
                "0.05,0,0.3,10,60."
            ) from err
        if not all(map(math.isfinite, pose)):
            raise RobotError(f"model.camera_pose is '{self.camera_pose}'; all five numbers must be finite.")
        if abs(pose.pitch_deg) > MAX_TILT_DEG:
            raise RobotError(
                f"model.camera_pose tilts the camera by {pose.pitch_deg:g} degrees; it must look within "
                f"{MAX_TILT_DEG:g} degrees of the horizontal."
            )
        if not 10.0 <= pose.fovy_deg <= 150.0:
            raise RobotError(
                f"model.camera_pose has a vertical field of view of {pose.fovy_deg:g} degrees; it must lie within 10 "
                "and 150 degrees."
            )
        if not 0.02 <= pose.z_m <= 3.0 or max(abs(pose.x_m), abs(pose.y_m)) > MAX_ASIDE_M:
            raise RobotError(
                f"model.camera_pose puts the camera at ({pose.x_m:g}, {pose.y_m:g}, {pose.z_m:g}) m in the base frame; "
                f"its height must lie within 0.02 and 3 m and it must be within {MAX_ASIDE_M:g} m of the base."
            )
        return pose


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
