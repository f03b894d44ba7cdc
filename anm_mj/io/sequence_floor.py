"""Finds the floor below the cameras of a recorded sequence, and how the first of them is held above it."""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Float32, Float64
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.frames import pixel_directions, transform_points
from anm_mj.io.sequence import Sequence
from anm_mj.localisation.floor_plane import pose_above_floor
from anm_mj.types import Observation

_FLOOR_FRAMES, _FLOOR_BIN_M, _FLOOR_SHARE = 30, 0.02, 0.3
_GUESSED_M = 1.0
"""A camera of which nothing is known stands so high [m]."""
_LEVEL_DEG = 2.0
"""A first camera that is tilted by less is taken to be held level."""
_NEAR_M, _FACING, _MOST, _NORMAL_SHARE = 0.03, 0.95, 0.7, 30
"""Most of what lies as near to a floor as this has normals with such a cosine to the floor's own; they are measured
across two such parts of the image's height."""

_logger = logging.getLogger(__name__)


def floor_below_first_m(sequence: Sequence) -> float:
    """Height of the floor below the first camera [m], which is the origin; a guess is said."""
    try:
        return find_floor_m(sequence.first())
    except RunFolderError:
        _logger.warning(
            "The first frame of %s shows nothing below the camera: the floor is taken to be %g m below (--floor).",
            sequence.path,
            _GUESSED_M,
        )
        return -_GUESSED_M


def find_floor_m(sequence: Sequence) -> float:
    """Height of the floor: the lowest level that holds many of the points below the cameras [m]."""
    # Some bad frames are the affair of whoever reads all.
    some = replace(sequence, frames=sequence.frames[:: max(1, len(sequence) // _FLOOR_FRAMES)], max_bad=1.0)
    heights = [_heights(observation) for observation in some.observations(says_bad=False)]
    if not heights:
        heights = [_heights(observation) for observation in sequence.first().observations()]
    below = np.median([frame.T_world_camera[2, 3] for frame in some.frames])
    z = np.concatenate(heights)
    z = z[z < below]
    if not len(z):
        raise RunFolderError(f"{sequence.path} shows nothing below its cameras; give the floor's height by --floor.")
    levels, count = np.unique(np.floor(z / _FLOOR_BIN_M), return_counts=True)
    # A level of points and its neighbours: the floor may lie on the border of two.
    total = np.concatenate([[0], np.cumsum(count)])
    both = total[np.searchsorted(levels, levels + 1.0, "right")] - total[np.searchsorted(levels, levels - 1.0)]
    lowest = levels[np.argmax(both >= _FLOOR_SHARE * both.max())]
    near = z[np.abs(z - (lowest + 1.0) * _FLOOR_BIN_M) < 2 * _FLOOR_BIN_M]
    return float(np.median(near))


def levelled(sequence: Sequence, up: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "3 3"]:
    """How the world of a sequence without poses, that of its first camera, is turned so that z points up. Its first
    frame shows the floor, or another level surface as the lowest one. ``up`` is the turn for a camera that is held
    level; it stands where no floor shows that the camera is not.
    """
    try:
        seen = _above_floor(next(sequence.first().observations()))
    except RunFolderError:
        seen = None
    if seen is None:
        return up
    normal = up @ seen[2, :3]
    tilt_rad = np.arccos(np.clip(normal[2], -1.0, 1.0))
    if np.degrees(tilt_rad) < _LEVEL_DEG:
        return up
    _logger.warning(
        "The first camera of %s is tilted by %.0f deg against the floor that it shows: the world is levelled by that.",
        sequence.path,
        np.degrees(tilt_rad),
    )
    axis = np.cross(normal, (0.0, 0.0, 1.0))
    return Rotation.from_rotvec(tilt_rad * axis / np.linalg.norm(axis)).as_matrix() @ up


def _above_floor(observation: Observation) -> Float64[np.ndarray, "4 4"] | None:
    """The camera above the floor that a frame shows; None where what lies in one plane there does not face it."""
    seen = pose_above_floor(_some_points(observation), np.random.default_rng(0))
    if seen is None:
        return None
    points = pixel_directions(observation.intrinsics)[::4, ::4] * observation.depth_m[::4, ::4, None]
    points = points @ seen[:3, :3].T + seen[:3, 3]
    # Far enough apart for a camera's noise.
    k = max(1, len(points) // _NORMAL_SHARE)
    normal = np.cross(points[k:-k, 2 * k :] - points[k:-k, : -2 * k], points[2 * k :, k:-k] - points[: -2 * k, k:-k])
    with np.errstate(invalid="ignore"):
        faces = np.abs(normal[..., 2]) > _FACING * np.linalg.norm(normal, axis=-1)
    on_it = np.isfinite(normal).all(axis=-1) & (np.abs(points[k:-k, k:-k, 2]) < _NEAR_M)
    return seen if on_it.any() and faces[on_it].mean() > _MOST else None


def _heights(observation: Observation) -> Float64[np.ndarray, " n"]:
    """Of some points that a frame shows [m]."""
    return transform_points(observation.T_world_camera, _some_points(observation))[:, 2]


def _some_points(observation: Observation) -> Float32[np.ndarray, "n 3"]:
    """Of every fourth row and column, in the camera's axes [m]."""
    depth_m = observation.depth_m[::4, ::4]
    measured = np.isfinite(depth_m)
    points = pixel_directions(observation.intrinsics)[::4, ::4][measured] * depth_m[measured][:, None]
    return points.astype(np.float32)
