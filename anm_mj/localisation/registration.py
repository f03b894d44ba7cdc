"""Frame to field: the camera pose at which a frame's points lie on the surface and show its colours.

Gauss-Newton on the sum of a robust cost of distances and colours and the squared deviation from a prior. The kernel on
distances shrinks from step to step, so that a wrong start finds the surface and outliers end without a say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy.spatial import KDTree

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.localisation_config import RegistrationConfig
from anm_mj.localisation.localiser import largest_deviations
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.localisation.wall_directions import Headings
from anm_mj.mapping.alignment import FramePoints

_COARSE_STEP = 3
"""Of so many points one is registered at first."""
_LEAST_INSIDE = 0.1
"""The border counts where less than this share of what the map knows lies inside of it."""
PLANAR = np.eye(6)[:, [0, 1, 5]]
"""Directions of motion of a base on the floor: along world x and y, and about z."""
FREE = np.eye(6)
"""Those of a camera in the hand."""


class Fit(NamedTuple):
    """What the points that took part say of a pose."""

    mean_cost: float
    """In squared standard deviations."""
    share: float
    """Of these points among all."""


def is_planar(basis: Float64[np.ndarray, "6 k"]) -> bool:
    """Whether these directions of motion, as of :class:`Prior`, are those of a base on a floor."""
    return np.array_equal(basis, PLANAR)


@dataclass(frozen=True)
class Prior:
    """What is known of a camera's pose before its frame is looked at."""

    T_world_camera: Float[np.ndarray, "4 4"]
    covariance: Float64[np.ndarray, "k k"]
    """By the directions in ``basis``."""
    basis: Float64[np.ndarray, "6 k"]
    """Directions of motion, by displacement [m], then rotation vector [rad] in the world; others are certain."""
    motion_covariance: Float64[np.ndarray, "k k"] | None = None
    """The part of the covariance that the last motion brought; None where there was none."""
    headings: Headings | None = None
    """What walls say of it, which may be wrong."""

    @property
    def is_planar(self) -> bool:
        """Whether the camera moves with a base on a floor."""
        return is_planar(self.basis)

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of the position [m] and the rotation [rad], in the direction where they are largest."""
        return largest_deviations(self.basis @ self.covariance @ self.basis.T)


@dataclass(frozen=True)
class RegistrationProblem:
    """A frame, and all that its pose is sought by."""

    points: FramePoints
    """Pixels of the frame."""
    prior: Prior
    """What is known of its pose."""
    probe: MapProbe
    """The map."""
    config: RegistrationConfig
    extra: FrameToImages | None = None
    """What else adds to the normal equations."""


@dataclass(frozen=True)
class Registration:
    """Result of :func:`register`."""

    T_world_camera: Float[np.ndarray, "4 4"]
    covariance: Float64[np.ndarray, "k k"]
    """By the directions of the prior."""
    known: float
    """Share of the points that lie at known surface."""
    inliers: float
    """Mean robust weight of these, without those at its border."""
    colors: float
    """Mean robust weight of their colours; 1 without colours."""
    bound: int
    """Directions along which the frame tells more than the prior."""
    cost: float
    """Minus twice the logarithm of the likelihood, up to a constant of the frame."""
    fits: tuple[Fit, ...]
    """Of the field, and of what is added to it."""
    prior_cost: float
    """Squared deviation from the prior, in squared standard deviations."""
    heading_cost: float = 0.0
    """Robust cost of what walls say of the heading, likewise."""

    @property
    def mean_cost(self) -> float:
        """Of a point that took part, in squared standard deviations."""
        return sum(each.mean_cost for each in self.fits) / len(self.fits)


def inside_border(
    known: Bool[np.ndarray, " n"], points_m: Float32[np.ndarray, "n 3"], border_m: float
) -> Bool[np.ndarray, " n"]:
    """Which of the points of a frame [m] that the map knows lie farther than ``border_m`` from those that it does not.

    Where the surface that was observed ends, the field bends as it likes. A camera that turns before a plain wall has
    such an end in every frame, always on the same side, and little else to say where along the wall it is. Where hardly
    a point lies inside, all that are known count.
    """
    if not border_m or known.all() or not known.any():
        return known
    apart_m, _ = KDTree(points_m[~known]).query(points_m, distance_upper_bound=border_m)
    inside = known & np.isinf(apart_m)
    return inside if np.count_nonzero(inside) >= _LEAST_INSIDE * np.count_nonzero(known) else known


def register(problem: RegistrationProblem, start: Float[np.ndarray, "4 4"] | None = None) -> Registration:
    """The most likely pose of a frame; the search begins at the camera pose ``start``, None = at the prior."""
    points, prior, config, extra = problem.points, problem.prior, problem.config, problem.extra
    basis = prior.basis
    information = np.linalg.inv(prior.covariance)
    T = prior.T_world_camera if start is None else start
    trusted, known = points, np.zeros(len(points), bool)

    def fit(cost: float, num_points: float, among: int) -> Fit:
        return Fit(float(cost) / max(float(num_points), 1.0), float(num_points) / max(1, among))

    # While the kernel is wide, fewer points find the place.
    all_points, all_extra = points, extra
    points, extra = points.every(_COARSE_STEP), extra and extra.every(_COARSE_STEP)
    coarse_iterations = min(config.shrink_iterations, config.iterations)
    iteration = 0
    while True:
        if iteration == coarse_iterations:
            points, extra = all_points, all_extra
        if iteration in (0, coarse_iterations):
            world_m = points.camera_m @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32)
            known = problem.probe.known(world_m)
            inside = inside_border(known, points.camera_m, config.border_m)
            trusted = replace(points, trust=points.trust * inside.astype(np.float32))
        share = min(1.0, iteration / config.shrink_iterations) if config.shrink_iterations else 1.0
        settings = config.settings(share)
        equations = problem.probe.align(trusted, T, settings)
        full, slope = equations.hessian.sum(axis=0), equations.gradient.sum(axis=0)
        fits = [fit(equations.facts[0, 0], equations.facts[0, 2], len(points))]
        if extra is not None:
            more = extra(T, settings.kernel, share < 1.0)
            full, slope = full + more.hessian, slope + more.gradient
            fits.append(fit(more.cost, more.num_points, len(extra)))
        full, slope = config.information * full, config.information * slope
        if prior.headings is not None:
            headings = prior.headings.sums(T, share)
            full[5, 5] += headings.information
            slope[5] += headings.slope
        hessian, gradient = basis.T @ full @ basis, basis.T @ slope
        offset = basis.T @ camera_motion(prior.T_world_camera, T)
        if iteration >= config.iterations:
            break
        step = basis @ np.linalg.solve(hessian + information, -(gradient + information @ offset))
        still = math.hypot(*step[:3].tolist()) < config.still_m and math.hypot(*step[3:].tolist()) < config.still_rad
        if share >= 1.0 and still:
            break
        T = moved_camera(T, step)
        iteration += 1
    count, weight = float(equations.facts[0, 2]), float(equations.facts[0, 1])
    prior_cost = float(offset @ information @ offset)
    heading_cost = 0.0 if prior.headings is None else prior.headings.sums(T).cost
    worst = settings.kernel**2
    shared = sum(each.share * each.mean_cost + (1.0 - each.share) * worst for each in fits)
    of_points = config.information * len(points) * shared
    root = np.linalg.cholesky(prior.covariance)
    gain = np.linalg.eigvalsh(root.T @ hessian @ root)
    return Registration(
        T,
        np.linalg.inv(hessian + information),
        float(np.count_nonzero(points.trust * known)) / max(1, len(points)),
        weight / count if count else 0.0,
        float(equations.facts[1, 1]) / weight if weight and config.color_deviation else 1.0,
        int(np.count_nonzero(gain > 1.0)),
        of_points + prior_cost + heading_cost,
        tuple(fits),
        prior_cost,
        heading_cost,
    )
