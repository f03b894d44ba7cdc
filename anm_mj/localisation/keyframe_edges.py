"""How a frame stands to an earlier key image, by their images alone: what a pose graph is made of."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.localisation_config import GraphConfig
from anm_mj.localisation.registration import Extra
from anm_mj.localisation.se3 import camera_motion, moved_camera


@dataclass(frozen=True)
class Measured:
    """Result of :func:`measured`."""

    T_world_camera: Float64[np.ndarray, "4 4"]
    """Where the image puts the camera of the points."""
    information: Float64[np.ndarray, "6 6"]
    """Of the displacement and the rotation vector, in the world."""
    overlap: float
    """Share of the points that the image shows, in [0, 1]."""
    fit: float
    """How well these fit, in [0, 1]: the mean of their robust weights."""


def measured(
    compared: Extra,
    T_start: Float[np.ndarray, "4 4"],
    covariance: Float64[np.ndarray, "k k"],
    basis: Float64[np.ndarray, "6 k"],
    config: GraphConfig,
) -> Measured:
    """Register a frame's points to one image, from a start that is believed as little as its covariance says.

    Args:
        compared: Compares the points of the later frame with the earlier one.
        T_start: Where the later camera is sought from.
        covariance: Of that, by the directions of ``basis``.
        basis: As of :class:`~.registration.Prior`.
        config: Steps and kernels.
    """
    prior = np.linalg.inv(covariance)
    T = np.asarray(T_start, np.float64)
    for iteration in range(config.iterations):
        share = min(1.0, iteration / max(1, config.iterations - 2))
        kernel = config.first_kernel * (config.kernel / config.first_kernel) ** share
        sums = compared(T, kernel, share < 1.0)
        offset = basis.T @ camera_motion(T_start, T)
        hessian = config.information * (basis.T @ sums.hessian @ basis) + prior
        slope = config.information * (basis.T @ sums.gradient) + prior @ offset
        T = moved_camera(T, basis @ np.linalg.solve(hessian, -slope))
    sums = compared(T, config.kernel, False)
    # Geman and McClure's cost saturates: what it lacks of the worst is how well the points fit.
    fit = 1.0 - sums.cost / (sums.num_points * config.kernel**2) if sums.num_points else 0.0
    return Measured(T, config.information * sums.hessian, sums.num_points / max(1, len(compared)), fit)
