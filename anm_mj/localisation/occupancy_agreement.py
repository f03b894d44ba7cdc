"""What the occupancy grid says of a frame at a pose: which points it confirms, which it contradicts, which it knows
nothing of.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from anm_mj import _native
from anm_mj.mapping.depth_occupancy import DepthOccupancy

REACH_M = 0.02
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
    # Somebody who is taken for an obstacle is a disc wider than they are: past them the frame sees what is behind.
    _native.agreement(
        voxels.state,
        voxels.log_odds,
        voxels.corner,
        occupancy.config.voxel_m,
        world,
        origin,
        REACH_M,
        _RAY_SHARES,
        _RAY_MARGIN_M,
        says,
    )
    return Agreement(*says.view(bool))
