"""A whole run as a ROS 2 bag with the messages that a robot would have published."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.export.floor_plan import survey_of
from anm_mj.export.images import image_intrinsics
from anm_mj.export.surface import surface_points
from anm_mj.frames import pose_matrix
from anm_mj.io.read_run import Run
from anm_mj.io.ros_messages import RosMessages, nanoseconds
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.write import writing
from anm_mj.replay.pictures import kept_images
from anm_mj.replay.timeline import Timeline
from anm_mj.types import Intrinsics
from anm_mj.utils.files import beside
from anm_mj.utils.progress import Progress, unheard

MAP, ODOM, BASE, LINK, CAMERA = "map", "odom", "base_link", "camera_link", "camera_optical_frame"
T_LINK_CAMERA = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Camera axes (x right, y down) in those of a link (x ahead, y left), as REP 103 has both."""
_LATCHED = ("/tf_static", "/map", "/surface")
"""Topics whose last message also goes to who subscribes later."""
_JPEG = "rgb8; jpeg compressed bgr8"
"""What ``image_transport`` writes of colour images: it decodes them as BGR and turns them only where it reads so."""
_OWN_FILES = ("metadata.yaml", "rosbag.mcap")
_STILL = 1e-6
"""A camera whose pose on the base changes by less, in metres and parts of a matrix, is fixed to it."""


def export_rosbag(run: Run, out: Path, on_progress: Progress = unheard) -> list[Path]:
    """``rosbag/``: a ROS 2 bag in MCAP.

    ``/tf`` and ``/tf_static`` (``map``, ``odom``, ``base_link``, ``camera_link``, ``camera_optical_frame``), ``/odom``,
    ``/camera/color/image_raw/compressed``, ``/camera/color/camera_info``, ``/camera/depth/image_raw`` (16UC1,
    millimetres), ``/camera/depth/camera_info``, ``/plan``, ``/plan/reason``, and at the end ``/map`` and ``/surface``.
    Poses are those that the robot believed, so ``odom`` lies where ``map`` does. ``/tf_static``, ``/map`` and
    ``/surface`` are latched. Raises RunFolderError if the package rosbags is missing, a file of the run is damaged, or
    the bag cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
    except ImportError as err:
        raise RunFolderError("ROS bags need the package rosbags: pip install 'anm-mj[ros]'.") from err
    folder = out / "rosbag"
    partial = beside(folder)
    with writing(folder):
        _require_own(folder)
        try:
            # 8 is what Humble reads, too.
            with Writer(partial / "rosbag", version=8, storage_plugin=StoragePlugin.MCAP) as bag:
                _write_run(run, _BagMessages(bag), on_progress)
            shutil.rmtree(folder, ignore_errors=True)
            (partial / folder.name).replace(folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return [folder]


def _require_own(folder: Path) -> None:
    """Refuse to replace what no export has written. Raises RunFolderError."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise RunFolderError(f"{folder} is no folder of an export; remove it, or choose another --out.")
    other = sorted(path.name for path in folder.iterdir() if path.name not in _OWN_FILES) if folder.is_dir() else []
    if other:
        raise RunFolderError(f"{folder} holds {other[0]}, which no export writes; choose another --out.")


class _BagMessages(RosMessages):
    """Writes messages to a bag, each topic with its type."""

    def __init__(self, bag: Any) -> None:
        super().__init__()
        self._bag = bag
        self._connections: dict[str, Any] = {}

    def write(self, topic: str, time_s: float, message: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(
                topic,
                message.__msgtype__,
                typestore=self.store,
                offered_qos_profiles=[_latched()] if topic in _LATCHED else (),
            )
        self._bag.write(self._connections[topic], nanoseconds(time_s), self.to_cdr(message))


def _latched() -> Any:
    """Reliable and transient local, one message deep."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    for_ever = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        for_ever,
        for_ever,
        QosLiveliness.AUTOMATIC,
        for_ever,
        avoid_ros_namespace_conventions=False,
    )


def _write_run(run: Run, to: _BagMessages, on_progress: Progress) -> None:
    timeline = Timeline(run)
    colour = image_intrinsics(run) if kept_images(run) else None
    mounts = [np.linalg.inv(pose_matrix(each.pose)) @ each.T_world_camera @ T_LINK_CAMERA.T for each in run.frames]
    # A late image shows what the robot saw from where it was then. When it looks first, it stands.
    mounts = [mounts[0] if each.image_age_s else own for each, own in zip(run.frames, mounts, strict=True)]
    is_fixed = all(np.abs(T - mounts[0]).max() < _STILL for T in mounts)
    begin = run.frames[0].time_s
    static = [(BASE, LINK, mounts[0])] if is_fixed else []
    to.write("/tf_static", begin, to.transforms(begin, [*static, (LINK, CAMERA, T_LINK_CAMERA)]))
    for index, frame in enumerate(run.frames):
        if frame.is_lost:
            continue
        now = frame.time_s
        links = [(MAP, ODOM, np.eye(4)), to.base_link(ODOM, BASE, frame.pose)]
        if frame.image_age_s:
            then = frame.image_time_s
            T_world_base = frame.T_world_camera @ T_LINK_CAMERA.T @ np.linalg.inv(mounts[index])
            to.write("/tf", then, to.transforms(then, [(MAP, ODOM, np.eye(4)), (ODOM, BASE, T_world_base)]))
        to.write("/tf", now, to.transforms(now, links if is_fixed else [*links, (BASE, LINK, mounts[index])]))
        to.write("/odom", now, to.odometry(now, ODOM, BASE, frame.pose))
        _write_depth(run, frame, to)
        if colour is not None:
            _write_colour(run, frame, colour, to)
        decided = int(timeline.plan_of_frame[index])
        if decided >= 0 and run.plans[decided]["step"] == frame.step:
            to.write("/plan", now, to.path(now, MAP, timeline.plan(decided).path_xy_m))
            reason = run.plans[decided].get("reason", "")
            to.write("/plan/reason", now, to.make("std_msgs/msg/String", data=reason))
        on_progress(index + 1, timeline.num_frames)
    last = run.frames[-1].time_s
    if run.folder.survey.is_file():
        topdown = survey_of(run).topdown
        assert topdown is not None
        to.write("/map", last, to.occupancy(last, MAP, topdown))
    if run.folder.mesh.is_file():
        to.write("/surface", last, to.cloud(last, MAP, *surface_points(run)))


def _write_depth(run: Run, frame: FrameRecord, to: _BagMessages) -> None:
    depth_mm, taken = run.depth_mm(frame), frame.image_time_s
    to.write("/camera/depth/image_raw", taken, to.image(taken, CAMERA, depth_mm))
    # The reduced depth keeps the first pixel of each block of the camera's image.
    rows, cols = depth_mm.shape
    camera = run.intrinsics.scaled(cols, rows, first_of_block=True)
    to.write("/camera/depth/camera_info", taken, to.camera_info(taken, CAMERA, camera))


def _write_colour(run: Run, frame: FrameRecord, camera: Intrinsics, to: _BagMessages) -> None:
    data, taken = np.frombuffer(run.picture_bytes(run.folder.image(frame.step)), np.uint8), frame.image_time_s
    header = to.header(taken, CAMERA)
    image = to.make("sensor_msgs/msg/CompressedImage", header=header, format=_JPEG, data=data)
    to.write("/camera/color/image_raw/compressed", taken, image)
    to.write("/camera/color/camera_info", taken, to.camera_info(taken, CAMERA, camera))
