"""What the map answers."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int8

FREE = 0
"""State of a cell that depth rays passed through."""
OCCUPIED = 1
"""State of a cell that holds a surface."""
UNKNOWN = -1
"""State of a cell that was never observed."""
_EDGE = 1e-6
"""A height this near to a face between two layers lies on it [layers]."""

SdfQuery = Callable[[Float[np.ndarray, "n 3"]], Float32[np.ndarray, " n"]]
"""World points [m] to signed distance."""


@dataclass(frozen=True)
class OccupancyGrid:
    """Free, occupied and unknown space, in voxels."""

    state: Int8[np.ndarray, "layers rows cols"]
    """FREE, OCCUPIED or UNKNOWN; ``[layer, row, col]`` = ``[z, y, x]``."""
    seen_range_m: Float32[np.ndarray, "layers rows cols"]
    """Smallest planar depth at which a cell's surface was observed [m]; +inf where never."""
    origin_m: Float[np.ndarray, "3"]
    """World x, y, z of the outer corner of cell [0, 0, 0]."""
    resolution_m: float
    """Edge of a voxel [m]."""
    version: int = 0
    """Grows with every change."""
    column_version: Int[np.ndarray, "block_rows block_cols"] | None = None
    """The version at which a cell of each square block of columns last changed; None where nobody keeps track. Readers
    compare it with the version that they read last, see :class:`anm_mj.planning.change_reader.ChangeReader`."""

    def layer_of(self, z_m: float) -> int:
        """Index of the layer that contains a height; may lie outside the grid."""
        return math.floor((z_m - self.origin_m[2]) / self.resolution_m + _EDGE)

    def layers_between(self, low_m: float, high_m: float, *, whole: bool = False) -> slice:
        """Layers of a range of heights [m], as far as the grid has them: those whose lower face lies in it, so that
        none of an obstacle's height is missed at the top; or only those in it as a ``whole``: nothing else counts then.
        """
        first, stop = self._layer_range(low_m, high_m, whole)
        return slice(max(first, 0), max(stop, 0))

    def num_layers_between(self, low_m: float, high_m: float) -> int:
        """How many layers have their lower face in a range of heights, whether the grid has them or not."""
        first, stop = self._layer_range(low_m, high_m, whole=False)
        return stop - first

    def _layer_range(self, low_m: float, high_m: float, whole: bool) -> tuple[int, int]:
        low, high = ((z - self.origin_m[2]) / self.resolution_m for z in (low_m, high_m))
        return math.ceil(low - _EDGE), math.floor(high + _EDGE) if whole else math.ceil(high - _EDGE)


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the zero-crossing of the SDF, with normals and uncertainty."""

    xyz_m: Float32[np.ndarray, "n 3"]
    """World x, y, z [m]."""
    normal: Float32[np.ndarray, "n 3"]
    """Unit normals in the world, pointing into free space."""
    uncertainty: Float32[np.ndarray, " n"]
    """A variance up to a constant factor, such as that of Eq. 4 of the paper; larger is less certain."""


def thinning_stride(focal_px: float, least_px: float) -> int:
    """Of so many rows and columns one is kept, to thin images of a focal length to about another [px]; 1 where they are
    no sharper.
    """
    return max(1, round(focal_px / least_px))


@dataclass(frozen=True)
class SurfaceErrors:
    """How well the map knows its surface, point by point."""

    xyz_m: Float32[np.ndarray, "n 3"]
    """Zero-crossings, in the world."""
    error_m: Float32[np.ndarray, " n"]
    """The part of the expected distance to the true surface that more observations can take away [m]."""
    num_observations: Float32[np.ndarray, " n"]
    """Pixels of all frames that fell on the voxel about each point."""
    exponent: float
    """``error_m`` falls as ``num_observations ** -exponent``."""
    counted_focal_px: float = math.inf
    """Sharper images are thinned to about this focal length before their pixels are counted [px], as by
    :func:`thinning_stride`. By default, every pixel counts."""


@dataclass(frozen=True)
class SurfaceChange:
    """A piece of surface that has changed since an earlier run."""

    kind: str
    """``gone`` (seen through now) or ``new`` (hit where it was free)."""
    xyz_m: Float[np.ndarray, "n 3"]
    """Centres of its voxels, in the world."""
    voxel_m: float
    """Edge of a voxel [m]."""

    @property
    def box_m(self) -> Float[np.ndarray, "2 3"]:
        """Lower and upper corner of its box in the world [m]."""
        half = 0.5 * self.voxel_m
        return np.stack([self.xyz_m.min(axis=0) - half, self.xyz_m.max(axis=0) + half])


@dataclass(frozen=True)
class ExploredState:
    """What a run found out beside its map, for another one to go on from."""

    policy: str
    """Name of its policy."""
    poses: Float[np.ndarray, "n 3"]
    """Where its robot was, and those of the runs that it went on from: x [m], y [m], yaw [rad] in the world."""
    collisions: Float[np.ndarray, "k 3"]
    """Poses from which a forward step met an obstacle, likewise."""
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    """What its policy remembered (:meth:`anm_mj.protocols.Continues.memory`)."""


class TrainingEffort(NamedTuple):
    """Effort on one frame, in place of the schedule's."""

    iterations: int
    """Training iterations."""
    current_rays: int
    """Rays per iteration from the frame at hand, at most; the others come from keyframes."""
    is_keyframe: bool | None = None
    """Whether the frame is kept for replay; None = as the schedule says."""


@dataclass(frozen=True)
class MapUpdate:
    """The effect of one call of ``Mapper.integrate``."""

    loss: float
    """Total training loss of the last iteration; NaN when no iteration ran."""
    num_iterations: int
    num_keyframes: int
    closes_loop: bool = False
    """Whether earlier keyframes were moved, because a place was seen again."""
