"""Tracking: where a frame is, near where it is expected, and whether it fits the map there. One that fits less well
than usual may be in a wrong place.
"""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

import numpy as np

from anm_mj.localisation.frame_to_images import FrameToImages
from anm_mj.localisation.image_odometry import CLEARLY, ImageOdometry, any_motion
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.map_probe import MapProbe
from anm_mj.localisation.registration import Prior, Registration, RegistrationProblem, register
from anm_mj.localisation.registration_starts import is_jump, registered
from anm_mj.localisation.relocaliser import frame_score, known_score
from anm_mj.mapping.alignment import FramePoints

_FRAMES = 20
"""So many frames say what is usual,"""
_RECENT = 3
"""and so many what frames score just now: where much is new, less than usual."""
_SURE_IMAGE_FIT = 0.9
"""The first frame that is held against one before fits it so well, where it is."""
_UNSEEN = 0.95
"""What a frame that shows too little of the last one has of the least that fits it."""
_UNMEASURED_SHARE = 0.6
"""Where no odometry measures motions, a frame scores at least this share of what a place is believed from."""


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
        self._image_fits: list[float] = []

    def add(self, cost: float, score: float, image_fit: float) -> None:
        """Take in a frame that fitted: what a point of it cost, its score, and how well it fitted the last frame, in
        [0, 1]; NaN = nobody knows.
        """
        self.costs = [*self.costs, cost][-_FRAMES:]
        self._scores = [*self._scores, score][-_FRAMES:]
        if not math.isnan(image_fit):
            self._image_fits = [*self._image_fits, image_fit][-_FRAMES:]

    @property
    def usual_score(self) -> float:
        """What frames score; NaN before any did."""
        return statistics.median(self._scores) if self._scores else math.nan

    @property
    def recent_score(self) -> float:
        """What the last ones score; NaN before any did."""
        return statistics.median(self._scores[-_RECENT:]) if self._scores else math.nan

    @property
    def least_image_fit(self) -> float:
        """A frame that fits the last one less well is somewhere else."""
        if not self._image_fits:
            return _SURE_IMAGE_FIT
        return CLEARLY * statistics.median(self._image_fits[-_RECENT:])


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


@dataclass(frozen=True)
class Tracked:
    """A frame, where tracking has it."""

    verdict: Verdict
    score: float
    """In [0, 1]; see :func:`judged`."""
    found: Registration
    prior: Prior
    """That it was registered by."""
    expected: Prior
    """What the frames before said of it, before images did."""
    image_fit: float = math.nan
    """How well it fits the last frame, in [0, 1]; NaN = nobody knows."""
    is_followed: bool = False
    """Whether images told the motion."""


