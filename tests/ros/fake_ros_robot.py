"""A robot that speaks ROS 2, without a simulator: a point in the box room whose senses can be made to fail."""

import io
import math
import threading
import time

import numpy as np
from PIL import Image

from anm_mj.frames import move_pose, pose_matrix
from anm_mj.io.bag_images import DEPTH_HEADER
from anm_mj.ros import names
from anm_mj.ros.node import LATCHED, SENSOR, STATE, Node
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, camera_pose, room_depth

CAMERA = Intrinsics.from_fov(64, 48, math.radians(75.0))
PERIOD_S, IMAGE_EVERY = 0.02, 3
RADIUS_M = 0.18
COLOUR_PACKED, DEPTH_PACKED = f"{names.COLOUR}/compressed", f"{names.DEPTH}/compressedDepth"
T_BASE_CAMERA = camera_pose(Pose2(0.0, 0.0, 0.0), height_m=1.25)


class FakeRosRobot:
    """Serves in a thread of its own; ``broken`` names what fails."""

    def __init__(self, node: Node, pose: Pose2 | None = None, *, packed: bool = False) -> None:
        """Whether images are compressed, and the pose is on ``tf`` alone."""
        self.packed = packed
        self.node, self.pose = node, pose or Pose2(-1.0, 0.0, 0.0)
        self.broken: set[str] = set()
        """``images``, ``odometry``, ``clock`` (it jumps), ``encoding``, ``size``, ``stamps``, ``frozen`` wheels."""
        self.obstacle_m = math.inf
        """Depth of something right before the camera [m]."""
        self.commands: list[tuple[float, float, float]] = []
        """When which velocities came."""
        self.speeds: list[tuple[float, float]] = []
        self.touched = False
        self.stamp_s = 100.0
        self._twist, self._heard_s = (0.0, 0.0), 0.0
        kinds = {names.DEPTH_INFO: (names.CAMERA_INFO, SENSOR), names.TF_STATIC: (names.TF_TYPE, LATCHED)}
        if packed:
            kinds |= {topic: (names.COMPRESSED, SENSOR) for topic in (COLOUR_PACKED, DEPTH_PACKED)}
            kinds |= {names.TF: (names.TF_TYPE, STATE)}
        else:
            kinds |= {topic: (names.IMAGE, SENSOR) for topic in (names.COLOUR, names.DEPTH)}
            kinds |= {names.ODOMETRY: (names.ODOMETRY_TYPE, STATE)}
        self.to = {topic: node.publisher(topic, kind, delivery) for topic, (kind, delivery) in kinds.items()}
        node.subscribe(names.COMMAND, names.TWIST, lambda message, _: self._command(message), STATE)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def _command(self, twist) -> None:
        self._twist, self._heard_s = (twist.linear.x, twist.angular.z), time.monotonic()
        self.commands.append((self._heard_s, *self._twist))

    @property
    def speed(self) -> float:
        """What it is told now, as a number that is 0 at rest."""
        return abs(self._twist[0]) + abs(self._twist[1])

    def __enter__(self):
        make = self.node.messages
        links = [(names.BASE, names.CAMERA, T_BASE_CAMERA)]
        self.to[names.TF_STATIC].publish(make.transforms(0.0, links))
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()

    def _serve(self) -> None:
        count = 0
        while not self._end.wait(PERIOD_S):
            self.stamp_s += PERIOD_S + 30.0 * ("clock" in self.broken)
            self.broken.discard("clock")
            self._move()
            make, now_s = self.node.messages, self.stamp_s
            if self.packed:
                self.to[names.TF].publish(make.transforms(now_s, [make.base_link(names.ODOM, names.BASE, self.pose)]))
            elif "odometry" not in self.broken:
                self.to[names.ODOMETRY].publish(make.odometry(now_s, names.ODOM, names.BASE, self.pose))
            count += 1
            if count % IMAGE_EVERY == 0 and "images" not in self.broken:
                self._look(now_s)

    def _move(self) -> None:
        forward, turn = (0.0, 0.0) if time.monotonic() - self._heard_s > 0.5 else self._twist
        if "frozen" in self.broken:
            return
        moved = move_pose(self.pose, forward * PERIOD_S, turn * PERIOD_S)
        low, high = ROOM_LOW_M[:2] + RADIUS_M, ROOM_HIGH_M[:2] - RADIUS_M
        inside = (low <= moved.xy_m).all() and (moved.xy_m <= high).all()
        self.touched |= not inside
        self.pose = moved if inside else self.pose

    def _look(self, now_s: float) -> None:
        make = self.node.messages
        T = pose_matrix(self.pose) @ T_BASE_CAMERA
        depth_m = room_depth(T, CAMERA)
        depth_m[20:28, 28:36] = np.minimum(depth_m[20:28, 28:36], self.obstacle_m)
        rgb = np.clip(40.0 * depth_m[..., None] + np.array([20, 60, 100]), 0, 255).astype(np.uint8)
        if "size" in self.broken:
            depth_m = depth_m[::2, ::2]
        image = make.image(now_s, names.CAMERA, depth_m)
        if "encoding" in self.broken:
            image = make.image(now_s, names.CAMERA, rgb)
        self.to[names.DEPTH_INFO].publish(make.camera_info(now_s, names.CAMERA, CAMERA))
        if self.packed:
            depth_mm = np.where(np.isfinite(depth_m), np.round(1e3 * depth_m), 0).astype(np.uint16)
            packed = DEPTH_HEADER.pack(0, 0.0, 0.0) + png(depth_mm)
            self._publish_packed(COLOUR_PACKED, now_s, "rgb8; png compressed rgb8", png(rgb))
            self._publish_packed(DEPTH_PACKED, now_s, "16UC1; compressedDepth png", packed)
            return
        self.to[names.COLOUR].publish(make.image(now_s - 5.0 * ("stamps" in self.broken), names.CAMERA, rgb))
        self.to[names.DEPTH].publish(image)

    def _publish_packed(self, topic: str, now_s: float, form: str, data: bytes) -> None:
        make, pixels = self.node.messages, np.frombuffer(data, np.uint8)
        header = make.header(now_s, names.CAMERA)
        self.to[topic].publish(make.make(names.COMPRESSED, header=header, format=form, data=pixels))


def png(pixels: np.ndarray) -> bytes:
    """A picture as a file."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "png")
    return file.getvalue()
