"""Poses over time out of a recording: one moving frame, or a tree of frames as ROS's tf has it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

GAP_S = 0.5
"""Between poses that lie farther apart, and so long before the first and after the last, nothing is known [s]."""


@dataclass
class Track:
    """Poses of one frame in another; straight lines and the shortest rotation in between."""

    times_s: list[float] = field(default_factory=list)
    xyz_m: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    quaternions: list[Float[np.ndarray, "4"]] = field(default_factory=list)
    """Scalar last."""
    static: bool = False
    """Whether the first pose counts at all times."""

    def add(self, time_s: float, xyz_m: Float[np.ndarray, "3"], quaternion: Float[np.ndarray, "4"]) -> None:
        """Add a pose; they may come in any order."""
        self.times_s.append(time_s)
        self.xyz_m.append(xyz_m)
        self.quaternions.append(quaternion)

    def at(self, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """The pose at a time; None where nothing is known. Raises ValueError for a quaternion of length zero."""
        order = np.argsort(self.times_s, kind="stable")
        times = np.array(self.times_s)[order]
        if self.static:
            return _matrix(self.xyz_m[0], Rotation.from_quat(self.quaternions[0]))
        after = int(np.searchsorted(times, time_s))
        low, high = max(after - 1, 0), min(after, len(times) - 1)
        if max(times[low] - time_s, time_s - times[high], times[high] - times[low]) > GAP_S:
            return None
        low_xyz, high_xyz = self.xyz_m[order[low]], self.xyz_m[order[high]]
        rotations = Rotation.from_quat([self.quaternions[order[low]], self.quaternions[order[high]]])
        span = times[high] - times[low]
        share = float(np.clip((time_s - times[low]) / span, 0.0, 1.0)) if span > 0.0 else 0.0
        turned = rotations[0] * Rotation.from_rotvec(share * (rotations[0].inv() * rotations[1]).as_rotvec())
        return _matrix(low_xyz + share * (high_xyz - low_xyz), turned)


@dataclass
class FrameTree:
    """Frames and the poses of each in its parent."""

    parent: dict[str, str] = field(default_factory=dict)
    track: dict[str, Track] = field(default_factory=dict)
    """By the child's name."""

    def add(
        self,
        parent: str,
        child: str,
        time_s: float,
        xyz_m: Float[np.ndarray, "3"],
        quaternion: Float[np.ndarray, "4"],
        *,
        static: bool,
    ) -> None:
        """Add a pose of ``child`` in ``parent``."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        self.parent[child] = parent
        self.track.setdefault(child, Track(static=static)).add(time_s, xyz_m, quaternion)

    def chain(self, frame: str) -> list[str]:
        """The frame and its ancestors, up to the root."""
        return list(self._upwards(frame.lstrip("/")))

    def moves(self, frame: str) -> bool:
        """Whether the frame moves against its root."""
        return any(child in self.track and not self.track[child].static for child in self.chain(frame))

    def pose(self, frame: str, ancestor: str, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """``T_ancestor_frame`` at a time; None where it is not known."""
        T = np.eye(4)
        for child in self._upwards(frame.lstrip("/")):
            if child == ancestor.lstrip("/"):
                return T
            above = self.track[child].at(time_s) if child in self.track else None
            if above is None:
                return None
            T = above @ T
        return None

    def _upwards(self, frame: str) -> Iterator[str]:
        seen = set()
        while frame not in seen:
            seen.add(frame)
            yield frame
            if frame not in self.parent:
                return
            frame = self.parent[frame]


def _matrix(xyz_m: Float[np.ndarray, "3"], rotation: Rotation) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), xyz_m
    return T
