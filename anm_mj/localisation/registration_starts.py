"""Where a registration begins that may end in a false minimum: a displacement is searched for, or several starts are
tried.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from anm_mj.localisation.localisation_config import RegistrationConfig
from anm_mj.localisation.motion_search import MOST_STEPS, mean_cost, rotation_search
from anm_mj.localisation.registration import Prior, Registration, RegistrationProblem, register
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.mapping.alignment import FramePoints

_SAME_M, _SAME_RAD = 0.01, 0.01
"""Searches that end so near to each other have found the same place."""


def registered(problem: RegistrationProblem, costs: Sequence[float], rng: np.random.Generator) -> Registration:
    """The likeliest pose of a frame, sought from where its prior and its doubts ask for; ``costs`` are those of a point
    of the last frames.
    """
    extra, config = problem.extra, problem.config
    found = register(problem, None if extra is None else rotation_search(problem.prior, extra, config))
    found = register_displaced(problem, found)
    if may_be_wrong(problem.prior, found, costs, config):
        found = register_from_several(problem, rng, found)
    return found


def displacement_search(
    problem: RegistrationProblem, T_world_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "4 4"] | None:
    """Where the last image puts a camera whose displacement is vague, along what that image constrains least.

    Before a near wall a centimetre is a few pixels, which is a picture's basin: a displacement along the wall has to be
    looked for. By grey values, if there are any: what slides out of view takes its cost in depth along.

    The search begins at a pose, whose rotation is kept. None if the displacement is known to some pixels, or there are
    no images.
    """
    prior, config, extra = problem.prior, problem.config, problem.extra
    if extra is None:
        return None
    few = extra.subsample(config.retry_points)
    free = np.flatnonzero(np.any(prior.basis[:3] != 0.0, axis=0))
    bound = prior.basis[:, free].T @ few(T_world_camera, config.kernel, False).hessian @ prior.basis[:, free]
    direction = np.zeros(len(prior.covariance))
    direction[free] = np.linalg.eigh(bound)[1][:, 0]
    deviation = math.sqrt(float(direction @ prior.covariance @ direction))
    least = config.search_least_view_rad * float(np.median(problem.points.camera_m[:, 2]))
    if deviation < least:
        return None
    information = np.linalg.inv(prior.covariance)
    begin = prior.basis.T @ camera_motion(prior.T_world_camera, T_world_camera)
    count = min(math.ceil(6.0 * deviation / least), MOST_STEPS)
    steps = np.linspace(-3.0 * deviation, 3.0 * deviation, 2 * count + 1).tolist()
    places = [moved_camera(T_world_camera, prior.basis @ (step * direction)) for step in steps]
    tried = [few(place, config.kernel, False) for place in places]
    offsets = [begin + step * direction for step in steps]
    away = [float(offset @ information @ offset) for offset in offsets]
    scale = config.information * len(extra)
    costs = [scale * mean_cost(extra, sums) + far for sums, far in zip(tried, away, strict=True)]
    # What slides out of view costs nothing, and says nothing.
    counts = np.array([sums.num_points for sums in tried])
    seen = counts >= max(1.0, 0.5 * counts.max())
    return places[int(np.argmin(np.where(seen, costs, np.inf)))] if seen.any() else None


def is_jump(prior: Prior, found: Registration, config: RegistrationConfig) -> bool:
    """Whether a pose is too far from its prior to be believed of one frame."""
    return found.prior_cost > config.most_prior * len(prior.covariance)


def may_be_wrong(prior: Prior, found: Registration, costs: Sequence[float], config: RegistrationConfig) -> bool:
    """Whether a registration may have ended in a false minimum: it costs more than usual, or is far from its prior."""
    position, rotation = prior.deviations
    vague = position > config.retry_least_m or rotation > config.retry_least_rad
    usual = statistics.median(costs) if costs else 0.0
    dear = found.mean_cost > usual * (config.retry_vague_cost if vague else config.retry_cost)
    return dear or found.prior_cost > config.retry_prior * len(prior.covariance)


def register_from_several(problem: RegistrationProblem, rng: np.random.Generator, first: Registration) -> Registration:
    """The likeliest of a registration and of those from starts that are drawn about the prior.

    No more starts are drawn once several have led to the best place so far. Arguments as of :func:`registered`.
    """
    prior, config, extra = problem.prior, problem.config, problem.extra
    few = problem.points.about(config.retry_points)
    quick = replace(problem, points=few, extra=extra and extra.every(max(1, len(extra) // config.retry_points)))

    def cost(found: Registration) -> float:
        return _cost_beside(problem, few, first, found)

    best, lowest, times = first, config.retry_gain * cost(first), 0
    least = prior.basis.T @ np.repeat([config.retry_least_m, config.retry_least_rad], 3)
    deviations = np.maximum(least, config.retry_deviations * np.sqrt(np.diag(prior.covariance)))
    for _ in range(config.retry_starts):
        offset = prior.basis @ (deviations * rng.standard_normal(len(deviations)))
        start = moved_camera(prior.T_world_camera, offset)
        found = register(quick, start)
        off, value = camera_motion(best.T_world_camera, found.T_world_camera), cost(found)
        is_same = math.hypot(*off[:3].tolist()) < _SAME_M and math.hypot(*off[3:].tolist()) < _SAME_RAD
        if value < lowest:
            best, lowest, times = found, value, times + 1 if is_same else 1
        else:
            # All may have come back to a place that nobody believes.
            times += is_same and lowest < np.inf
        if times >= config.retry_agreeing:
            break
    return best if best is first else register(problem, best.T_world_camera)


def register_displaced(problem: RegistrationProblem, first: Registration) -> Registration:
    """The likelier of a registration and of that from where :func:`displacement_search` leads.

    While the kernel is wide and images are coarse, what hardly constrains a displacement lets go of it: this one begins
    with the last kernel. Arguments as of :func:`registered`.
    """
    start = displacement_search(problem, first.T_world_camera)
    if start is None:
        return first
    found = register(replace(problem, config=replace(problem.config, shrink_iterations=0)), start)
    few = problem.points.about(problem.config.retry_points)
    is_likelier = _cost_beside(problem, few, first, found) < _cost_beside(problem, few, first, first)
    return found if is_likelier else first


def _cost_beside(problem: RegistrationProblem, few: FramePoints, first: Registration, found: Registration) -> float:
    """Cost of a registration, to be compared with others of the same frame; infinite for a jump.

    A wrong pose may fit nearly as many points as the right one. Costs of poses that bring different points to known
    surface compare as follows: a point that the map contradicts costs as much as the worst of outliers, one in unknown
    space as much as the first pose's points on average.
    """
    config = problem.config
    if is_jump(problem.prior, found, config):
        return math.inf
    at_odds = (problem.probe.contradicted(few, found.T_world_camera), 0.0)
    total = 0.0
    for now, usual, wrong in zip(found.fits, first.fits, at_odds, strict=False):
        taken = min(now.share, 1.0 - wrong)
        total += taken * now.mean_cost + wrong * config.kernel**2 + (1.0 - taken - wrong) * usual.mean_cost
    return config.information * len(problem.points) * total + found.prior_cost + found.heading_cost
