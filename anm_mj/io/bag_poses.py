"""Poses over time out of a recording: one moving frame, or a tree of frames as ROS's tf has it."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial.transform import Rotation

from anm_mj.frames import rigid_transform
from anm_mj.io.camera_checks import FARTHEST_M
from anm_mj.io.sequence_poses import MATCH_S, tum_matrix

GAP_S = 0.5
"""Between poses that lie farther apart nothing is known [s], unless their link is one of those that hold."""
_SAME_M, _SAME_RAD = 1e-4, 1e-4
"""A link whose poses differ by less than both never changes."""
_SELDOM = 2
"""A link with so many times fewer poses than the one that is stated most often corrects that one, as a localiser does;
it holds between its poses."""
_NO_UNIT = 0.1
"""A quaternion whose length differs from 1 by more is no rotation; ROS leaves such poses out as well."""

_logger = logging.getLogger(__name__)


@dataclass(eq=False)
class Track:
    """Poses of one frame in another; straight lines and the shortest rotation in between."""

    name: str
    """What a warning calls them."""
    times_s: list[float] = field(default_factory=list)
    poses: list[Float[np.ndarray, "7"]] = field(default_factory=list)
    """Position [m] and quaternion, scalar last."""
    static: bool = False
    """Whether the pose that was added last counts at all times, as a static frame of ROS takes the place of the one
    before."""
    gap_s: float = GAP_S
    """Between poses farther apart nothing is known [s]; infinite = the first and the last count at all times, too."""
    hold_s: float = MATCH_S
    """So long before itself counts the first pose, and so long after itself the last [s]."""
    _order: np.ndarray | None = field(default=None, init=False)

    def add(self, time_s: float, pose: Float[np.ndarray, "7"]) -> None:
        """Add a pose; they may come in any order."""
        self.times_s.append(time_s)
        self.poses.append(pose)
        self._order = None

    def at(self, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """The pose at a time; None where nothing is known."""
        if self._order is None:
            self._order = self._usable()
            self._times = np.array(self.times_s)[self._order]
        order, times = self._order, self._times
        if not len(order):
            return None
        if self.static:
            last = self.poses[int(order.max())]
            return tum_matrix(last[:3], last[3:])
        time_s = float(np.clip(time_s, times[0], times[-1])) if self.gap_s == math.inf else time_s
        after = int(np.searchsorted(times, time_s))
        high = min(after, len(times) - 1)
        low = high if times[high] == time_s else max(after - 1, 0)
        if max(times[low] - time_s, time_s - times[high]) > self.hold_s or times[high] - times[low] > self.gap_s:
            return None
        before, behind = self.poses[order[low]], self.poses[order[high]]
        rotations = Rotation.from_quat([before[3:], behind[3:]])
        span = times[high] - times[low]
        share = float(np.clip((time_s - times[low]) / span, 0.0, 1.0)) if span > 0.0 else 0.0
        turned = rotations[0] * Rotation.from_rotvec(share * (rotations[0].inv() * rotations[1]).as_rotvec())
        return rigid_transform(turned.as_matrix().ravel(), before[:3] + share * (behind[:3] - before[:3]))

    @property
    def span_s(self) -> tuple[float, float]:
        """The first and the last time [s]."""
        return min(self.times_s), max(self.times_s)

    @property
    def is_constant(self) -> bool:
        """Whether all valid poses are the same, whatever their topic is called."""
        if self.static:
            return True
        poses = np.array(self.poses)[self._usable(quiet=True)]
        if not len(poses):
            return False
        turns = np.abs(poses[:, 3:] @ poses[0, 3:]) / (
            np.linalg.norm(poses[:, 3:], axis=1) * np.linalg.norm(poses[0, 3:])
        )
        angles = 2.0 * np.arccos(np.clip(turns, -1.0, 1.0))
        return bool((np.abs(poses[:, :3] - poses[0, :3]) < _SAME_M).all() and (angles < _SAME_RAD).all())

    def _usable(self, *, quiet: bool = False) -> Int64[np.ndarray, " n"]:
        """Indices of the valid poses in the order of their times; a warning counts the others."""
        poses = np.array(self.poses).reshape(-1, 7)
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(poses[:, 3:], axis=1)
        good = (np.abs(lengths - 1.0) <= _NO_UNIT) & (np.abs(poses[:, :3]) <= FARTHEST_M).all(axis=1)
        if not (quiet or good.all()):
            _logger.warning(
                "%d of %d poses of %s are left out, because they are no poses (the first at %.9g s): a quaternion of "
                "length 1, and a place within %g km.",
                np.count_nonzero(~good),
                len(good),
                self.name,
                self.times_s[int(np.argmin(good))],
                FARTHEST_M / 1000.0,
            )
        kept = np.flatnonzero(good)
        return kept[np.argsort(np.array(self.times_s)[kept], kind="stable")]


@dataclass
class FrameTree:
    """Frames and the poses of each in its parent."""

    parents: dict[str, list[str]] = field(default_factory=dict)
    track: dict[str, Track] = field(default_factory=dict)
    """By the child's name."""

    def add(self, parent: str, child: str, time_s: float, pose: Float[np.ndarray, "7"], *, static: bool) -> None:
        """Add a pose of ``child`` in ``parent``, as :attr:`Track.poses`."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        known = self.parents.setdefault(child, [])
        if parent not in known:
            known.append(parent)
        self.track.setdefault(child, Track(f"the frame '{child}'", static=static)).add(time_s, pose)

    def chain(self, frame: str) -> list[str]:
        """The frame and its ancestors, up to the root; raises ValueError where they are no chain."""
        return list(self._upwards(frame.lstrip("/")))

    def moves(self, frame: str) -> bool:
        """Whether the frame moves against its root; raises ValueError where its ancestors are no chain."""
        return any(not link.is_constant for link in self.links(frame))

    def links(self, frame: str) -> list[Track]:
        """The links of a frame to its root; raises ValueError where they are no chain."""
        return [self.track[child] for child in self.chain(frame) if child in self.track]

    def hold(self, frame: str, gap_s: float, *, moves: bool = False) -> None:
        """Let links that never change count at all times, and those that change seldom between their poses.

        Where no link changes, as of a camera that stands still, nothing tells whether one only ended early. ``gap_s``
        is that of all other links; ``moves``: the motion of the frame is known from elsewhere.
        """
        links = self.links(frame)
        changing = [link for link in links if not link.is_constant]
        for link in links:
            link.gap_s = gap_s
            link.static |= (moves or bool(changing)) and link not in changing
        most = max((len(link.times_s) for link in changing), default=0)
        for link in changing:
            if _SELDOM * len(link.times_s) <= most:
                link.gap_s = math.inf
                _logger.warning(
                    "%s is stated %d times from %.9g to %.9g s, seldom against %d times: in between it is "
                    "interpolated, before and after it holds.",
                    link.name[0].upper() + link.name[1:],
                    len(link.times_s),
                    *link.span_s,
                    most,
                )

    def unknown(self, frame: str, time_s: float) -> Track | None:
        """The first link whose pose at a time is not known; raises ValueError where there is no chain."""
        return next((link for link in self.links(frame) if link.at(time_s) is None), None)

    def pose(self, frame: str, ancestor: str, time_s: float) -> Float[np.ndarray, "4 4"] | None:
        """``T_ancestor_frame`` at a time; None where it is not known. Raises ValueError where no chain leads there."""
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
            parents = self.parents.get(frame, [])
            if not parents:
                return
            if len(parents) > 1:
                raise ValueError(f"the frame '{frame}' stands in several: {', '.join(map(repr, parents))}")
            frame = parents[0]
        raise ValueError(f"the frames go round in a circle: '{frame}' stands in itself")
