"""Colour and depth of a live robot, paired by their stamps."""

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from anm_mj.geometry.lens_distortion import LensDistortion, undistortion
from anm_mj.io.bag_images import colour_image, depth_image, encoding_of
from anm_mj.io.ros_messages import seconds
from anm_mj.io.rosbag import calibration, is_rectified
from anm_mj.ros.health import Health
from anm_mj.types import Intrinsics

_KEPT = 12
"""Images of a kind that wait for the other kind."""
_ALONE = 15
"""After so many depth images in a row without a colour image, the stamps do not meet."""

_Pair = tuple[float, Any, Float32[np.ndarray, "h w"], str]
"""Stamp of the depth [s], colour as it came, depth [m], frame."""


@dataclass(frozen=True)
class Rgbd:
    """Colour and depth of one moment."""

    time_s: float
    """By the stamp of the depth [s]."""
    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    """Planar depth [m]; +inf where the camera says that it looked beyond its range, NaN where it measured nothing."""
    frame: str
    """Of the camera, with the axes of an optical frame."""
    intrinsics: Intrinsics


class RgbdIntake:
    """Takes images in as they come; callbacks and questions may come from different threads."""

    def __init__(self, health: Health, depth_unit_m: float, match_s: float) -> None:
        """Know nothing yet; the arguments are those of :class:`~anm_mj.ros.drive_config.RosConfig`."""
        self._health, self._unit_m, self._match_s = health, depth_unit_m, match_s
        self.colour = self.depth = self.camera = ""
        """Names of the topics, for messages."""
        self._colours: deque[tuple[float, Any]] = deque(maxlen=_KEPT)
        self._depths: deque[tuple[float, Any]] = deque(maxlen=_KEPT)
        self._camera: tuple[Intrinsics, LensDistortion | None] | None = None
        self._shape: tuple[int, ...] | None = None
        self._alone = 0
        self._latest_s = -math.inf
        self._pair: _Pair | None = None
        self._seen: _Pair | None = None
        """The last one whose colour could be decoded."""
        self._news = threading.Condition()
        self.on_depth: Callable[[float, Float32[np.ndarray, "h w"], Intrinsics, str], None] = lambda *_: None
        """Called with each depth image that has its colour: stamp [s], depth [m], camera, frame."""

    @property
    def sources(self) -> tuple[str, str, str]:
        """What must go on, for messages: colour, depth, and the two of one time."""
        return (
            f"the colour on {self.colour}",
            f"the depth on {self.depth}",
            f"images of one time on {self.colour} and {self.depth}",
        )

    @property
    def has_camera(self) -> bool:
        """Whether there is a calibration."""
        return self._camera is not None

    @property
    def latest_s(self) -> float:
        """The stamp of the last pair [s]; -inf before the first."""
        return self._latest_s

    def hear_camera(self, message: Any) -> None:
        """Take in ``sensor_msgs/CameraInfo``."""
        self._camera = calibration(message, self.camera, rectified=is_rectified(self.depth))

    def hear_colour(self, message: Any) -> None:
        """Take in a colour image."""
        self._require("colour", message)
        time_s = seconds(message.header.stamp)
        self._health.hear(self.sources[0], time_s)
        self._put(self._colours, time_s, message)
        self._match()

    def hear_depth(self, message: Any) -> None:
        """Take in a depth image."""
        self._require("depth", message)
        time_s = seconds(message.header.stamp)
        self._health.hear(self.sources[1], time_s)
        self._put(self._depths, time_s, message)
        self._alone += 1
        self._match()
        if self._alone >= _ALONE and self._colours:
            nearest = min((stamp - time_s for stamp, _ in self._colours), key=abs)
            self._health.fault(
                self.colour,
                f"the stamps of {self.colour} and {self.depth} do not meet: the nearest differ by {nearest:+.3f} s, "
                f"and ros.match_s is {self._match_s:g} s",
            )

    def wait_newer(self, than_s: float, within_s: float) -> Rgbd | None:
        """The last pair, once there is one at or after a stamp [s]; None if that takes too long [s]. One whose colour
        cannot be decoded, or is of another size than the depth, is dropped, and a fault.
        """
        with self._news:
            self._news.wait_for(lambda: self._pair is not None and self._pair[0] >= than_s, within_s)
            pair, calibrated = self._pair, self._camera
        # No pair comes before the calibration.
        if pair is None or calibrated is None or pair[0] < than_s:
            return None
        (time_s, colour, depth_m, frame), (camera, bent) = pair, calibrated
        try:
            # To decode every image, asked for or not, would cost too much.
            rgb = colour_image(colour)
            _require_shape(rgb.shape[:2], depth_m.shape)
        except (OSError, ValueError) as err:
            self._health.fault(self.colour, f"{self.colour}: {err}")
            with self._news:
                if self._pair is pair:
                    self._pair = self._seen
            return self.wait_newer(than_s, 0.0)
        self._seen = pair
        if bent is not None:
            rgb = undistortion(camera, bent).colour(rgb)
        return Rgbd(time_s, rgb, depth_m, frame, camera)

    def _require(self, role: str, message: Any) -> None:
        found = encoding_of(message)
        if found != role:
            raise ValueError(f"its images are {found}, not {role}; name the topic of the {role} by --topic {role}=NAME")
        if not hasattr(message, "width"):
            return
        shape = (message.height, message.width)
        self._shape = self._shape or shape
        _require_shape(shape, self._shape)

    def _put(self, there: deque[tuple[float, Any]], time_s: float, message: Any) -> None:
        if there and time_s < there[-1][0]:
            # The clock was set back.
            there.clear()
            self._pair = self._seen = None
            self._latest_s = -math.inf
        there.append((time_s, message))

    def _match(self) -> None:
        """Make a pair of the latest images that belong together, unless it is the last one."""
        if self._camera is None:
            return
        for time_s, message in reversed(self._depths):
            if time_s <= self.latest_s:
                return
            near = min(self._colours, key=lambda colour: abs(colour[0] - time_s), default=None)
            if near is None or abs(near[0] - time_s) > self._match_s or self._comes_nearer(time_s):
                continue
            self._take(time_s, near[1], message)
            return

    def _comes_nearer(self, time_s: float) -> bool:
        """Whether the next colour image, if it comes as long after the last as that after the one before, is nearer to
        a stamp [s] than the last: depth may come before the colour of its time.
        """
        if len(self._colours) < 2:
            return False
        before_s, last_s = self._colours[-2][0], self._colours[-1][0]
        return abs(2.0 * last_s - before_s - time_s) < abs(last_s - time_s)

    def _take(self, time_s: float, colour: Any, depth: Any) -> None:
        assert self._camera is not None
        camera, bent = self._camera
        depth_m = depth_image(depth, self._unit_m, far=True)
        if depth_m.shape != (camera.height, camera.width):
            raise ValueError(
                f"{self.depth} has {depth_m.shape[1]} x {depth_m.shape[0]} pixels, and {self.camera} is of "
                f"{camera.width} x {camera.height}; name the one that belongs to it by --topic camera=NAME"
            )
        if bent is not None:
            depth_m = undistortion(camera, bent).depth(depth_m)
        frame = depth.header.frame_id.lstrip("/")
        with self._news:
            self._pair = time_s, colour, depth_m, frame
            self._latest_s = time_s
            self._alone = 0
            self._news.notify_all()
        self._health.hear(self.sources[2], time_s)
        self.on_depth(time_s, depth_m, camera, frame)


def _require_shape(found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Raises ValueError for an image of other rows and columns than those before."""
    if found != expected:
        raise ValueError(
            f"it gives {found[1]} x {found[0]} pixels after images of {expected[1]} x {expected[0]}; colour and depth "
            "must keep one size and show the same pixels"
        )
