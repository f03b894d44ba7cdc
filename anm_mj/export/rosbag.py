"""A whole run as a ROS 2 bag with the messages that a robot would have published."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.export.floor_plan import survey_of
from anm_mj.export.images import image_intrinsics
from anm_mj.export.surface import surface_points
from anm_mj.io.read_run import Run
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.write import writing
from anm_mj.replay.pictures import kept_images
from anm_mj.replay.timeline import Timeline
from anm_mj.types import FREE, OCCUPIED, Intrinsics

WORLD, BASE, CAMERA = "map", "base_link", "camera_optical_frame"
FLOAT32, UINT32 = 7, 6
"""Numbers of the types of a field of ``sensor_msgs/PointField``."""


def export_rosbag(
    run: Run, out: Path, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> list[Path]:
    """``rosbag/``: a ROS 2 bag in MCAP.

    ``/tf`` (camera and base in ``map``), ``/odom``, ``/camera/color/image_raw/compressed``,
    ``/camera/color/camera_info``, ``/camera/depth/image_raw`` (16UC1, millimetres), ``/camera/depth/camera_info``,
    ``/plan``, and at the end ``/map`` and ``/surface``. Poses are those that the robot believed.

    Raises:
        RunFolderError: The package rosbags is missing, a file of the run is damaged, or the bag cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as err:
        raise RunFolderError("ROS bags need the package rosbags: pip install 'anm-mj[ros]'.") from err
    folder, partial = out / "rosbag", out / ".rosbag"
    with writing(folder):
        shutil.rmtree(partial, ignore_errors=True)
        try:
            # 8 is what Humble reads, too.
            with Writer(partial / "rosbag", version=8, storage_plugin=StoragePlugin.MCAP) as bag:
                _write_run(run, _Messages(bag, get_typestore(Stores.ROS2_HUMBLE)), on_progress)
            shutil.rmtree(folder, ignore_errors=True)
            (partial / "rosbag").replace(folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return [folder]


@dataclass
class _Messages:
    """Writes messages to a bag, each topic with its type."""

    bag: Any
    store: Any

    def __post_init__(self) -> None:
        self._connections: dict[str, Any] = {}

    def make(self, kind: str, /, **fields: Any) -> Any:
        """A message or a part of one."""
        return self.store.types[kind](**fields)

    def header(self, frame: FrameRecord, frame_id: str) -> Any:
        return self.make("std_msgs/msg/Header", stamp=self.stamp(frame), frame_id=frame_id)

    def stamp(self, frame: FrameRecord) -> Any:
        sec, nanosec = divmod(_nanoseconds(frame), 10**9)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def pose(self, xyz: Any, quaternion: Any) -> Any:
        x, y, z = (float(value) for value in xyz)
        position = self.make("geometry_msgs/msg/Point", x=x, y=y, z=z)
        return self.make("geometry_msgs/msg/Pose", position=position, orientation=self.quaternion(quaternion))

    def quaternion(self, xyzw: Any) -> Any:
        x, y, z, w = (float(value) for value in xyzw)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def vector(self, xyz: Any) -> Any:
        x, y, z = (float(value) for value in xyz)
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def write(self, topic: str, frame: FrameRecord, message: Any) -> None:
        name = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self.bag.add_connection(topic, name, typestore=self.store)
        self.bag.write(self._connections[topic], _nanoseconds(frame), self.store.serialize_cdr(message, name))


def _write_run(run: Run, to: _Messages, on_progress: Callable[[int, int], None]) -> None:
    timeline = Timeline(run)
    colour = image_intrinsics(run) if kept_images(run) else None
    for index, frame in enumerate(run.frames):
        _write_poses(frame, to)
        _write_depth(run, frame, to)
        if colour is not None:
            _write_colour(run, frame, colour, to)
        decided = int(timeline.plan_of_frame[index])
        if decided >= 0 and run.plans[decided]["step"] == frame.step:
            _write_path(timeline.plan(decided).path_xy_m, frame, to)
        on_progress(index + 1, timeline.num_frames)
    if run.folder.survey.is_file():
        _write_map(run, run.frames[-1], to)
    if run.folder.mesh.is_file():
        _write_surface(run, run.frames[-1], to)


def _write_poses(frame: FrameRecord, to: _Messages) -> None:
    half = frame.pose.yaw_rad / 2.0
    base_xyz, base_q = (frame.pose.x_m, frame.pose.y_m, 0.0), (0.0, 0.0, np.sin(half), np.cos(half))
    T = frame.T_world_camera
    camera_q = Rotation.from_matrix(T[:3, :3]).as_quat()
    transforms = [
        to.make(
            "geometry_msgs/msg/TransformStamped",
            header=to.header(frame, WORLD),
            child_frame_id=child,
            transform=to.make(
                "geometry_msgs/msg/Transform", translation=to.vector(xyz), rotation=to.quaternion(quaternion)
            ),
        )
        for child, xyz, quaternion in ((BASE, base_xyz, base_q), (CAMERA, T[:3, 3], camera_q))
    ]
    to.write("/tf", frame, to.make("tf2_msgs/msg/TFMessage", transforms=transforms))
    still = to.make("geometry_msgs/msg/Twist", linear=to.vector(np.zeros(3)), angular=to.vector(np.zeros(3)))
    unknown = np.zeros(36)
    odometry = to.make(
        "nav_msgs/msg/Odometry",
        header=to.header(frame, WORLD),
        child_frame_id=BASE,
        pose=to.make("geometry_msgs/msg/PoseWithCovariance", pose=to.pose(base_xyz, base_q), covariance=unknown),
        twist=to.make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=unknown),
    )
    to.write("/odom", frame, odometry)


