"""What localisation asks of a map, and which points of a frame at a pose the occupancy grid confirms or contradicts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32

from anm_mj import _native
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations
from anm_mj.mapping.depth_noise import inverse_depth_noise
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.types import Observation

if TYPE_CHECKING:
    from anm_mj.mapping.neural_map import NeuralMap

_REACH_M = 0.02
"""A point is confirmed where an occupied voxel is as near as this [m]."""
_RAY_SHARES = np.array([0.2, 0.35, 0.5, 0.65, 0.8])
"""Places on a ray, as shares of its length, that have to be open."""
_RAY_MARGIN_M = 0.2
"""So near to its end a ray may touch what it ends at [m]."""


@dataclass(frozen=True)
class Agreement:
    """Of a frame's points at a pose."""

    confirmed: Bool[np.ndarray, " n"]
    """Lies beside an occupied voxel, with nothing in between."""
    contradicted: Bool[np.ndarray, " n"]
    """Lies in free space, or behind an occupied voxel."""

    @property
    def known(self) -> float:
        """Share of the points that the map says something of."""
        return float(np.mean(self.confirmed | self.contradicted)) if len(self.confirmed) else 0.0

    @property
    def share(self) -> float:
        """Share of those that it confirms; 0 where it knows nothing."""
        confirmed, contradicted = int(self.confirmed.sum()), int(self.contradicted.sum())
        return confirmed / (confirmed + contradicted) if confirmed + contradicted else 0.0


def agreement(
    points_m: Float32[np.ndarray, "n 3"], T_world_camera: Float[np.ndarray, "4 4"], occupancy: DepthOccupancy
) -> Agreement:
    """Compare a frame's points, in the camera's axes, at a camera pose with the occupancy grid."""
    origin, voxels = np.ascontiguousarray(T_world_camera[:3, 3]), occupancy.voxels
    world = points_m @ T_world_camera[:3, :3].T + origin
    says = np.empty((2, len(world)), np.uint8)
    grid = voxels.state, voxels.log_odds, voxels.corner, occupancy.config.voxel_m
    # Somebody who is taken for an obstacle is a disc wider than they are: past them the frame sees what is behind.
    _native.agreement(*grid, world, origin, _REACH_M, _RAY_SHARES, _RAY_MARGIN_M, says)
    return Agreement(*says.view(bool))


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
        return self.occupancy.near_occupied(points_m, _REACH_M)

    def agreement(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> Agreement:
        """What the occupancy grid says of a frame's points at a pose."""
        return agreement(points.camera_m, T_world_camera, self.occupancy)

    def contradicted(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> float:
        """Share of them that it contradicts, in [0, 1]."""
        return float(np.mean(self.agreement(points, T_world_camera).contradicted))
