"""An open bag: its messages by topic, when each was made, and where the camera was, from the tree of frames or from a
topic of poses.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.io.bag_poses import FrameTree, Track
from anm_mj.io.ros_messages import place_and_turn, seconds
from anm_mj.io.sequence import SequenceOptions, require_count

_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
_TF = "tf"
"""Stands for the tree of frames where a topic of poses is named."""


class Stamp(NamedTuple):
    """Where a message lies in time."""

    time_s: float
    """When it was made, or is taken to have been [s]."""
    at_ns: int
    """When it was recorded [ns]."""
    stated_s: float
    """When it was made, as its header has it [s]."""


@dataclass(frozen=True)
class Motion:
    """Poses of the camera over time."""

    at: Callable[[float], Float[np.ndarray, "4 4"] | None]
    """``T_world_camera`` at a time; None where it is not known."""
    unknown: Callable[[float], Track | None]
    """Whose poses lack at a time."""


@dataclass(eq=False)
class BagReader:
    """A bag, and what the user says of it."""

    path: Path
    reader: Any
    """A ``rosbags.highlevel.AnyReader``."""
    options: SequenceOptions

    def of_type(self, *types: str) -> list[str]:
        """Topics that hold messages of one of the types."""
        return sorted({one.topic for one in self.reader.connections if one.msgtype in types and one.msgcount > 0})

    def chosen(self, role: str, fit: list[str], preferred: list[str]) -> str:
        """The topic of a role: the one that the user names, or the only preferred one. ``fit`` are all topics that the
        user may name, ``preferred`` those that are taken unless the user names one. Raises RunFolderError if none fits,
        several do, or the named one does not.
        """
        named = self.options.topics.get(role)
        if named is not None:
            if named not in fit:
                there = ", ".join(fit) or f"none of {self._all_topics()}"
                raise RunFolderError(f"{self.path} has no topic '{named}' for {role}; {role} could be {there}.")
            return named
        if len(preferred) == 1:
            return preferred[0]
        if not fit:
            raise RunFolderError(f"{self.path} has no topic for {role}; its topics are {self._all_topics()}.")
        raise RunFolderError(
            f"{self.path} has several topics for {role} ({', '.join(fit)}); name one, as in --topic {role}={fit[0]}."
        )

    def _all_topics(self) -> str:
        return ", ".join(sorted({f"{one.topic} ({one.msgtype})" for one in self.reader.connections})) or "none"

    def messages(self, topic: str) -> Iterator[Any]:
        """All messages of a topic."""
        for connection, _, raw in self._raw(topic):
            yield self.reader.deserialize(raw, connection.msgtype)

    def first(self, topic: str) -> Any:
        """The first message of a topic; raises RunFolderError if there is none."""
        for message in self.messages(topic):
            return message
        raise RunFolderError(f"{self.path} holds no message of {topic}, although it says so; record it again.")

    def changes(self, topic: str) -> bool:
        """Whether the messages of a topic differ by more than their numbers and times."""
        start = 4 if self.reader.is2 else 0
        return len({(bytes(raw[:start]), bytes(raw[12:])) for _, _, raw in self._raw(topic)}) > 1

    def stamps(self, topic: str) -> tuple[list[Stamp], str]:
        """When each image was made, in order, and the frame of all; the images are not decoded. Raises RunFolderError
        if they are of several frames, and ValueError if there are more than are read.
        """
        stamps, frames = [], set()
        for _, at_ns, raw in self._raw(topic):
            time_s, frame = self._header(raw)
            stamps.append(Stamp(time_s, at_ns, time_s))
            frames.add(frame)
            require_count(len(stamps))
        if len(frames) > 1:
            raise RunFolderError(
                f"Images of {topic} in {self.path} are of several frames ({', '.join(sorted(map(repr, frames)))}); a "
                "sequence has one camera."
            )
        return sorted(stamps), frames.pop() if frames else ""

    def later(self, topic: str, stamp: Stamp, decode: Callable[[Any], Any]) -> Callable[[], Any]:
        """A function that reads an image; it raises RunFolderError for one that is damaged."""

        def read() -> Any:
            try:
                for connection, _, raw in self._raw(topic, stamp.at_ns, stamp.at_ns + 1):
                    # Several may have been recorded at one time.
                    if self._header(raw)[0] == stamp.stated_s:
                        return decode(self.reader.deserialize(raw, connection.msgtype))
            except Exception as err:
                # Readers raise whatever the damaged bytes lead them to.
                raise RunFolderError(f"An image of {topic} in {self.path} cannot be read ({err}).") from err
            raise RunFolderError(f"An image of {topic} in {self.path} is gone.")

        return read

    def says_poses(self, camera_frame: str) -> bool:
        """Whether the user names poses, or there are any."""
        if "pose" in self.options.topics or self.of_type(*_POSES):
            return True
        try:
            return self._leads(self._tree(), camera_frame)
        except ValueError:
            return False

    def motion(self, camera_frame: str) -> Motion:
        """From tf where it leads to the camera, else from the only topic of poses. Raises RunFolderError if neither
        says where the camera was.
        """
        tree = self._tree()
        fit = self.of_type(*_POSES)
        named = self.options.topics.get("pose")
        try:
            leads = self._leads(tree, camera_frame, alone=not fit or named == _TF)
            if named in (None, _TF) and leads:
                tree.hold(camera_frame, self.options.max_gap_s)
                root = tree.chain(camera_frame)[-1]
                return Motion(
                    lambda time_s: tree.pose(camera_frame, root, time_s),
                    lambda time_s: tree.unknown(camera_frame, time_s),
                )
            if named == _TF or (named is None and not fit and tree.parents):
                raise RunFolderError(
                    f"The frames in {self.path} say nothing about how '{camera_frame}' moves; record /tf and "
                    "/tf_static, or poses of the camera."
                )
            topic = self.chosen("pose", fit, fit)
            track, moved = self._track(topic)
            track.gap_s = self.options.max_gap_s
            fixed = np.eye(4)
            if moved is not None:
                # An odometry tells of its own frame, and the frames how the camera stands in that.
                tree.hold(camera_frame, self.options.max_gap_s, moves=True)
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

        return Motion(at, lambda time_s: track if track.at(time_s) is None else None)

    def _leads(self, tree: FrameTree, camera_frame: str, *, alone: bool = True) -> bool:
        """Whether tf says how the camera moves, or, if there is nothing else, that it stands still."""
        told = any(not link.static and len(link.times_s) > 1 for link in tree.links(camera_frame))
        return tree.moves(camera_frame) or (alone and told)

    def _tree(self) -> FrameTree:
        tree = FrameTree()
        for topic in self.of_type(*_TRANSFORMS):
            for message in self.messages(topic):
                for one in message.transforms:
                    time_s, stands = seconds(one.header.stamp), one.transform
                    pose = place_and_turn(stands.translation, stands.rotation)
                    tree.add(one.header.frame_id, one.child_frame_id, time_s, pose, static=topic.endswith("static"))
        return tree

    def _track(self, topic: str) -> tuple[Track, str | None]:
        """Poses of a topic, and the frame that moves, None = the camera; raises ValueError where several do."""
        track, moved = Track(topic), set()
        for message in self.messages(topic):
            if hasattr(message, "transform"):
                pose = place_and_turn(message.transform.translation, message.transform.rotation)
            else:
                stated = message.pose.pose if hasattr(message.pose, "pose") else message.pose
                pose = place_and_turn(stated.position, stated.orientation)
            moved.add(getattr(message, "child_frame_id", None))
            track.add(seconds(message.header.stamp), pose)
        if len(moved) > 1:
            raise ValueError(f"{topic} tells of several: {', '.join(sorted(map(repr, moved)))}")
        (frame,) = moved or {None}
        if frame == "" and "pose" not in self.options.topics:
            raise ValueError(f"{topic} does not say of which frame it tells")
        return track, frame or None

    def _raw(self, topic: str, *times_ns: int) -> Any:
        return self.reader.messages([one for one in self.reader.connections if one.topic == topic], *times_ns)

    def _header(self, raw: bytes) -> tuple[float, str]:
        """Time of a message that begins with a header [s], and its frame."""
        # ROS 2: four bytes say how the rest is laid out; the lowest bit of the second: little-endian. ROS 1: a number.
        ros2 = self.reader.is2
        order = "<" if not ros2 or raw[1] & 1 else ">"
        sec, nanosec, length = struct.unpack_from(f"{order}{'i' if ros2 else 'I'}II", raw, 4)
        return sec + nanosec * 1e-9, bytes(raw[16 : 16 + length]).rstrip(b"\0").decode(errors="replace")
