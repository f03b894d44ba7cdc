"""What localisation asks of a map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from anm_mj.localisation.occupancy_agreement import REACH_M, Agreement, agreement
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations
from anm_mj.mapping.depth_noise import inverse_depth_noise
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.types import Observation

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap


class MapProbe:
    """Asks a map that others change meanwhile."""

    def __init__(self, neural_map: NeuralMap) -> None:
        """Of a map whose engine can align."""
        self._map = neural_map

    def align(
        self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"], settings: AlignSettings
    ) -> NormalEquations:
        """Compare a frame with the field."""
        return self._map.backend.align(points, T_world_camera, settings)

    @property
    def occupancy(self) -> DepthOccupancy:
        """What is free and occupied."""
        return self._map.occupancy.by_depth

    @property
    def noise_per_m(self) -> float:
        """Deviation of the sensor's depth, by its square [1/m]; infinite before the map has seen it."""
        return self.occupancy.noise.value

    def noise_of(self, observation: Observation) -> float:
        """The same, from one image as long as the map has not seen the sensor."""
        noise = self.noise_per_m
        return noise if math.isfinite(noise) else inverse_depth_noise(observation.depth_m) or 0.0

    def known(self, points_m: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which world points [m] lie at surface that was observed."""
        return self.occupancy.near_occupied(points_m, REACH_M)

    def agreement(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> Agreement:
        """What the occupancy grid says of a frame's points at a pose."""
        return agreement(points.camera_m, T_world_camera, self.occupancy)

    def contradicted(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> float:
        """Share of them that it contradicts, in [0, 1]."""
        return float(np.mean(self.agreement(points, T_world_camera).contradicted))
