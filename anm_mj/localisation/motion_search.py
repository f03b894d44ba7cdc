"""Where earlier images put a camera whose motion is vague, searched for along one direction after the other."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.key_images import Sums
from anm_mj.localisation.localisation_config import RegistrationConfig
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.se3 import moved_camera

MOST_STEPS = 40
"""Places on either side that a motion is looked for at, at most."""
_MOST_STEP = 0.03
"""Places are tried at most so far apart [m, rad]."""
_UNSEEN_COST = 20.0
"""Of a point that the last image does not show, in squared standard deviations; the worst of the others cost 400."""
_LEAST_DEVIATION = 1e-6
"""A direction that is known better than this does not exist for the camera [m, rad]."""


def rotation_search(prior: Prior, extra: FrameToImages, config: RegistrationConfig) -> Float[np.ndarray, "4 4"]:
    """Where earlier images put a camera whose rotation is vague, of several rotations about the prior.

    A picture's basin is a few pixels; a turn may be measured wrong by more. Each direction of rotation is searched in
    turn, with the displacement that goes with it.
    """
    vague = np.sqrt(np.diag(prior.covariance)) >= config.search_least_rad
    directions = np.eye(len(vague))[np.any(prior.basis[3:] != 0.0, axis=0) & vague]
    # Off the right place depth says more about the displacement than about the rotation, and leads astray.
    return _search(prior, extra, config, directions, lambda sums, _: mean_cost(extra, sums))


def motion_search(prior: Prior, extra: FrameToImages, config: RegistrationConfig) -> Float[np.ndarray, "4 4"]:
    """Where the last image puts a camera whose motion nobody measured: along and about each of its axes.

    Far from the right place a few points that are left in view may have fitting grey values, but not depths as well;
    and what slides out of view is no gain. On a floor, where less can go wrong, grey values count beside depth.
    """
    directions = np.kron(np.eye(2), prior.T_world_camera[:3, :3].T) @ prior.basis
    exists = np.sqrt(np.diag(directions @ prior.covariance @ directions.T)) >= _LEAST_DEVIATION
    has_gray = extra.has_gray and prior.is_planar

    def mean(sums: Sums, num_points: int) -> float:
        return _mean_of_all(sums, num_points) + (sums.mean_gray_cost if has_gray else 0.0)

    return _search(prior, extra, config, directions[exists], mean)


def mean_cost(extra: FrameToImages, sums: Sums) -> float:
    """Of a point, by its grey value where there is one."""
    return sums.mean_gray_cost if extra.has_gray else sums.cost / max(sums.num_points, 1.0)


def _mean_of_all(sums: Sums, num_points: int) -> float:
    """Cost of a point, by depth, of all that are looked for."""
    return (sums.cost + _UNSEEN_COST * (num_points - sums.num_points)) / num_points


def _search(
    prior: Prior,
    extra: FrameToImages,
    config: RegistrationConfig,
    directions: Float[np.ndarray, "n k"],
    mean: Callable[[Sums, int], float],
) -> Float[np.ndarray, "4 4"]:
    """The cheapest place that is reached from the prior along one direction after the other; ``mean`` is the cost of a
    point, by sums over those that take part, and how many there are in all.
    """
    few = extra.subsample(config.retry_points)
    information = np.linalg.inv(prior.covariance)
    headings = prior.headings

    def looks(offset: Float[np.ndarray, " k"]) -> tuple[float, float]:
        """Cost of an offset, and the points that take part."""
        T = moved_camera(prior.T_world_camera, prior.basis @ offset)
        sums = few(T, config.first_kernel, True)
        walls = 0.0 if headings is None else headings.sums(T).cost
        cost = config.information * len(extra) * mean(sums, len(few)) + float(offset @ information @ offset) + walls
        return cost, sums.num_points

    def best_step(begin: Float[np.ndarray, " k"], along: Float[np.ndarray, " k"]) -> tuple[float, np.ndarray]:
        """The cheapest of several steps along a direction, from an offset on: its cost, and the offset then."""
        spread = along @ prior.covariance
        deviation = math.sqrt(float(spread @ along))
        # Pictures that are farther apart have nothing to follow.
        count = min(max(6, math.ceil(3.0 * deviation / _MOST_STEP)), MOST_STEPS)
        steps = np.linspace(-3.0, 3.0, 2 * count + 1) * deviation
        if headings is not None:
            # Headings are sharper than the spacing.
            steps = np.concatenate((steps, headings.turns_rad))
        offsets = begin + steps[:, None] * spread / deviation**2
        costs, counts = np.array([looks(offset) for offset in offsets]).T
        # That a turn costs overlap says little against it; but few points may fit anywhere.
        costs[counts < 0.5 * counts.max()] = np.inf
        index = int(np.argmin(costs))
        return float(costs[index]), offsets[index]

    best, left = np.zeros(len(prior.covariance)), list(directions)
    while left:
        # The direction that explains most goes first: far off along it, steps along the others fit something else.
        found = [best_step(best, along) for along in left]
        chosen = min(range(len(left)), key=lambda index: found[index][0])
        best = found[chosen][1]
        del left[chosen]
    return moved_camera(prior.T_world_camera, prior.basis @ best)
