"""The map follows its keyframes: each joins the pose graph, and where that moves some, so do field and occupancy."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.key_images import KeyImages
from anm_mj.localisation.keyframe_graph import Correction, KeyframeGraph
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.wall_directions import Headings
from anm_mj.types import Observation

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

_logger = logging.getLogger(__name__)


class MapCorrector:
    """Adds keyframes to a pose graph, and moves what it corrects."""

    REBUILT = ("_map",)

    def __init__(
        self, neural_map: NeuralMap, graph: KeyframeGraph, key_images: KeyImages, basis: Float64[np.ndarray, "6 k"]
    ) -> None:
        """Before any keyframe of the graph; ``key_images`` are those of its keyframes, and ``basis`` is as of
        :class:`~.registration.Prior`.
        """
        self._map, self._graph, self._key_images, self._basis = neural_map, graph, key_images, basis
        self._grid_poses = np.zeros((0, 4, 4))
        """Poses of the graph's keyframes that the occupancy grid was made with."""
        self._is_chained = False
        """Whether the motion since the last keyframe is known."""

    @property
    def is_on(self) -> bool:
        """Whether the map's last keyframe joins the graph."""
        # In a map that goes on from a prior run, that map says where everything is.
        own = len(self._map.field.keyframes) == len(self._graph.poses) + 1
        return own and self._graph.config.is_on

    def break_chain(self) -> None:
        """Nobody knows how the camera moved since the last keyframe."""
        self._is_chained = False

    def add(self, compared: FrameToImages, keyframe: Observation, headings: Headings | None) -> Correction | None:
        """Add the map's last keyframe to the graph, and move what that corrects; returns which poses change.

        ``compared`` compares it with earlier frames; ``headings`` are what walls say of its heading, None = nothing.
        """
        config, T = self._graph.config, keyframe.T_world_camera
        # The field's say, and odometry's, is in the estimated motion; a jump after the camera was lost is none.
        deviations = np.array([config.chain_m] * 3 + [config.chain_rad] * 3)
        covariance = self._basis.T @ np.diag(deviations**2) @ self._basis
        motion = Prior(T, covariance, self._basis) if self._is_chained else None
        self._is_chained = True
        self._grid_poses = np.concatenate((self._grid_poses, T[None]))
        if (correction := self._graph.add(compared, T, motion, headings)) is None:
            return None
        self._map.move_keyframes(len(self._graph.poses) - np.array(correction.nodes), correction.T_world_camera)
        poses = self._graph.poses
        # Since the grid was built: many small corrections add up.
        largest_m = float(np.linalg.norm((poses - self._grid_poses)[:, :3, 3], axis=1).max())
        if largest_m > config.rebuild_m:
            if correction.closed:
                text = "Frame %d closes a loop; keyframes have moved by up to %.1f cm, and the map is built again."
                _logger.info(text, keyframe.step, 100.0 * largest_m)
            frames = (image.frame for image in self._key_images.images)
            self._map.rebuild(frames, config.rebuild_iterations, (self._grid_poses, poses))
            self._grid_poses = poses
        return correction
