"""Where the base and the camera of a live robot are over time, from odometry and the tree of frames."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import pose_matrix
from anm_mj.io.bag_poses import FrameTree, Track
from anm_mj.io.ros_messages import place_and_turn, seconds
from anm_mj.ros.health import Health
from anm_mj.ros.names import BASE, ODOM
from anm_mj.types import Pose2

FOOTPRINT = "base_footprint"
TREE = "tf"
"""Stands for the frames alone where a topic of odometry is named."""
_MOST = 400
"""Poses of a link that are kept, at the least half of them."""
_GAP_S, _FRAME_GAP_S = 0.3, 0.2
"""Between poses of the odometry, or of a frame on tf, that are farther apart, nothing is known; the last one holds for
so long, until the next one comes [s]."""
_SAME_TIME_S = 1.0
"""Two programs publish the same link where both did so within this time [s]."""
_BACK_S = 0.5
"""A clock by which a link's stamps go back by more was set back; by less, they come out of order [s]."""


class Poses:
    """Odometry and frames as they come; callbacks and questions may come from different threads."""

    def __init__(self, health: Health, base_frame: str) -> None:
        """Know nothing yet; an empty ``base_frame`` is found."""
        self._health, self._base_frame = health, base_frame
        self._tree = FrameTree()
        self._odometry = Track("the odometry", gap_s=_GAP_S, hold_s=_GAP_S)
        self._frame, self._child = ODOM, BASE
        self._news = threading.Condition()
        self._publishers: dict[tuple[str, str], dict[int, float]] = {}
        self.source = ""
        """What the poses come from, for messages."""
        self._root = ""
        self._told_s = -math.inf
        self.on_pose: Callable[[], None] = lambda: None
        """Called after each message with poses."""

    def hear_odometry(self, message: Any) -> None:
        """Take in ``nav_msgs/Odometry``."""
        pose, time_s = message.pose.pose, seconds(message.header.stamp)
        values = place_and_turn(pose.position, pose.orientation)
        if not np.isfinite(values).all():
            raise ValueError("a pose that is not finite is left out")
        with self._news:
            self._frame = message.header.frame_id.lstrip("/") or self._frame
            self._child = message.child_frame_id.lstrip("/") or self._child
            _add(self._odometry, time_s, values)
            self._news.notify_all()
        self._health.hear(self.source, time_s)
        self.on_pose()

    def hear_frames(self, message: Any, publisher: int, *, static: bool) -> None:
        """Take in ``tf2_msgs/TFMessage`` of ``/tf`` or, ``static``, of ``/tf_static``."""
        now = time.monotonic()
        for link in message.transforms:
            parent, child = link.header.frame_id.lstrip("/"), link.child_frame_id.lstrip("/")
            values = place_and_turn(link.transform.translation, link.transform.rotation)
            time_s = seconds(link.header.stamp)
            with self._news:
                known = self._tree.track.get(child)
                # What was known before a clock was set back is of another time.
                is_back = known is not None and not known.static and time_s < known.times_s[-1] - _BACK_S
                if known is not None and (static or is_back):
                    self._tree.track[child] = Track(f"the frame '{child}'", static=static)
                self._tree.add(parent, child, time_s, values, static=static)
                _shorten(self._tree.track[child])
                self._tree.track[child].gap_s = self._tree.track[child].hold_s = _FRAME_GAP_S
                self._news.notify_all()
            if not static:
                there = self._publishers.setdefault((parent, child), {})
                there[publisher] = now
                if sum(now - at < _SAME_TIME_S for at in there.values()) > 1:
                    self._health.fault(f"{parent} {child}", f"two programs publish {child} in {parent} on tf; stop one")
        if self.source == TREE and not static:
            # Others, this program among them, publish frames of their own, at which the base is where it was.
            latest_s = self.latest_s
            if latest_s != self._told_s and self._in_root(latest_s) is not None:
                self._told_s = latest_s
                self._health.hear(TREE, latest_s)
            self.on_pose()

    @property
    def latest_s(self) -> float:
        """The stamp of the last pose of the base [s]; -inf before the first. Raises RobotError if the frames that it
        comes from are no tree.
        """
        with self._news:
            track = self._moving()
            return max(track.times_s[-20:]) if track is not None and track.times_s else -math.inf

    def wait_newer(self, than_s: float, within_s: float) -> Pose2 | None:
        """The last pose of the base, once there is one later than a stamp [s]; None if that takes too long [s]."""
        with self._news:
            if not self._news.wait_for(lambda: self.latest_s > than_s, within_s):
                return None
        return self.base(self.latest_s)

    def base(self, time_s: float) -> Pose2 | None:
        """The pose of the base in the frame of the odometry at a time; None where it is not known."""
        with self._news:
            if self.source == TREE:
                T = self._in_root(time_s)
            else:
                T = self._odometry.at(time_s)
                floor = None if T is None else self._link(self.base_frame, self._child, time_s)
                T = None if T is None or floor is None else T @ floor
        if T is None:
            return None
        return Pose2(float(T[0, 3]), float(T[1, 3]), math.atan2(T[1, 0], T[0, 0]))

    def in_odometry_frame(self, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """The pose of :meth:`base` in :attr:`odometry_frame` at a time; None where it is not known. A topic's frame may
        stand in others, as in one of a world that several robots share. Raises RobotError if the frames are no tree.
        """
        pose = self.base(time_s)
        if pose is None or self.source == TREE:
            return None if pose is None else pose_matrix(pose)
        with self._news:
            if self._frame not in self._tree.parents:
                return pose_matrix(pose)
            above = self._link(self._frame, self.odometry_frame, time_s)
        return None if above is None else above @ pose_matrix(pose)

    def camera(self, camera_frame: str, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """``T_base_camera`` at a time; None where the frames do not say. Raises RobotError if they are no tree."""
        with self._news:
            return self._link(camera_frame, self.base_frame, time_s)

    @property
    def base_frame(self) -> str:
        """The frame of the base on the floor."""
        if self._base_frame:
            return self._base_frame
        frames = set(self._tree.parents).union(*self._tree.parents.values())
        return FOOTPRINT if FOOTPRINT in frames else self._child

    @property
    def odometry_frame(self) -> str:
        """The root of the frames as it was at first, before this program adds one; that of a topic of odometry where
        the base has none above it. Raises RobotError if they are no tree.
        """
        with self._news:
            if not self._root and self.base_frame in self._tree.parents:
                self._root = self._chain()[-1]
            return self._root or self._frame

    def _moving(self) -> Track | None:
        if self.source != TREE:
            return self._odometry
        if self.base_frame not in self._tree.parents:
            return None
        chain = self._chain()
        # This program itself says where the frame of the odometry is in the map.
        below = chain[: chain.index(self.odometry_frame)] if self.odometry_frame in chain else chain[:-1]
        moving = [link for link in (self._tree.track[frame] for frame in below) if not link.static]
        return moving[-1] if moving else None

    def _chain(self) -> list[str]:
        """The frame of the base and those above it."""
        try:
            return self._tree.chain(self.base_frame)
        except ValueError as err:
            raise _no_tree(err) from err

    def _in_root(self, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        return self._link(self.base_frame, self.odometry_frame, time_s)

    def _link(self, frame: str, ancestor: str, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """``T_ancestor_frame``, whichever of the two is above the other."""
        if frame == ancestor:
            return np.eye(4)
        try:
            T = self._tree.pose(frame, ancestor, time_s)
            if T is None and ancestor in self._tree.parents:
                T = self._tree.pose(ancestor, frame, time_s)
                T = None if T is None else np.linalg.inv(T)
        except ValueError as err:
            raise _no_tree(err) from err
        return T


def _no_tree(err: ValueError) -> RobotError:
    return RobotError(f"The frames on tf are no tree: {err}; stop one of the programs that publish them.")


def _add(track: Track, time_s: float, pose: Float[np.ndarray, "7"]) -> None:
    if track.times_s and time_s < track.times_s[-1]:
        # The clock was set back: what was known before is of another time.
        track.times_s.clear()
        track.poses.clear()
    track.add(time_s, pose)
    _shorten(track)


def _shorten(track: Track) -> None:
    if len(track.times_s) > _MOST:
        del track.times_s[: _MOST // 2], track.poses[: _MOST // 2]
