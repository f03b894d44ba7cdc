"""Tracking: whether a frame fits the map where it was registered, and how much is trained on it. One that fits less
well than usual may be in a wrong place.
"""

import math
import statistics
from enum import Enum

from anm_mj.localisation.localisation_config import LocalisationConfig, TrackingConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import Prior, Registration
from anm_mj.localisation.registration_starts import is_jump
from anm_mj.localisation.relocaliser import frame_score, known_score
from anm_mj.mapping.alignment import FramePoints
from anm_mj.types import TrainingEffort

_FRAMES = 20
"""So many frames say what is usual,"""
_RECENT = 3
"""and so many what frames score just now: where much is new, less than usual."""


class Verdict(Enum):
    """What the map says of a frame's pose."""

    FITS = "fits"
    UNKNOWN = "unknown"
    """The map knows too little of what the frame shows."""
    JUMPS = "jumps"
    """It fits, but too far from its prior to be believed of one frame."""
    CONTRADICTS = "contradicts"


class FitHistory:
    """What registrations of the last frames that fitted cost and scored."""

    def __init__(self) -> None:
        """Before any frame."""
        self.costs: list[float] = []
        """A point's, in squared standard deviations."""
        self._scores: list[float] = []

    def add(self, cost: float, score: float) -> None:
        """Take in a frame that fitted: what a point of it cost, and its score in [0, 1]."""
        self.costs = [*self.costs, cost][-_FRAMES:]
        self._scores = [*self._scores, score][-_FRAMES:]

    @property
    def usual_score(self) -> float:
        """What frames score; NaN before any did."""
        return statistics.median(self._scores) if self._scores else math.nan

    @property
    def recent_score(self) -> float:
        """What the last ones score; NaN before any did."""
        return statistics.median(self._scores[-_RECENT:]) if self._scores else math.nan


def judged(
    points: FramePoints,
    prior: Prior,
    found: Registration,
    probe: MapProbe,
    config: LocalisationConfig,
    least_score: float,
    least_known_score: float = 0.0,
) -> tuple[Verdict, float]:
    """The verdict on a frame, and its score in [0, 1], by :func:`~.relocaliser.frame_score`. One that scores less than
    ``least_score``, or less than ``least_known_score`` by what the map knows of it, if it knows enough, contradicts the
    map, too.
    """
    fits, tracking = probe.agreement(points, found.T_world_camera), config.tracking
    score = frame_score(fits, found, config.relocalisation)
    # What shows new space alone contradicts nothing.
    is_known = min(found.known, fits.known) >= tracking.least_known
    if (
        (fits.known >= tracking.least_known and fits.share < tracking.least_agreement)
        or (found.known >= tracking.least_known and found.inliers < tracking.least_inliers)
        or (is_known and known_score(fits, found) < least_known_score)
        or score < least_score
    ):
        return Verdict.CONTRADICTS, score
    if is_jump(prior, found, config.registration):
        return Verdict.JUMPS, score
    return (Verdict.UNKNOWN if found.known < tracking.least_known else Verdict.FITS), score


def is_sure(deviations: tuple[float, float], config: TrackingConfig) -> bool:
    """Whether standard deviations of a position [m] and a rotation [rad] are small enough for the map."""
    return deviations[0] <= config.most_deviation_m and deviations[1] <= config.most_deviation_rad


class TrainingPace:
    """The first frames decide all later drift: they are trained on longer.

    Frames that show much that the map does not know yet become keyframes sooner, or the next frame would be registered
    to what only one batch has shown.
    """

    def __init__(self, config: TrackingConfig) -> None:
        """Before the first frame."""
        self._config = config
        self._num_mapped = 0
        self._since_keyframe = 0

    def next(self, known: float) -> TrainingEffort:
        """The effort for the next frame that is mapped, by the share of its points that the map knows."""
        config = self._config
        self._num_mapped += 1
        fresh = self._num_mapped <= config.young_frames or known < config.familiar
        self._since_keyframe += 1
        is_keyframe = self._since_keyframe >= (config.fresh_keyframe_every if fresh else config.keyframe_every)
        if is_keyframe:
            self._since_keyframe = 0
        return TrainingEffort(config.young_iterations if fresh else config.iterations, config.current_rays, is_keyframe)
