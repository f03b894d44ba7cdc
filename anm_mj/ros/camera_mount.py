"""How a live robot carries its camera: images that lie on their side are turned, and one that looks away is refused."""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.robot_camera import ROUNDING_DEG, UPRIGHT_DEG, aside_deg, roll_deg, tilt_deg
from anm_mj.robot.robot_config import MAX_ASIDE_DEG, MAX_TILT_DEG
from anm_mj.ros.rgbd_intake import Rgbd
from anm_mj.types import Intrinsics

_T_CAMERA_TURNED = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""The camera of an image that was turned by 90 degrees counter-clockwise, in the axes of the original: what is to the
right in the turned image was below."""

_logger = logging.getLogger(__name__)


def require_view_ahead(T_base_camera: Float[np.ndarray, "4 4"], frame: str, base_frame: str) -> None:
    """Accept a camera that looks as nearly ahead as that of a simulated robot must; ``frame`` is its own.

    Raises RobotError where it looks more than 30 degrees aside, or more than 45 degrees up or down.
    """
    tilt, aside = tilt_deg(T_base_camera), aside_deg(T_base_camera)
    if abs(tilt) > MAX_TILT_DEG + ROUNDING_DEG:
        raise RobotError(
            f"The camera in the frame '{frame}' looks {abs(tilt):.0f} degrees {'down' if tilt > 0 else 'up'}; it must "
            f"look within {MAX_TILT_DEG:g} degrees of the horizontal: level the camera or the robot's head, or put its "
            "pose on tf right."
        )
    if abs(aside) > MAX_ASIDE_DEG + ROUNDING_DEG:
        raise RobotError(
            f"The camera in the frame '{frame}' looks {abs(aside):.0f} degrees to the "
            f"{'left' if aside > 0 else 'right'} of where '{base_frame}' drives; it must look within {MAX_ASIDE_DEG:g} "
            "degrees of that: turn the camera or the robot's head ahead, or put its pose on tf right."
        )


def turns_to_upright(T_base_camera: Float[np.ndarray, "4 4"]) -> int:
    """Turns of an image by 90 degrees counter-clockwise, 0 to 3, after which it is as nearly upright as it can be."""
    roll = roll_deg(T_base_camera)
    turns = -round(roll / 90.0)
    left = roll + 90.0 * turns
    if turns:
        _logger.info("The camera is mounted rolled by %.0f degrees; its images are turned upright.", roll)
    if abs(left) > UPRIGHT_DEG:
        _logger.warning(
            "The camera is mounted rolled by %.0f degrees, and images are turned by multiples of 90 alone: what its "
            "views show is expected as if they were upright.",
            roll,
        )
    return turns % 4


def turned_pose(T_base_camera: Float[np.ndarray, "4 4"], turns: int) -> Float[np.ndarray, "4 4"]:
    """``T_base_camera`` of the images that :func:`turned` gives."""
    for _ in range(turns):
        T_base_camera = T_base_camera @ _T_CAMERA_TURNED
    return T_base_camera


def turned(seen: Rgbd, turns: int) -> Rgbd:
    """An image after so many turns by 90 degrees counter-clockwise, with its calibration; the same one after none."""
    if not turns:
        return seen
    camera = seen.intrinsics
    for _ in range(turns):
        camera = _turned_camera(camera)
    rgb, depth_m = (np.ascontiguousarray(np.rot90(pixels, turns)) for pixels in (seen.rgb, seen.depth_m))
    return replace(seen, rgb=rgb, depth_m=depth_m, intrinsics=camera)


def _turned_camera(camera: Intrinsics) -> Intrinsics:
    """The calibration after a turn by 90 degrees counter-clockwise: the right edge of the image becomes its top."""
    # Principal points count from the edge of the image, not from the centre of the first pixel.
    return Intrinsics(camera.height, camera.width, camera.fy, camera.fx, camera.cy, camera.width - camera.cx)
