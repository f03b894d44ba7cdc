"""Recordings of a robot: ROS 1 and ROS 2 bags, and MCAP files with ROS 2 messages, through the package rosbags.

Colour, depth, calibration and poses come out of their messages; which topics those are is found by their types, and
said by the user where several fit. Depth has to be registered to the colour image, as drivers publish it on request
(``aligned_depth_to_color``).
"""

from __future__ import annotations

import logging
import os
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.bag_images import colour_image, depth_image, encoding_of
from anm_mj.io.bag_limits import limit_rosbags
from anm_mj.io.bag_poses import FrameTree, Track
from anm_mj.io.bag_reader import BagReader, Stamp
from anm_mj.io.sequence import Frame, Sequence, say_left_out
from anm_mj.io.sequence_poses import MATCH_S, bridged, nearest_index
from anm_mj.types import Intrinsics
from anm_mj.utils.read_file import open_regular

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CALIBRATION = "sensor_msgs/msg/CameraInfo"
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
_ROLES = ("colour", "depth", "camera", "pose")
"""What a topic can be named for."""
_TF = "tf"
"""Stands for the tree of frames where a topic of poses is named."""

_logger = logging.getLogger(__name__)


def is_recording(path: Path) -> bool:
    """Whether a path is a bag: a ``.bag`` or ``.mcap`` file, or a folder with a ``metadata.yaml``."""
    return path.suffix in (".bag", ".mcap") or os.path.isfile(path / "metadata.yaml")


