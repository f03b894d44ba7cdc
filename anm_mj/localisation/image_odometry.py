"""The camera's motion from one frame to the next by their images alone: it holds where a frame contradicts the map,
fits worse than the last ones did, or shows what the map knows nothing of.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.localisation.frame_to_images import FrameToImages, Measured, measured
from anm_mj.localisation.key_images import KeyImage
from anm_mj.localisation.localisation_config import LocalisationConfig, RegistrationConfig
from anm_mj.localisation.motion_search import motion_search, rotation_search
from anm_mj.localisation.registration import Prior

_Search = Callable[[Prior, FrameToImages, RegistrationConfig], Float[np.ndarray, "4 4"]]

_DOUBT = 3.0
"""A motion in doubt has so many times its standard deviation."""
_LEAST_DOUBT = np.array([0.05] * 3 + [0.1] * 3)
"""Standard deviations [m, rad] of a motion that no odometry measured, at least: a camera may begin to move."""
_MOST_DOUBT = 1.0
"""Standard deviation [m, rad] of it, at most: farther apart two images show nothing alike."""
CLEARLY = 0.97
"""What fits less than this share as well as something else fits clearly worse."""
_SURE_FIT = 0.9
"""An image that fits so well leaves no doubt."""


def any_motion(prior: Prior) -> Float64[np.ndarray, "k k"]:
    """Covariance of a motion that nothing measured, by the directions of a prior."""
    return prior.basis.T @ np.diag(_LEAST_DOUBT**2) @ prior.basis


class ImageOdometry:
    """Follows a camera from frame to frame."""

    def __init__(self, config: LocalisationConfig, *, has_odometry: bool) -> None:
        """Before any frame; whether odometry tells the motions that priors expect."""
        self._config, self._has_odometry = config, has_odometry
        self._last: KeyImage | None = None

    @property
    def has_last(self) -> bool:
        """Whether there is a frame that the next one may follow."""
        return self._last is not None

    def see(self, image: KeyImage | None) -> None:
        """Take a frame at its estimated pose as what the next one follows; None = it shows nothing."""
        self._last = image

    def fit(self, compared: FrameToImages, T_world_camera: Float[np.ndarray, "4 4"]) -> float:
        """How well a frame's points fit the last image from a pose, by depth and grey value, in [0, 1]; NaN if it shows
        too few of them.
        """
        if self._last is None:
            return math.nan
        graph, gray_kernel = self._config.graph, self._config.key_images.gray_kernel
        alone = compared.against(self._last)
        sums = alone(T_world_camera, graph.kernel, False)
        if sums.num_points < graph.least_overlap * len(alone):
            return math.nan
        grays = 1.0 - sums.mean_gray_cost / gray_kernel**2 if alone.has_gray else 1.0
        return grays * sums.fit(graph.kernel)

    def follow(
        self, compared: FrameToImages, prior: Prior, *, doubtful: bool, slips: Sequence[Prior] | None = None
    ) -> Prior | None:
        """The prior of a frame with the motion that its image and the last one show in place of the expected one, which
        may be farther off than its covariance says where it is ``doubtful``, or no odometry measured it. None where the
        images show too little of each other, or do not fit. Wheels whose motion is in doubt may have slipped; ``slips``
        is what :meth:`follow_slip` said of that, None = it was not asked.
        """
        if self._last is None or prior.motion_covariance is None:
            return None
        search = rotation_search if self._has_odometry else motion_search
        alone, believed = compared.against(self._last), self._motion(prior, doubtful=doubtful)
        found = self._found(alone, believed, search)
        if not self._has_odometry and (found is None or found.fit < _SURE_FIT):
            # Perhaps the motion before did not go on.
            still = self._found(alone, replace(believed, T_world_camera=self._last.T_world_camera), search)
            found = max((each for each in (found, still) if each), key=lambda each: each.fit, default=None)
        followed = None if found is None else _with_motion(prior, believed, found)
        if self._has_odometry and prior.is_planar and doubtful and (found is None or found.fit < _SURE_FIT):
            usual = self.fit(compared, (followed or prior).T_world_camera)
            slipped = next(iter(self.follow_slip(compared, prior) if slips is None else slips), None)
            # Along a plain wall all motions fit alike, and odometry stands.
            if slipped is not None and not usual >= CLEARLY * self.fit(compared, slipped.T_world_camera):
                return slipped
        return followed

    def follow_slip(self, compared: FrameToImages, prior: Prior) -> list[Prior]:
        """As :meth:`follow`, for wheels that may have turned where the robot did not: the motion is any small one. All
        that images allow, the one that fits them best first: along a plain wall they do not tell.
        """
        if self._last is None or prior.motion_covariance is None:
            return []
        small = any_motion(prior)
        around = replace(prior, covariance=_DOUBT**2 * prior.motion_covariance + small, headings=None)
        still = replace(around, T_world_camera=self._last.T_world_camera)
        alone, found = compared.against(self._last), list[Prior]()
        for motion in (around, still, replace(still, covariance=small)):
            if (each := self._found(alone, motion, motion_search)) is not None:
                found.append(_with_motion(prior, motion, each))
        fits = [self.fit(compared, each.T_world_camera) for each in found]
        return [found[index] for index in np.argsort(np.negative(fits), kind="stable")]

    def _motion(self, prior: Prior, *, doubtful: bool) -> Prior:
        """Of the motion alone, as far as it is believed."""
        assert prior.motion_covariance is not None
        covariance = (_DOUBT**2 if doubtful or not self._has_odometry else 1.0) * prior.motion_covariance
        if not self._has_odometry:
            covariance = covariance + any_motion(prior)
            covariance = covariance * min(1.0, _MOST_DOUBT**2 / float(np.diag(covariance).max()))
        return replace(prior, covariance=covariance, headings=None)

    def _found(self, alone: FrameToImages, motion: Prior, search: _Search) -> Measured | None:
        """Where the last image puts a frame; None where it shows too little of it, or does not fit."""
        graph = self._config.graph
        start = search(motion, alone, self._config.registration)
        found = measured(alone, start, motion.covariance, motion.basis, graph)
        return found if found.overlap >= graph.least_overlap and found.fit >= graph.least_fit else None


def _with_motion(prior: Prior, believed: Prior, found: Measured) -> Prior:
    """A frame's prior with the motion that was measured, ``believed`` before that."""
    assert prior.motion_covariance is not None
    information = prior.basis.T @ found.information @ prior.basis + np.linalg.inv(believed.covariance)
    covariance = np.linalg.inv(information)
    before = prior.covariance - prior.motion_covariance
    return replace(
        prior, T_world_camera=found.T_world_camera, covariance=before + covariance, motion_covariance=covariance
    )
