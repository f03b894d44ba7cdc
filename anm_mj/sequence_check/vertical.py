"""Which axis of a recorded world points up, by how cameras are held."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64

from anm_mj.sequence_check.surfaces import Surfaces

_AXES = {"z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0), "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0)}
_SURE, _REFUTED = 0.75, 0.35
"""The upper edge of the images points along the vertical by more than the first cosine in the mean; an axis along which
it points by less than the second is not the vertical."""
_TILTED = 0.8
"""A camera that is held so steadily on its side, or looks so steadily down, tells nothing by itself."""
_LEVEL = 0.95
"""Cosine of a normal that points up."""
_STEEP = 2.0
"""Or it would rise so many times as far as it travels."""
_FLOOR_SHARE, _FLOOR_RATIO = 0.05, 2.0
"""Then so large a share of what it sees has to be floor, and so many times as much as along the stated axis."""


def other_up(
    poses: Float64[np.ndarray, "n 4 4"], up: str, floor_shares: Callable[[Float64[np.ndarray, "3"]], float]
) -> str | None:
    """The axis that points up, where the way the camera is held refutes the stated one. ``poses`` are those of the
    cameras (x right, y down, z forward) in the stated world; ``floor_shares`` is the share of what is seen that is
    floor if a direction is up.
    """
    right, below, ahead = poses[:, :3, :3].mean(axis=0).T
    stated = np.array(_AXES[up])
    upright = {name: float(np.dot(-below, axis)) for name, axis in _AXES.items()}
    best = max(upright, key=lambda name: upright[name])
    if best == up or upright[best] < _SURE or upright[up] > _REFUTED:
        return None
    if abs(float(right @ stated)) > _TILTED or float(ahead @ stated) < -_TILTED:
        if _climbs(poses[:, :3, 3], stated, np.array(_AXES[best])):
            return best
        floor = floor_shares(np.array(_AXES[best]))
        if floor < max(_FLOOR_SHARE, _FLOOR_RATIO * floor_shares(stated)):
            return None
    return best


def _climbs(xyz: Float64[np.ndarray, "n 3"], stated: Float64[np.ndarray, "3"], best: Float64[np.ndarray, "3"]) -> bool:
    """Whether a camera would rise or sink by more than it travels; one that is carried does neither."""
    rises, levels = np.ptp(xyz @ stated), np.ptp(xyz @ best)
    across = np.ptp(xyz @ np.cross(stated, best))
    return bool(rises > _STEEP * max(across, levels))


def floor_share(shown: Surfaces, poses: Float64[np.ndarray, "v 4 4"], up: Float64[np.ndarray, "3"]) -> float:
    """Share of the seen points that face up and lie below the camera."""
    in_camera = np.einsum("vij,i->vj", poses[:, :3, :3], up).astype(np.float32)
    known = np.isfinite(shown.points_m[..., 0])
    row, col = np.moveaxis(shown.images.points, -1, 0)
    normal = shown.planes(np.arange(len(row))[:, None], row, col).normal
    with np.errstate(invalid="ignore"):
        faces = np.einsum("vnj,vj->vn", normal, in_camera) > _LEVEL
        below = np.einsum("vnj,vj->vn", shown.points_m, in_camera) < 0.0
    return float((faces & below & known).sum() / max(known.sum(), 1))
