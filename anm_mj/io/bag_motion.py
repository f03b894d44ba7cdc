"""Where the camera of an open bag was: from the tree of its frames, or from a topic of poses."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.io.bag_poses import FrameTree, Track
from anm_mj.io.bag_reader import BagReader
from anm_mj.io.ros_messages import place_and_turn, seconds

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
_TF = "tf"
"""Stands for the tree of frames where a topic of poses is named."""


@dataclass(frozen=True)
class Motion:
    """Poses of the camera over time."""

    at: Callable[[float], Float[np.ndarray, "4 4"] | None]
    """``T_world_camera`` at a time; None where it is not known."""
    unknown: Callable[[float], Track | None]
    """Whose poses lack at a time."""


class BagMotion(BagReader):
    """Finds the poses of the camera in an open bag."""

    def says_poses(self, camera_frame: str) -> bool:
        """Whether the user names poses, or there are any."""
        if "pose" in self.options.topics or self.of_type(*POSES):
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
        fit = self.of_type(*POSES)
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
        if tree.moves(camera_frame):
            return True
        return alone and any(not link.static and len(link.times_s) > 1 for link in tree.links(camera_frame))

    def _tree(self) -> FrameTree:
        tree = FrameTree()
        for topic in self.of_type(*TRANSFORMS):
            for message in self.messages(topic):
                for one in message.transforms:
                    time_s, stands = seconds(one.header.stamp), one.transform
                    pose = place_and_turn(stands.translation, stands.rotation)
                    tree.add(one.header.frame_id, one.child_frame_id, time_s, pose, static=topic.endswith("static"))
        return tree

    def _track(self, topic: str) -> tuple[Track, str | None]:
        """Poses of a topic, and the frame that moves; None = that of the camera.

        Raises ValueError where there are several.
        """
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
