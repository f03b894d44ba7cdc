"""How well a frame fits a place where a lost camera may be, and from which scores on such a place is believed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.localisation.localisation_config import RelocalisationConfig
from anm_mj.localisation.map_probe import Agreement
from anm_mj.localisation.registration import Registration

_DOUBT_FRAMES = 2
"""Frames of half a score that every hypothesis begins with."""


@dataclass
class Hypothesis:
    """A place where the camera may be."""

    T_world_camera: Float[np.ndarray, "4 4"]
    score: float = 0.0
    """Sum over frames of how well each fits, each in [0, 1]."""
    num_frames: int = 0
    found: Registration | None = None
    expected: bool = False
    """Whether it is where the camera would be, had it not been lost."""

    @property
    def mean(self) -> float:
        """Mean of the frames' scores."""
        return self.score / max(1, self.num_frames)

    @property
    def sobered(self) -> float:
        """The same with a few indifferent frames added, so that one good frame alone makes no good place."""
        return (self.score + 0.5 * _DOUBT_FRAMES) / (self.num_frames + _DOUBT_FRAMES)


def frame_score(fits: Agreement, found: Registration, config: RelocalisationConfig) -> float:
    """How well a frame fits where it was registered, in [0, 1]."""
    # Unknown space neither speaks for a place nor against it, but a frame of it proves nothing.
    certain = min(1.0, fits.known / config.least_known)
    # Rooms of one shape are told apart by their colours, which light changes.
    return certain * fits.share * found.inliers * (0.5 + 0.5 * found.colors)


def believable(
    hypotheses: Sequence[Hypothesis],
    config: RelocalisationConfig,
    usual_score: float = math.nan,
    T_expected: Float[np.ndarray, "4 4"] | None = None,
) -> Hypothesis | None:
    """The hypothesis that enough frames confirm while no other is nearly as good, if there is one.

    Buildings have rooms that look alike, and a robot is lost more often than it is carried away: places that odometry
    cannot explain do not compete with the one where odometry has the camera.

    ``usual_score`` is what frames scored while the camera was tracked, NaN = nobody knows; ``T_expected`` where it
    would be, had it not been lost, None = nobody knows, or it may have been carried.
    """
    near = hypotheses
    if T_expected is not None:
        near = [
            each for each in hypotheses if math.dist(each.T_world_camera[:3, 3], T_expected[:3, 3]) <= config.carried_m
        ]
    if not near:
        return None
    best = max(near, key=lambda each: each.sobered)
    least = config.least(usual_score) * (config.expected_share if best.expected else 1.0)
    if best.num_frames < config.frames or best.mean < least:
        return None
    leads = (
        (best.sobered - other.sobered) * math.sqrt(min(best.num_frames, other.num_frames) + _DOUBT_FRAMES)
        for other in (near if best.expected else hypotheses)
        if other is not best
    )
    return best if min(leads, default=math.inf) >= config.least_lead else None
