"""Keyframes and what was measured between them: their poses are adjusted as the run goes on.

Each keyframe is registered to some earlier ones by their images alone. The poses of the latest ones are adjusted to
that (bundle adjustment over a window). When places are seen again, all measurements together are asked from time to
time; where they move a keyframe far, all poses are adjusted (loop closure). A measurement of such a place that deviates
from the present pose is believed when several keyframes in a row say alike and the measurements on the way allow it.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.frame_to_images import FrameToImages, measured
from anm_mj.localisation.key_images import KeyImage, KeyImages
from anm_mj.localisation.localisation_config import GraphConfig
from anm_mj.localisation.pose_graph import Edge, chi_squares, optimised
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.se3 import moved_camera
from anm_mj.localisation.wall_directions import Headings
from anm_mj.mapping.alignment import FramePoints

_TRIAL_ITERATIONS = 2
"""Steps that tell whether the poses as a whole should be corrected."""
_LOOP_M, _LOOP_RAD = 0.1, 0.06
"""Standard deviations of the place where a loop may close, at least [m, rad]."""


@dataclass(frozen=True)
class Correction:
    """Poses of keyframes that have changed."""

    nodes: tuple[int, ...]
    """Which, counted from the first keyframe on."""
    T_world_camera: Float64[np.ndarray, "m 4 4"]
    closed: bool
    """Whether a loop was closed."""


class KeyframeGraph:
    """Adds keyframes to a pose graph and adjusts it."""

    def __init__(self, config: GraphConfig, images: KeyImages, basis: Float64[np.ndarray, "6 k"]) -> None:
        """Without any keyframe; ``basis`` as of :class:`~.registration.Prior`. Keyframes whose images are given up by
        ``images`` are registered to no more.
        """
        self.config = config
        self.poses = np.zeros((0, 4, 4))
        """Of all keyframes, camera to world."""
        self.edges: list[Edge] = []
        """What was measured between them."""
        self.headings: list[Edge] = []
        """What walls say of their headings; some of it may be far off, and forbids no loop."""
        self._images = images
        self._basis = basis
        self._pending: list[list[Edge]] = []
        """Of the last keyframes: measurements to a place that is seen again, not believed yet."""
        self._num_returned = 0
        """Keyframes that showed an old place again."""

    def add(
        self,
        compared: FrameToImages,
        T_world_camera: Float[np.ndarray, "4 4"],
        motion: Prior | None,
        headings: Headings | None = None,
    ) -> Correction | None:
        """Add the frame that was last kept as a key image, at its estimated pose; returns which poses change by it.

        ``motion`` is what odometry says of its pose, from that of the keyframe before, ``headings`` what walls say of
        its heading; None = nothing.
        """
        node = len(self.poses)
        self.poses = np.concatenate((self.poses, T_world_camera[None]))
        self._images.images[-1].node = node
        if not node:
            return None
        if motion is not None:
            information = self._basis @ np.linalg.inv(motion.covariance) @ self._basis.T
            self.edges.append(self._edge(node - 1, node, motion.T_world_camera, information))
        if headings is not None:
            self.headings += self._heading_edges(headings, node)
        near, old = self._chosen(compared.points, T_world_camera, node)
        covariance = self._basis.T @ np.diag([_LOOP_M**2] * 3 + [_LOOP_RAD**2] * 3) @ self._basis
        loops: list[Edge] = []
        returned = False
        for image in (*near, *old):
            one = measured(compared.against(image), T_world_camera, covariance, self._basis, self.config)
            if one.overlap >= self.config.least_overlap and one.fit >= self.config.least_fit:
                edge = self._edge(image.node, node, one.T_world_camera, one.information)
                edge = replace(edge, kernel=self.config.edge_kernel)
                is_old = node - image.node >= self.config.loop_keyframes
                deviates = float(np.linalg.norm(edge.deviation(self.poses)[:3])) > self.config.loop_m
                # What hardly deviates needs no proof. Of the others a recent one slid along what it cannot tell apart.
                if not deviates:
                    self.edges.append(edge)
                elif is_old:
                    loops.append(edge)
                returned |= is_old
        closed = self.config.loops and (self._take_loops(loops) or (returned and self._closes()))
        if not closed and not self.config.adjust:
            return None
        num_fixed = 1 if closed else max(1, node + 1 - self.config.window)
        self.poses = self._optimised(self.edges, num_fixed=num_fixed)
        free = np.arange(num_fixed, node + 1)
        for image in self._images.images:
            if image.node >= 0:
                image.T_world_camera = self.poses[image.node]
        return Correction(tuple(free.tolist()), self.poses[free], closed)

    def _optimised(self, edges: list[Edge], iterations: int = 10, num_fixed: int = 1) -> Float64[np.ndarray, "n 4 4"]:
        """The poses that some edges and the walls ask for; the first ones stay."""
        fixed = np.arange(len(self.poses)) < num_fixed
        return optimised(self.poses, [*edges, *self.headings], fixed, self._basis, iterations)

    def _closes(self) -> bool:
        """Whether all measurements together ask for a correction that the map should follow.

        A frame that comes back is registered to the oldest image, which pulls its pose to where it was then: not the
        present pose deviates, but those on the way between.
        """
        self._num_returned += 1
        if self._num_returned % self.config.loop_every:
            return False
        poses = self._optimised(self.edges, _TRIAL_ITERATIONS)
        return bool(np.linalg.norm((poses - self.poses)[:, :3, 3], axis=1).max() > self.config.rebuild_m)

    def _take_loops(self, edges: list[Edge]) -> bool:
        """Whether measurements to a place seen again are believed now, which takes them into the graph."""
        self._pending = [*self._pending, edges][-self.config.loop_confirmations :]
        if len(self._pending) < self.config.loop_confirmations or not all(self._pending):
            return False
        # The correction that each keyframe asks for: those of one place are alike.
        asked = np.array([np.median([edge.deviation(self.poses) for edge in some], axis=0) for some in self._pending])
        spread = np.abs(asked - np.median(asked, axis=0)).max(axis=0)
        middle = np.linalg.norm(np.median(asked, axis=0)[:3])
        if np.linalg.norm(spread[:3]) > max(0.02, 0.5 * middle):
            return False
        fresh = [edge for some in self._pending for edge in some]
        trial = [*self.edges, *fresh]
        poses = self._optimised(trial)
        misfit = chi_squares(poses, fresh)
        strain = chi_squares(poses, self.edges) - chi_squares(self.poses, self.edges)
        # Those who follow are asked afresh.
        self._pending = []
        if max(misfit.max(), strain.max(initial=0.0)) > self.config.loop_chi_square * self._basis.shape[1]:
            return False
        self.edges = trial
        return True

    def _chosen(
        self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], node: int
    ) -> tuple[list[KeyImage], list[KeyImage]]:
        """Key images that show enough of a frame: of the latest keyframes those that show most, and old ones."""
        shares = [
            (share, image)
            for share, image in self._images.shares(points, T_world_camera)
            if share >= self.config.least_overlap and 0 <= image.node < node
        ]
        ranked = sorted(shares, key=lambda each: (-each[0], each[1].node))
        recent = [image for _, image in ranked if node - image.node < self.config.loop_keyframes]
        old = [image for _, image in ranked if node - image.node >= self.config.loop_keyframes]
        num_old = min(len(old), max(self.config.images // 2, 1))
        half = (self.config.images - num_old + 1) // 2
        # Those that show most are the latest; the oldest bind the window to what came before it.
        by_age = sorted(recent[half:], key=lambda image: image.node)
        near = recent[:half] + by_age[: self.config.images - num_old - half]
        return near, old[:num_old]

    def _heading_edges(self, headings: Headings, node: int) -> list[Edge]:
        """From the first keyframe, which holds the directions of walls."""
        edges: list[Edge] = []
        for turn, deviation in zip(headings.turns_rad, headings.deviations_rad, strict=True):
            T = moved_camera(headings.T_world_camera, np.array([0.0, 0.0, 0.0, 0.0, 0.0, turn]))
            edge = self._edge(0, node, T, np.diag([0.0, 0.0, 0.0, 0.0, 0.0, deviation**-2]))
            edges.append(replace(edge, kernel=headings.kernels[1]))
        return edges

    def _edge(
        self, first: int, second: int, T_world_second: Float[np.ndarray, "4 4"], information: Float64[np.ndarray, "6 6"]
    ) -> Edge:
        T_first = self.poses[first]
        turn = np.kron(np.eye(2), T_first[:3, :3])
        return Edge(first, second, np.linalg.inv(T_first) @ T_world_second, turn.T @ information @ turn)
