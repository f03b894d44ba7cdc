"""Messages of ROS 2, made and serialised without ROS: what a bag holds, and what goes over the wire."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from anm_mj.frames import pose_matrix
from anm_mj.types import FREE, OCCUPIED, Intrinsics, Pose2, TopDownMap

FLOAT32, UINT32 = 7, 6
"""Numbers of the types of a field of ``sensor_msgs/PointField``."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
"""The quaternion of no rotation, scalar last."""
_ENCODINGS = {"|u1": "rgb8", "<u2": "16UC1", "<f4": "32FC1"}
"""Of an image, by the type of its numbers."""


class RosMessages:
    """Makes messages of the types that all ROS 2 distributions since Humble share; times are in seconds. Raises
    ModuleNotFoundError if the package rosbags is missing.
    """

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)

    def make(self, kind: str, /, **fields: Any) -> Any:
        """A message or a part of one, of a type such as ``std_msgs/msg/Header``."""
        return self.store.types[kind](**fields)

    def to_cdr(self, message: Any) -> bytes:
        """A message as it goes over the wire and into a bag."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def header(self, time_s: float, frame_id: str) -> Any:
        """When and in which frame."""
        return self.make("std_msgs/msg/Header", stamp=self.stamp(time_s), frame_id=frame_id)

    def stamp(self, time_s: float) -> Any:
        """A time."""
        sec, nanosec = divmod(nanoseconds(time_s), 10**9)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def point(self, xyz: Any) -> Any:
        """A place [m]."""
        x, y, z = (float(value) for value in xyz)
        return self.make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def vector(self, xyz: Any) -> Any:
        """A translation or a velocity."""
        x, y, z = (float(value) for value in xyz)
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def quaternion(self, xyzw: Any) -> Any:
        """A rotation."""
        x, y, z, w = (float(value) for value in xyzw)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, xyz: Any, xyzw: Any = UPRIGHT) -> Any:
        """A place [m] and a rotation."""
        return self.make("geometry_msgs/msg/Pose", position=self.point(xyz), orientation=self.quaternion(xyzw))

    def twist(self, forward_mps: float, turn_radps: float) -> Any:
        """A velocity of the base in its own axes."""
        linear, angular = self.vector((forward_mps, 0.0, 0.0)), self.vector((0.0, 0.0, turn_radps))
        return self.make("geometry_msgs/msg/Twist", linear=linear, angular=angular)

    def transforms(self, time_s: float, links: Sequence[tuple[str, str, Float[np.ndarray, "4 4"]]]) -> Any:
        """Links of the tree of frames: parent, child and ``T_parent_child`` each."""
        found = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(time_s, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.vector(T[:3, 3]),
                    rotation=self.quaternion(Rotation.from_matrix(T[:3, :3]).as_quat()),
                ),
            )
            for parent, child, T in links
        ]
        return self.make("tf2_msgs/msg/TFMessage", transforms=found)

    def odometry(
        self, time_s: float, frame: str, child: str, pose: Pose2, twist: Any = None, variances: tuple[float, ...] = ()
    ) -> Any:
        """A pose of the base, its velocity in its own axes (None = at rest), and the variances of x, y, yaw."""
        covariance = np.zeros(36)
        if variances:
            covariance[[0, 7, 35]] = variances
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time_s, frame),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.base_pose(pose), covariance=covariance),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist or self.twist(0.0, 0.0), covariance=covariance
            ),
        )

    def base_pose(self, pose: Pose2) -> Any:
        """A pose of a base on the floor."""
        half = pose.yaw_rad / 2.0
        return self.pose((pose.x_m, pose.y_m, 0.0), (0.0, 0.0, np.sin(half), np.cos(half)))

    def base_link(self, parent: str, child: str, pose: Pose2) -> tuple[str, str, Float[np.ndarray, "4 4"]]:
        """A base on the floor as a link for :meth:`transforms`."""
        return parent, child, pose_matrix(pose)

    def image(self, time_s: float, frame: str, pixels: np.ndarray) -> Any:
        """Colour (uint8, ``h w 3``), depth in millimetres (uint16) or in metres (float32)."""
        rows, cols = pixels.shape[:2]
        data = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder("<"), copy=False))
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(time_s, frame),
            height=rows,
            width=cols,
            encoding=_ENCODINGS[data.dtype.str],
            is_bigendian=0,
            step=data.strides[0],
            data=data.view(np.uint8).ravel(),
        )

    def camera_info(self, time_s: float, frame: str, camera: Intrinsics) -> Any:
        """The calibration of a pinhole camera."""
        # ROS measures the principal point from the centre of the first pixel.
        cx, cy = camera.cx - 0.5, camera.cy - 0.5
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(time_s, frame),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=np.array([camera.fx, 0.0, cx, 0.0, camera.fy, cy, 0.0, 0.0, 1.0]),
            r=np.eye(3).ravel(),
            p=np.array([camera.fx, 0.0, cx, 0.0, 0.0, camera.fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    def path(self, time_s: float, frame: str, path_xy_m: Float[np.ndarray, "k 2"]) -> Any:
        """A polyline on the floor."""
        header = self.header(time_s, frame)
        poses = [
            self.make("geometry_msgs/msg/PoseStamped", header=header, pose=self.pose((x, y, 0.0)))
            for x, y in path_xy_m.tolist()
        ]
        return self.make("nav_msgs/msg/Path", header=header, poses=poses)

    def occupancy(self, time_s: float, frame: str, topdown: TopDownMap) -> Any:
        """A top-down map as ``nav_msgs/OccupancyGrid``."""
        # 0 to 100 is the probability of an obstacle in per cent, -1 is unknown.
        cells = np.full(topdown.state.shape, -1, np.int8)
        cells[topdown.state == FREE], cells[topdown.state == OCCUPIED] = 0, 100
        rows, cols = topdown.state.shape
        meta = self.make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self.stamp(time_s),
            resolution=topdown.resolution_m,
            width=cols,
            height=rows,
            origin=self.pose((*topdown.origin_xy_m, 0.0)),
        )
        header = self.header(time_s, frame)
        return self.make("nav_msgs/msg/OccupancyGrid", header=header, info=meta, data=cells.ravel())

    def cloud(
        self, time_s: float, frame: str, points: Float[np.ndarray, "n 3"], colours: UInt8[np.ndarray, "n 3"]
    ) -> Any:
        """Coloured points [m] as ``sensor_msgs/PointCloud2``."""
        packed = np.zeros(len(points), [("xyz", "<f4", 3), ("rgb", "<u4")])
        red, green, blue = colours.astype(np.uint32).T
        packed["xyz"], packed["rgb"] = points, red << 16 | green << 8 | blue
        kinds = (("x", 0, FLOAT32), ("y", 4, FLOAT32), ("z", 8, FLOAT32), ("rgb", 12, UINT32))
        fields = [
            self.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=kind, count=1)
            for name, offset, kind in kinds
        ]
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time_s, frame),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=packed.itemsize,
            row_step=packed.nbytes,
            data=packed.view(np.uint8),
            is_dense=True,
        )


def nanoseconds(time_s: float) -> int:
    """A time as ROS counts it."""
    return round(time_s * 1e9)


def seconds(stamp: Any) -> float:
    """The time of a stamp [s]."""
    return stamp.sec + 1e-9 * stamp.nanosec


def place_and_turn(xyz: Any, q: Any) -> Float[np.ndarray, "7"]:
    """Position [m] and quaternion, scalar last, of the two parts of a pose."""
    return np.array([xyz.x, xyz.y, xyz.z, q.x, q.y, q.z, q.w], float)