class Tracker:
    """Registers each frame near where it is expected."""

    REBUILT = ("_probe",)

    def __init__(
        self, config: LocalisationConfig, probe: MapProbe, image_odometry: ImageOdometry, *, has_odometry: bool
    ) -> None:
        """Before any frame; whether odometry tells the motions that priors expect."""
        self._config, self._probe, self._has_odometry = config, probe, has_odometry
        self._image_odometry = image_odometry
        self.history = FitHistory()

    def track(
        self,
        problem: RegistrationProblem,
        after_far: Prior | None,
        compared: FrameToImages | None,
        rng: np.random.Generator,
        *,
        misfits: int,
    ) -> Tracked:
        """Register a frame by the prior of its problem. Images say where it is if it does not fit there.

        Args:
            problem: Of the registration.
            after_far: The prior if the last frame was where it jumped to; None = it did not jump.
            compared: The frame, to be compared with the last one; None = it has no image.
            rng: What starts of a registration are drawn from.
            misfits: How many frames before it did not fit, in a row.
        """
        config = self._config
        prior, found = problem.prior, registered(problem, self.history.costs, rng)
        confirmed = None if after_far is None else self._after_jump(problem, after_far, found)
        if confirmed is not None:
            prior, found = confirmed
        usual = self.believed_score
        doubtful = confirmed is not None or misfits >= config.tracking.doubt_frames
        least, strict, floor = usual if doubtful else 0.0, 0.0, 0.0
        if not self._has_odometry:
            like_recent = config.relocalisation.usual_share * self.history.recent_score
            strict, floor = max(usual, like_recent), _UNMEASURED_SHARE * usual
        judge = partial(self._judged, problem.points, expected=prior)
        tracked = judge(prior, found, least_score=least, least_known_score=strict)
        has_wheels, slips = self._has_odometry and problem.prior.is_planar, None
        if has_wheels and compared is not None and confirmed is None:
            tracked = self._with_image_fit(tracked, compared)
            fits = tracked.verdict is Verdict.FITS
            # After a frame that was mapped nowhere the image of where it was predicted says little.
            is_believed = fits and misfits > 0 and tracked.score >= usual
            if self._may_slip(tracked) and not is_believed:
                slips = self._image_odometry.follow_slip(compared, problem.prior)
                strictly = partial(judge, least_score=least if fits else usual)
                there = self._after_slip(problem, tracked, compared, slips, strictly)
                if there is not None:
                    return there
            elif tracked.verdict is Verdict.JUMPS and self._is_less_like_last(problem.prior, tracked, compared):
                # The last frame says so, too: it was odometry that jumped.
                return replace(tracked, verdict=Verdict.FITS, is_followed=True)
        if tracked.verdict is Verdict.FITS:
            return tracked
        followed = None
        if compared is not None:
            follow = partial(self._image_odometry.follow, compared, problem.prior, slips=slips)
            is_odd = tracked.verdict is not Verdict.UNKNOWN
            followed = follow(doubtful=is_odd)
            if followed is None and has_wheels and not is_odd:
                far = follow(doubtful=True)
                followed = far if far and self._is_like_last(far, compared) else None
        if not self._has_odometry:
            tracked = judge(prior, found, least_score=least, least_known_score=floor)
        if followed is None:
            return tracked
        if tracked.verdict is Verdict.UNKNOWN:
            return replace(tracked, prior=followed, is_followed=True)
        # Odometry was wrong, or the map is. That image has its say in the registration, and none twice.
        there = replace(problem.prior, T_world_camera=followed.T_world_camera)
        again = register(replace(problem, prior=there))
        new = judge(there, again, least_score=usual if self._has_odometry else least, least_known_score=floor)
        if tracked.verdict is Verdict.FITS and new.score <= tracked.score:
            return replace(tracked, is_followed=True)
        return replace(new, prior=followed, is_followed=True)

    def _after_slip(
        self,
        problem: RegistrationProblem,
        tracked: Tracked,
        compared: FrameToImages,
        slips: Sequence[Prior],
        judge: Callable[..., Tracked],
    ) -> Tracked | None:
        """A frame that may have been looked for in a wrong place, at the likeliest of all to which images lead,
        ``slips``, and where it fits map and last frame; None where there is no such place, and it fitted nowhere
        before.
        """
        fitting = list[Tracked]()
        for prior in slips:
            # That image has its say in the registration, and none twice.
            covariance = problem.prior.covariance + any_motion(problem.prior)
            there = replace(problem.prior, T_world_camera=prior.T_world_camera, covariance=covariance)
            new = judge(there, register(replace(problem, prior=there)), least_known_score=0.0)
            new = self._with_image_fit(replace(new, prior=prior, is_followed=True), compared)
            if new.verdict is Verdict.FITS and not math.isnan(new.image_fit):
                fitting.append(new)
        best = max(fitting, key=self._evidence, default=None)
        if tracked.verdict is Verdict.FITS:
            if best is not None and CLEARLY * self._evidence(best) > self._evidence(tracked):
                return best
            is_unlike = not tracked.image_fit >= self.history.least_image_fit
            if best is None and is_unlike and slips and self._is_like_last(slips[0], compared):
                # It fits where it cannot be, and not where it is.
                return replace(tracked, verdict=Verdict.CONTRADICTS, prior=slips[0], is_followed=True)
            return tracked
        if best is not None and tracked.verdict is Verdict.UNKNOWN:
            return best if best.image_fit >= self.history.least_image_fit else None
        return best

    def _with_image_fit(self, tracked: Tracked, compared: FrameToImages) -> Tracked:
        """The same with what the last frame says."""
        return replace(tracked, image_fit=self._image_odometry.fit(compared, tracked.found.T_world_camera))

    def _may_slip(self, tracked: Tracked) -> bool:
        """Whether odometry may have been so wrong that a frame was looked for in a wrong place, where something else
        fits a little: the map, or the last frame, fits less well than usual.
        """
        is_low = tracked.score < self._config.relocalisation.usual_share * self.history.recent_score
        is_known = tracked.verdict is not Verdict.UNKNOWN
        return (is_known and is_low) or not tracked.image_fit >= self.history.least_image_fit

    def _is_like_last(self, place: Prior, compared: FrameToImages) -> bool:
        """Whether a frame at a place fits the last one as well as usual."""
        return self._image_odometry.fit(compared, place.T_world_camera) >= self.history.least_image_fit

    def _is_less_like_last(self, place: Prior, tracked: Tracked, compared: FrameToImages) -> bool:
        """Whether a frame fits the last one clearly less well at a place than where it was found."""
        return not self._image_odometry.fit(compared, place.T_world_camera) >= CLEARLY * tracked.image_fit

    def _evidence(self, tracked: Tracked) -> float:
        """How much map and last frame together say that a frame is where it is, in [0, 1]. One that should not see what
        the last one saw is hardly like it.
        """
        fit = _UNSEEN * self.history.least_image_fit if math.isnan(tracked.image_fit) else tracked.image_fit
        return tracked.score * fit

    @property
    def believed_score(self) -> float:
        """From what score on, in [0, 1], a place is believed by itself, after the last frames."""
        return self._config.relocalisation.least(self.history.recent_score)

    def _after_jump(
        self, problem: RegistrationProblem, after_far: Prior, found: Registration
    ) -> tuple[Prior, Registration] | None:
        """The prior and the registration of a frame if the last one jumped rightly; None if that is not confirmed."""
        settings = problem.config
        if self._has_odometry and not is_jump(problem.prior, found, settings):
            return None
        # Perhaps it was odometry that jumped, and two frames in a row say so.
        follows = replace(after_far, headings=problem.prior.headings)
        again = register(replace(problem, prior=follows), found.T_world_camera if self._has_odometry else None)
        if is_jump(follows, again, settings) or not (self._has_odometry or again.cost < found.cost):
            return None
        return follows, again

    def _judged(
        self,
        points: FramePoints,
        prior: Prior,
        found: Registration,
        *,
        expected: Prior,
        least_score: float,
        least_known_score: float,
    ) -> Tracked:
        verdict, score = judged(points, prior, found, self._probe, self._config, least_score, least_known_score)
        return Tracked(verdict, score, found, prior, expected)