def read_recording(
    path: Path,
    topics: Mapping[str, str],
    depth_unit_m: float | None = None,
    camera: tuple[float, float, float, float] | None = None,
    *,
    needs_poses: bool = True,
) -> Sequence:
    """Open a recording.

    Args:
        path: The bag.
        topics: Topics by role (``colour``, ``depth``, ``camera``, ``pose``), where they are not the only ones that fit;
            the topic of ``pose`` may be ``tf``.
        depth_unit_m: Metres per unit of 16-bit depth; None = 1 mm, as REP 118 has it.
        camera: fx, fy, cx, cy of the colour images [px]; None = as the calibration says.
        needs_poses: Whether frames without a pose are left out, and a bag that has no poses is refused.

    Raises:
        RunFolderError: The package rosbags is missing, the bag cannot be read, or it does not say where the camera was.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as err:
        raise RunFolderError("Bags need the package rosbags: pip install 'anm-mj[ros]'.") from err
    limit_rosbags()
    unknown = [role for role in topics if role not in _ROLES]
    if unknown:
        raise RunFolderError(f"There is no role '{unknown[0]}' of a topic; choose from {', '.join(_ROLES)}.")
    try:
        # The package would wait for a FIFO.
        for file in sorted(path.iterdir()) if path.is_dir() else (path,):
            if not file.is_dir():
                open_regular(file).close()
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
        bag = _Bag(path, reader, topics, depth_unit_m or 0.001, camera, needs_poses)
        # The images are read later; the file is closed with the last of them.
        weakref.finalize(bag, reader.close)
        return bag.sequence()
    except RunFolderError:
        raise
    except Exception as err:
        # Readers raise whatever the damaged bytes lead them to.
        raise RunFolderError(f"{path} cannot be read as a recording ({str(err) or type(err).__name__}).") from err


@dataclass(eq=False)
class _Bag(BagReader):
    """Finds camera, images and poses in an open bag."""

    depth_unit_m: float
    camera: tuple[float, float, float, float] | None
    needs_poses: bool

    def sequence(self) -> Sequence:
        """The frames of the bag; it stays open for their images."""
        colour, depth = self._image_topic("colour"), self._image_topic("depth")
        depths, camera_frame = self.stamps(depth)
        colours, colour_frame = self.stamps(colour)
        if colour_frame != camera_frame:
            _logger.warning(
                "%s: depth is of the frame '%s' and colour of '%s'; their pixels are taken for the same ones, as of "
                "depth that is registered to the colour.",
                self.path,
                camera_frame,
                colour_frame,
            )
        intrinsics, distortion = self._intrinsics(colour, depth, camera_frame)
        says_poses = self.needs_poses or self._says_poses(camera_frame)
        pose_at = self._poses(camera_frame) if says_poses else lambda _: None
        single = {stamp.time_s: stamp for stamp in reversed(depths)}
        say_left_out(self.path, len(single), len(depths), "their depth has the time of another one")
        pairs = _pairs(sorted(single.values()), colours)
        say_left_out(self.path, len(pairs), len(single), f"no colour is within {MATCH_S:g} s of their depth")
        poses = [pose_at(depth_stamp.time_s) for depth_stamp, _ in pairs]
        kept = [k for k, T in enumerate(poses) if T is not None or not self.needs_poses]
        say_left_out(self.path, len(kept), len(pairs), "no pose of the camera is known at their time")
        matrices, missing = bridged([pairs[k][0].time_s for k in kept], [poses[k] for k in kept])
        frames = []
        for k, T in zip(kept, matrices, strict=True):
            depth_stamp, colour_stamp = pairs[k]
            frames.append(
                Frame(
                    depth_stamp.time_s - pairs[0][0].time_s,
                    self.later(colour, colour_stamp, colour_image),
                    self.later(depth, depth_stamp, lambda message: depth_image(message, self.depth_unit_m)),
                    T,
                )
            )
        return Sequence(
            self.path,
            intrinsics,
            self.depth_unit_m,
            tuple(frames),
            resize=True,
            distortion=distortion,
            has_poses=self.needs_poses or len(missing) < len(kept),
            interpolated=missing,
        )

    def _says_poses(self, camera_frame: str) -> bool:
        """Whether the user names poses, or there are any."""
        if "pose" in self.topics or self.of_type(*_POSES):
            return True
        try:
            return self._tree().moves(camera_frame)
        except ValueError:
            return False

    def _image_topic(self, role: str) -> str:
        """The topic of colour or depth: the one that was named, or the only one whose first image is of that kind."""
        fit = [topic for topic in self.of_type(*_IMAGES) if encoding_of(self.first(topic)) == role]
        # .../image_raw/compressed is the twin of .../image_raw.
        return self.chosen(role, fit, [topic for topic in fit if topic.rpartition("/")[0] not in fit])

    def _intrinsics(self, colour: str, depth: str, camera_frame: str) -> tuple[Intrinsics, LensDistortion | None]:
        """As the user says; else of the calibration beside the depth, or of the only one that has its frame."""
        if self.camera is not None:
            rows, cols = colour_image(self.first(colour)).shape[:2]
            return Intrinsics(cols, rows, *self.camera), None
        there = self.of_type(_CALIBRATION)
        beside = [
            topic for images in (depth, colour) for topic in there if topic.rpartition("/")[0] in _folders(images)
        ]
        same = [topic for topic in there if self.first(topic).header.frame_id == camera_frame]
        topic = self.chosen("camera", there, beside[:1] or same)
        found = self.first(topic)
        if self.changes(topic):
            raise RunFolderError(
                f"{topic} in {self.path} changes in the course of the bag, but a sequence has one camera; give it by "
                "--camera FX,FY,CX,CY."
            )
        # A bag of ROS 1 has upper-case names.
        matrix = np.asarray(found.k if hasattr(found, "k") else found.K, np.float64).reshape(3, 3)
        if not (matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0 and found.width > 0 and found.height > 0):
            raise RunFolderError(f"The calibration in {self.path} is empty; give it by --camera FX,FY,CX,CY.")
        region = found.roi
        if (region.width, region.height) not in ((0, 0), (found.width, found.height)):
            raise RunFolderError(
                f"{topic} in {self.path} says that images are a region of {region.width} x {region.height} pixels of "
                f"{found.width} x {found.height}; give their own camera by --camera FX,FY,CX,CY."
            )
        bent = None
        if "rect" not in depth.rpartition("/")[2]:
            coefficients = np.asarray(found.d if hasattr(found, "d") else found.D, np.float64).tolist()
            try:
                bent = LensDistortion.of(found.distortion_model or "plumb_bob", coefficients, f"by {topic}")
            except ValueError as err:
                raise RunFolderError(f"{topic} in {self.path}: {err}; record rectified images.") from err
        # ROS measures the principal point from the centre of the first pixel.
        fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5
        return Intrinsics(int(found.width), int(found.height), float(fx), float(fy), float(cx), float(cy)), bent

    def _poses(self, camera_frame: str) -> Callable[[float], Float[np.ndarray, "4 4"] | None]:
        """Where the camera was at a time: from tf where it leads there, else from the only topic of poses."""
        tree = self._tree()
        fit = self.of_type(*_POSES)
        named = self.topics.get("pose")
        try:
            if named in (None, _TF) and tree.moves(camera_frame):
                root = tree.chain(camera_frame)[-1]
                return lambda time_s: tree.pose(camera_frame, root, time_s)
            if named == _TF or (named is None and not fit and tree.parents):
                raise RunFolderError(
                    f"The frames in {self.path} say nothing about how '{camera_frame}' moves; record /tf and "
                    "/tf_static, or poses of the camera."
                )
            topic = self.chosen("pose", fit, fit)
            track, moved = self._track(topic)
            if moved is None:
                return track.at
            # An odometry tells of its own frame, and the frames how the camera stands in that.
            fixed = tree.pose(camera_frame, moved, 0.0)
        except ValueError as err:
            raise RunFolderError(
                f"The frames in {self.path} do not say where '{camera_frame}' is ({err}); name a topic with poses of "
                "the camera by --topic pose=NAME."
            ) from err
        if fixed is None:
            raise RunFolderError(
                f"{topic} in {self.path} tells of the frame '{moved}', and no /tf_static how '{camera_frame}' stands "
                "in it; record /tf_static, or name a topic with poses of the camera by --topic pose=NAME."
            )

        def at(time_s: float) -> Float[np.ndarray, "4 4"] | None:
            T = track.at(time_s)
            return None if T is None else T @ fixed

        return at

    def _tree(self) -> FrameTree:
        tree = FrameTree()
        for topic in self.of_type(*_TRANSFORMS):
            for message in self.messages(topic):
                for one in message.transforms:
                    pose, parent = _pose(one.transform.translation, one.transform.rotation), one.header.frame_id
                    tree.add(parent, one.child_frame_id, _time_s(one.header), pose, static=topic.endswith("static"))
        return tree

    def _track(self, topic: str) -> tuple[Track, str | None]:
        """Poses of a topic, and the frame that moves; None = that of the camera.

        Raises ValueError where there are several.
        """
        track, moved = Track(topic), set()
        for message in self.messages(topic):
            if hasattr(message, "transform"):
                pose = _pose(message.transform.translation, message.transform.rotation)
            else:
                stated = message.pose.pose if hasattr(message.pose, "pose") else message.pose
                pose = _pose(stated.position, stated.orientation)
            moved.add(getattr(message, "child_frame_id", None))
            track.add(_time_s(message.header), pose)
        if len(moved) > 1:
            raise ValueError(f"{topic} tells of several: {', '.join(sorted(map(repr, moved)))}")
        (frame,) = moved or {None}
        if frame == "" and "pose" not in self.topics:
            raise ValueError(f"{topic} does not say of which frame it tells")
        return track, frame or None


def _folders(topic: str) -> tuple[str, ...]:
    parent = topic.rpartition("/")[0]
    return (parent, parent.rpartition("/")[0]) if "ompressed" in topic else (parent,)


def _pairs(depth: list[Stamp], colour: list[Stamp]) -> list[tuple[Stamp, Stamp]]:
    """Each depth image with the colour image that is nearest in time; both lists are in order."""
    times_s = [stamp.time_s for stamp in colour]
    nearest = ((stamp, nearest_index(times_s, stamp.time_s)) for stamp in depth)
    return [(stamp, colour[index]) for stamp, index in nearest if index is not None]


def _time_s(header: Any) -> float:
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def _pose(xyz: Any, q: Any) -> Float[np.ndarray, "7"]:
    return np.array([xyz.x, xyz.y, xyz.z, q.x, q.y, q.z, q.w], dtype=np.float64)