def _write_depth(run: Run, frame: FrameRecord, to: _Messages) -> None:
    depth_mm = run.depth_mm(frame)
    rows, cols = depth_mm.shape
    image = to.make(
        "sensor_msgs/msg/Image",
        header=to.header(frame, CAMERA),
        height=rows,
        width=cols,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * cols,
        data=np.ascontiguousarray(depth_mm.astype("<u2")).view(np.uint8).ravel(),
    )
    to.write("/camera/depth/image_raw", frame, image)
    to.write("/camera/depth/camera_info", frame, _calibration(_depth_intrinsics(run, rows, cols), frame, to))


def _depth_intrinsics(run: Run, rows: int, cols: int) -> Intrinsics:
    """Of the reduced depth, which keeps the first pixel of each block of the camera's image."""
    camera = run.intrinsics
    x, y = cols / camera.width, rows / camera.height
    cx, cy = (camera.cx - 0.5) * x + 0.5, (camera.cy - 0.5) * y + 0.5
    return Intrinsics(cols, rows, camera.fx * x, camera.fy * y, cx, cy)


def _write_colour(run: Run, frame: FrameRecord, camera: Intrinsics, to: _Messages) -> None:
    data = np.frombuffer(run.picture_bytes(run.folder.image(frame.step)), np.uint8)
    image = to.make(
        "sensor_msgs/msg/CompressedImage", header=to.header(frame, CAMERA), format="rgb8; jpeg compressed ", data=data
    )
    to.write("/camera/color/image_raw/compressed", frame, image)
    to.write("/camera/color/camera_info", frame, _calibration(camera, frame, to))


def _calibration(camera: Intrinsics, frame: FrameRecord, to: _Messages) -> Any:
    # ROS measures the principal point from the centre of the first pixel.
    cx, cy = camera.cx - 0.5, camera.cy - 0.5
    region = to.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return to.make(
        "sensor_msgs/msg/CameraInfo",
        header=to.header(frame, CAMERA),
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


def _write_path(path_xy_m: Float[np.ndarray, "k 2"], frame: FrameRecord, to: _Messages) -> None:
    header = to.header(frame, WORLD)
    poses = [
        to.make("geometry_msgs/msg/PoseStamped", header=header, pose=to.pose((x, y, 0.0), (0.0, 0.0, 0.0, 1.0)))
        for x, y in path_xy_m.tolist()
    ]
    to.write("/plan", frame, to.make("nav_msgs/msg/Path", header=header, poses=poses))


def _write_map(run: Run, frame: FrameRecord, to: _Messages) -> None:
    topdown = survey_of(run).topdown
    assert topdown is not None
    # 0 to 100 is the probability of an obstacle in per cent, -1 is unknown.
    cells = np.full(topdown.state.shape, -1, np.int8)
    cells[topdown.state == FREE], cells[topdown.state == OCCUPIED] = 0, 100
    rows, cols = topdown.state.shape
    meta = to.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=to.stamp(frame),
        resolution=topdown.resolution_m,
        width=cols,
        height=rows,
        origin=to.pose((*topdown.origin_xy_m, 0.0), (0.0, 0.0, 0.0, 1.0)),
    )
    grid = to.make("nav_msgs/msg/OccupancyGrid", header=to.header(frame, WORLD), info=meta, data=cells.ravel())
    to.write("/map", frame, grid)


def _write_surface(run: Run, frame: FrameRecord, to: _Messages) -> None:
    points, colours = surface_points(run)
    packed = np.zeros(len(points), [("xyz", "<f4", 3), ("rgb", "<u4")])
    red, green, blue = colours.astype(np.uint32).T
    packed["xyz"], packed["rgb"] = points, red << 16 | green << 8 | blue
    kinds = (("x", 0, FLOAT32), ("y", 4, FLOAT32), ("z", 8, FLOAT32), ("rgb", 12, UINT32))
    fields = [
        to.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=kind, count=1)
        for name, offset, kind in kinds
    ]
    cloud = to.make(
        "sensor_msgs/msg/PointCloud2",
        header=to.header(frame, WORLD),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=packed.itemsize,
        row_step=packed.nbytes,
        data=packed.view(np.uint8),
        is_dense=True,
    )
    to.write("/surface", frame, cloud)


def _nanoseconds(frame: FrameRecord) -> int:
    return round(frame.time_s * 1e9)
