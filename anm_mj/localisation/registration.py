"""Frame to field: the camera pose at which a frame's points lie on the surface and show its colours.

Gauss-Newton on the sum of a robust cost of distances and colours and the squared deviation from a prior. The kernel on
distances shrinks from step to step, so that a wrong start finds the surface and outliers end without a say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from anm_mj.localisation.frame_points import with_trust
from anm_mj.localisation.localisation_config import RegistrationConfig
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.mapping.alignment import AlignSettings, FramePoints, NormalEquations

Aligner = Callable[[FramePoints, Float[np.ndarray, "4 4"], AlignSettings], NormalEquations]
"""What compares a frame with the field, as :meth:`anm_mj.mapping.backends.backend.MapperBackend.align`."""
Extra = Callable[
    [FramePoints, Float[np.ndarray, "4 4"], float], tuple[Float64[np.ndarray, "6 6"], Float64[np.ndarray, "6"]]
]
"""Further normal equations of a frame's points at a pose, with the width of the kernel in standard deviations."""
Known = Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]]
"""Which world points [m] lie at surface that was observed."""
PLANAR = np.eye(6)[:, [0, 1, 5]]
"""Directions of motion of a base on the floor: along world x and y, and about z."""
FREE = np.eye(6)
"""Those of a camera in the hand."""


@dataclass(frozen=True)
class Prior:
    """What is known of a camera's pose before its frame is looked at."""

    T_world_camera: Float[np.ndarray, "4 4"]
    covariance: Float64[np.ndarray, "k k"]
    """By the directions in ``basis``."""
    basis: Float64[np.ndarray, "6 k"]
    """Directions of motion, by displacement [m], then rotation vector [rad] in the world; others are certain."""


@dataclass(frozen=True)
class Registration:
    """Result of :func:`register`."""

    T_world_camera: Float[np.ndarray, "4 4"]
    covariance: Float64[np.ndarray, "k k"]
    """By the directions of the prior."""
    known: float
    """Share of the points that lie at known surface."""
    inliers: float
    """Mean robust weight of these."""
    rmse_m: float
    """Root of the weighted mean squared distance [m]; NaN without points."""
    bound: int
    """Directions along which the frame tells more than the prior."""
    iterations: int


def register(
    points: FramePoints,
    prior: Prior,
    align: Aligner,
    known: Known,
    config: RegistrationConfig,
    extra: Extra | None = None,
) -> Registration:
    """The most likely pose of a frame, starting from its prior.

    Args:
        points: Pixels of the frame.
        prior: What is known of its pose.
        align: The field.
        known: Which places of the field can be trusted.
        config: Settings.
        extra: Adds to the normal equations.
    """
    basis = prior.basis
    information = np.linalg.inv(prior.covariance)
    T = prior.T_world_camera
    trusted = points
    hessian = np.zeros_like(information)

    def sums(T: Float[np.ndarray, "4 4"], share: float) -> tuple[NormalEquations, np.ndarray, np.ndarray]:
        settings = config.settings(share)
        found = align(trusted, T, settings)
        full, slope = found.hessian.sum(axis=0), found.gradient.sum(axis=0)
        if extra is not None:
            more, more_slope = extra(points, T, settings.kernel)
            full, slope = full + more, slope + more_slope
        return found, config.information * (basis.T @ full @ basis), config.information * (basis.T @ slope)

    iteration = 0
    for iteration in range(config.iterations):
        if iteration in (0, config.recheck_after):
            trusted = with_trust(points, known(_world(points, T)))
        share = min(1.0, iteration / max(1, config.shrink_iterations))
        equations, hessian, gradient = sums(T, share)
        offset = basis.T @ camera_motion(prior.T_world_camera, T) if iteration else np.zeros(basis.shape[1])
        change = np.linalg.solve(hessian + information, -(gradient + information @ offset))
        step = basis @ change
        T = moved_camera(T, step)
        if share >= 1.0 and np.linalg.norm(step[:3]) < config.still_m and np.linalg.norm(step[3:]) < config.still_rad:
            break
    trusted = with_trust(points, known(_world(points, T)))
    equations, hessian, _ = sums(T, 1.0)
    count, weight = float(equations.facts[0, 2]), float(equations.facts[0, 1])
    distance = equations.distance_m[np.isfinite(equations.distance_m)]
    cut = 2.0 * config.field_deviation_m
    close = distance[np.abs(distance) < 3 * cut]
    rmse = float(np.sqrt(np.mean(close**2))) if len(close) else float("nan")
    root = np.linalg.cholesky(prior.covariance)
    gain = np.linalg.eigvalsh(root.T @ hessian @ root)
    return Registration(
        T,
        np.linalg.inv(hessian + information),
        float(np.count_nonzero(trusted.trust)) / max(1, len(points)),
        weight / count if count else 0.0,
        rmse,
        int(np.count_nonzero(gain > 1.0)),
        iteration + 1,
    )


def _world(points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "n 3"]:
    return points.camera_m @ T_world_camera[:3, :3].T.astype(np.float32) + T_world_camera[:3, 3].astype(np.float32)
