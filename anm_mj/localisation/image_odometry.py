"""The camera's motion from one frame to the next by their images alone: it holds where a frame contradicts the map, or
shows what the map knows nothing of.
"""

from dataclasses import replace

import numpy as np

from anm_mj.localisation.frame_to_images import FrameToImages, measured
from anm_mj.localisation.key_images import KeyImage
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.registration import Prior
from anm_mj.localisation.registration_starts import rotation_search

_DOUBT = 3.0
"""A motion in doubt has so many times its standard deviation."""


class ImageOdometry:
    """Follows a camera from frame to frame."""

    def __init__(self, config: LocalisationConfig) -> None:
        """Before any frame."""
        self._config = config
        self._last: KeyImage | None = None

    def see(self, image: KeyImage | None) -> None:
        """Take a frame at its estimated pose as what the next one follows; None = it shows nothing."""
        self._last = image

    def follow(self, compared: FrameToImages, prior: Prior, *, doubtful: bool) -> Prior | None:
        """The prior of a frame with the motion that its image and the last one show in place of the expected one, which
        may be farther off than its covariance says where it is ``doubtful``. None where the images show too little of
        each other, or do not fit.
        """
        if self._last is None or prior.motion_covariance is None:
            return None
        graph, basis = self._config.graph, prior.basis
        alone = compared.against(self._last)
        scale = _DOUBT**2 if doubtful else 1.0
        motion = replace(prior, covariance=scale * prior.motion_covariance, headings=None)
        start = rotation_search(motion, alone, self._config.registration)
        found = measured(alone, start, motion.covariance, basis, graph)
        if found.overlap < graph.least_overlap or found.fit < graph.least_fit:
            return None
        information = basis.T @ found.information @ basis + np.linalg.inv(motion.covariance)
        covariance = np.linalg.inv(information)
        before = prior.covariance - prior.motion_covariance
        return replace(
            prior, T_world_camera=found.T_world_camera, covariance=before + covariance, motion_covariance=covariance
        )
