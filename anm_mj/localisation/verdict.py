"""Whether a frame fits the map where it was registered."""

from enum import Enum

from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import Prior, Registration
from anm_mj.localisation.registration_starts import is_jump
from anm_mj.localisation.relocalisation_scores import frame_score
from anm_mj.mapping.alignment import FramePoints


class Verdict(Enum):
    """What the map says of a frame's pose."""

    FITS = "fits"
    UNKNOWN = "unknown"
    """The map knows too little of what the frame shows."""
    JUMPS = "jumps"
    """It fits, but too far from its prior to be believed of one frame."""
    CONTRADICTS = "contradicts"


def judged(
    points: FramePoints,
    prior: Prior,
    found: Registration,
    probe: MapProbe,
    config: LocalisationConfig,
    least_score: float,
) -> tuple[Verdict, float]:
    """The verdict on a frame, and its score in [0, 1], by :func:`~.relocalisation_scores.frame_score`.

    Args:
        points: Of the frame.
        prior: Of its pose.
        found: Its registration.
        probe: The map.
        config: What is enough.
        least_score: A frame with a lower score contradicts the map, too.
    """
    fits, tracking = probe.agreement(points, found.T_world_camera), config.tracking
    score = frame_score(fits, found, config.relocalisation)
    if (
        (fits.known >= tracking.least_known and fits.share < tracking.least_agreement)
        or (found.known >= tracking.least_known and found.inliers < tracking.least_inliers)
        or score < least_score
    ):
        return Verdict.CONTRADICTS, score
    if is_jump(prior, found, config.registration):
        return Verdict.JUMPS, score
    return (Verdict.UNKNOWN if found.known < tracking.least_known else Verdict.FITS), score
