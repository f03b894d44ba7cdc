"""Poses of keyframes that agree best with what was measured between them: a pose graph.

Gauss-Newton on the squared deviations of measured motions, each with a robust kernel where it may be wrong. Source:
Grisetti, Kuemmerle, Stachniss and Burgard, A Tutorial on Graph-Based SLAM, 2010.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy import sparse
from scipy.sparse.linalg import splu

from anm_mj.localisation.se3 import camera_motion, moved_camera

_STILL = 1e-5
"""The search ends with steps that move no pose by more [m, rad]."""
_HOLD = 1e-6
"""Information that keeps every pose where it is, beside all edges [1/m^2, 1/rad^2]."""


@dataclass(frozen=True)
class Edge:
    """A measured motion from one keyframe to another."""

    first: int
    second: int
    T_first_second: Float64[np.ndarray, "4 4"]
    information: Float64[np.ndarray, "6 6"]
    """Inverse covariance of the second camera's displacement [m] and rotation vector [rad] along the first one's
    axes."""
    kernel: float = 0.0
    """Width of Geman and McClure's kernel on the deviation, in standard deviations; 0 = none."""

    def deviation(self, poses: Float64[np.ndarray, "n 4 4"]) -> Float64[np.ndarray, "6"]:
        """Of the second pose from where the first and the measurement put it, by displacement and rotation."""
        return camera_motion(poses[self.first] @ self.T_first_second, poses[self.second])


class _Stacked:
    """Edges as arrays, one row each."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self.first = np.array([edge.first for edge in edges])
        self.second = np.array([edge.second for edge in edges])
        self.motion = np.stack([edge.T_first_second for edge in edges])
        self.information = np.stack([edge.information for edge in edges])
        # Without a kernel, one that is too wide to matter.
        self.kernel = np.array([edge.kernel or 1e9 for edge in edges])

    def deviations(
        self, poses: Float64[np.ndarray, "n 4 4"]
    ) -> tuple[Float64[np.ndarray, "e 6"], Float64[np.ndarray, "e 6 6"]]:
        """Of the second poses from where the edges put them, and their information, in the world."""
        first = poses[self.first]
        turn = np.zeros((len(first), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = first[:, :3, :3]
        return _motions(first @ self.motion, poses[self.second]), turn @ self.information @ turn.transpose(0, 2, 1)


def chi_squares(poses: Float64[np.ndarray, "n 4 4"], edges: Sequence[Edge]) -> Float64[np.ndarray, " e"]:
    """Squared deviation of every edge in standard deviations, without kernels."""
    if not edges:
        return np.zeros(0)
    stacked = _Stacked(edges)
    deviation, information = stacked.deviations(poses)
    return np.einsum("ei,eij,ej->e", deviation, information, deviation)


def optimised(
    poses: Float64[np.ndarray, "n 4 4"],
    edges: Sequence[Edge],
    fixed: Bool[np.ndarray, " n"],
    basis: Float64[np.ndarray, "6 k"],
    iterations: int = 10,
) -> Float64[np.ndarray, "n 4 4"]:
    """The poses, camera to world, that the edges ask for, where one at least stays.

    Edges between two fixed poses have no say. ``basis`` are directions of motion of every pose, by displacement and
    rotation vector in the world.
    """
    poses = poses.copy()
    free = np.flatnonzero(~fixed)
    edges = [edge for edge in edges if not (fixed[edge.first] and fixed[edge.second])]
    if not len(free) or not edges:
        return poses
    stacked = _Stacked(edges)
    slot = np.full(len(poses), -1)
    slot[free] = np.arange(len(free))
    for _ in range(iterations):
        step = _step(poses, stacked, slot, len(free), basis)
        for at, change in zip(free.tolist(), step, strict=True):
            poses[at] = moved_camera(poses[at], basis @ change)
        if np.abs(step).max() < _STILL:
            break
    return poses


def _step(
    poses: Float64[np.ndarray, "n 4 4"],
    edges: _Stacked,
    slot: Int64[np.ndarray, " n"],
    num_free: int,
    basis: Float64[np.ndarray, "6 k"],
) -> Float64[np.ndarray, "m k"]:
    """Of Gauss-Newton, for the free poses."""
    size = basis.shape[1]
    deviation, information = edges.deviations(poses)
    square = np.einsum("ei,eij,ej->e", deviation, information, deviation)
    information *= ((edges.kernel**2 / (edges.kernel**2 + square)) ** 2)[:, None, None]
    first = poses[edges.first]
    carried = np.tile(np.eye(6), (len(first), 1, 1))
    x, y, z = ((first @ edges.motion)[:, :3, 3] - first[:, :3, 3]).T
    carried[:, 0, 4], carried[:, 0, 5], carried[:, 1, 5] = z, -y, x
    carried[:, 1, 3], carried[:, 2, 3], carried[:, 2, 4] = -z, y, -x
    sides = ((slot[edges.first], -carried @ basis), (slot[edges.second], np.tile(basis, (len(first), 1, 1))))
    gradient = np.zeros((num_free, size))
    # What no edge holds stays where it is.
    rows, cols = [np.arange(num_free * size)], [np.arange(num_free * size)]
    values = [np.full(num_free * size, _HOLD)]
    inner = np.arange(size)
    for at, left in sides:
        weighted = left.transpose(0, 2, 1) @ information
        np.add.at(gradient, at[at >= 0], np.einsum("eki,ei->ek", weighted, deviation)[at >= 0])
        for other, right in sides:
            both = (at >= 0) & (other >= 0)
            block = (weighted @ right)[both]
            row = at[both, None, None] * size + inner[:, None]
            col = other[both, None, None] * size + inner
            rows.append(np.broadcast_to(row, block.shape).ravel())
            cols.append(np.broadcast_to(col, block.shape).ravel())
            values.append(block.ravel())
    shape = (num_free * size, num_free * size)
    hessian = sparse.coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape).tocsc()
    return splu(hessian).solve(-gradient.ravel()).reshape(num_free, size)


def _motions(
    from_poses: Float64[np.ndarray, "e 4 4"], to_poses: Float64[np.ndarray, "e 4 4"]
) -> Float64[np.ndarray, "e 6"]:
    """As :func:`~.se3.camera_motion`, for rotations well below half a turn."""
    turned = to_poses[:, :3, :3] @ from_poses[:, :3, :3].transpose(0, 2, 1)
    upper, lower = (2, 0, 1), (1, 2, 0)
    sine = 0.5 * (turned[:, upper, lower] - turned[:, lower, upper])
    length = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(length, 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0))
    scale = np.where(length > 1e-9, angle / np.maximum(length, 1e-9), 1.0)
    return np.concatenate((to_poses[:, :3, 3] - from_poses[:, :3, 3], sine * scale[:, None]), axis=1)
