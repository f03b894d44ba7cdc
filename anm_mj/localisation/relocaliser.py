"""A camera that is lost is found again: hypotheses from the whole map, kept or dropped by the frames that follow.

Each frame proposes places (:mod:`.coarse_search`), which are registered to the field and compared with the map. A
hypothesis moves on with the prior's motion and is registered again to every frame. One is believed when several frames
in a row confirm it and no other is nearly as good: a wrong place believed is worse than none.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from anm_mj.localisation.coarse_search import DistanceGrid, distance_grid, level, search
from anm_mj.localisation.floor_plane import pose_above_floor
from anm_mj.localisation.localisation_config import LocalisationConfig, RelocalisationConfig
from anm_mj.localisation.map_probe import Agreement, MapProbe
from anm_mj.localisation.registration import Prior, Registration, RegistrationProblem, is_planar, register
from anm_mj.localisation.se3 import camera_motion, moved_camera
from anm_mj.mapping.alignment import FramePoints

_SAME_M, _SAME_RAD = 0.25, math.radians(12.0)
"""Hypotheses that are nearer to each other are one."""
_ASIDE_M = 0.05
"""A place that is farther from another is not the same minimum [m]."""
_PAST_FRAMES = 12
"""So many frames have to fit a place that is believed, also those from before it was proposed."""
_HEIGHT_M = 0.1
"""Cameras whose heights differ by less share a grid of distances [m]."""
_REACH = 2.0
"""What a frame shows at the edges of its view lies farther away than its depth says: at most so many times the range of
the search, or it takes no part."""
_FLOOR_M = 0.1
"""World z above which the camera's stand needs free space [m]."""
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


@dataclass
class _PastFrame:
    """A frame that a place has to fit that was proposed only later."""

    points: FramePoints
    T_then_now: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))
    """The present camera in the axes of that of then."""


class Relocaliser:
    """Holds the hypotheses of a lost camera."""

    REBUILT = ("_probe",)

    def __init__(self, config: LocalisationConfig, basis: Float[np.ndarray, "6 k"], probe: MapProbe) -> None:
        """Start without any hypothesis, in a map; ``basis`` as of :class:`~.registration.Prior`."""
        self.config = config
        self._basis, self._probe = basis, probe
        self._is_free = not is_planar(basis)
        self.restart()

    def restart(
        self, T_expected: Float[np.ndarray, "4 4"] | None = None, *, has_odometry: bool = False, followed: bool = False
    ) -> None:
        """Forget all hypotheses, and the map's distances.

        Where the camera would be, had it not been lost, is known if ``T_expected`` is, and if odometry tells how it
        moves on from there, or it is ``followed``: images show each motion since it was not lost.
        """
        self.hypotheses = [] if T_expected is None else [Hypothesis(T_expected, expected=True)]
        self._T_expected = T_expected if has_odometry or followed else None
        """Where odometry, or images, alone have the camera now; None = nobody knows."""
        self._has_odometry = has_odometry
        self._is_followed = followed
        """Whether images show each motion since before the camera was lost."""
        self._past: list[_PastFrame] = []
        """The last frames that were looked at, the present one included."""
        self._num_frames = 0
        """Frames that were looked at since the camera was lost."""
        self._grids: dict[int, DistanceGrid] = {}
        """By the camera's height, in steps of ``_HEIGHT_M``."""

    def move(self, T_last_now: Float[np.ndarray, "4 4"], *, followed: bool) -> None:
        """Move all hypotheses by a motion in the camera's axes; ``followed`` as of :meth:`restart`."""
        self._is_followed = followed
        if not (followed or self._has_odometry):
            self._T_expected = None
        for hypothesis in self.hypotheses:
            hypothesis.T_world_camera = hypothesis.T_world_camera @ T_last_now
        for past in self._past:
            past.T_then_now = past.T_then_now @ T_last_now
        if self._T_expected is not None:
            self._T_expected = self._T_expected @ T_last_now

    def propose(self, T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """Take up a place where the camera may be now."""
        if not any(_are_same(T_world_camera, other.T_world_camera) for other in self.hypotheses):
            self.hypotheses.append(Hypothesis(T_world_camera))

    @property
    def T_expected(self) -> Float[np.ndarray, "4 4"] | None:
        """Where the camera is, had nobody carried it; None = nobody knows, or it may have been carried."""
        may_be_carried = not self._is_followed and self._num_frames >= self.config.relocalisation.carried_frames
        return None if may_be_carried else self._T_expected

    def look(
        self,
        points: FramePoints,
        tilts: Sequence[Float[np.ndarray, "4 4"]],
        rng: np.random.Generator,
        usual_score: float = math.nan,
    ) -> Hypothesis | None:
        """Take in a frame; returns the hypothesis that is believed now, if there is one.

        The camera may have the heights and tilts of the poses ``tilts``; one that moves freely that which the floor in
        the frame tells, too. ``usual_score`` as of :func:`believable`.
        """
        config = self.config.relocalisation
        reach_m = np.linalg.norm(points.camera_m, axis=1)
        is_near = (points.camera_m[:, 2] <= config.range_m) & (reach_m <= _REACH * config.range_m)
        near = FramePoints(*(each[is_near] for each in vars(points).values()))
        if len(near) < config.search_points:
            return None
        floor = pose_above_floor(points.camera_m, rng) if self._is_free else None
        for hypothesis in self.hypotheses:
            self._register(hypothesis, points)
        every = [*tilts] if floor is None else [*tilts, floor]
        for T_tilt in every if len(self.hypotheses) < config.candidates else ():
            T_level = level(T_tilt)
            for value, T in search(near, T_level, self._grid(float(T_level[2, 3])), config):
                if value > config.most_distance_m:
                    break
                fresh = Hypothesis(T)
                self._register(fresh, points)
                if not any(_are_same(fresh.T_world_camera, other.T_world_camera) for other in self.hypotheses):
                    self.hypotheses.append(fresh)
        self._prune()
        self._num_frames += 1
        self._past = [*self._past, _PastFrame(points)][-_PAST_FRAMES:]
        T_expected = self.T_expected
        believed = believable(self.hypotheses, config, usual_score, T_expected)
        # Without odometry nobody knows where a camera in the hand was before.
        while believed is not None and not self._is_free:
            missed = self._past[: -believed.num_frames]
            if not missed:
                break
            for past in missed:
                T_then = believed.T_world_camera @ np.linalg.inv(past.T_then_now)
                believed.score += self._score(past.points, register(self._problem(past.points, T_then)))
            believed.num_frames += len(missed)
            believed = believable(self.hypotheses, config, usual_score, T_expected)
        if believed is not None and self._is_local(believed, points):
            # A better place next to it: the frames to come decide again.
            believed.num_frames, believed.score = 0, 0.0
            if config.frames > 1:
                return None
            self._register(believed, points)
            return believable(self.hypotheses, config, usual_score, T_expected)
        return believed

    def _grid(self, height_m: float) -> DistanceGrid:
        """The map's distances for cameras at a height; below one that moves freely, there may be anything."""
        step = round(height_m / _HEIGHT_M)
        if step not in self._grids:
            config, grid = self.config.relocalisation, self._probe.occupancy.grid
            floor_m = height_m if self._is_free else _FLOOR_M
            # Distances take as much memory as the map, and are the same at all heights.
            other = next(iter(self._grids.values()), None)
            self._grids[step] = distance_grid(grid, height_m, floor_m, _REACH * config.range_m, config, other)
        return self._grids[step]

    def _is_local(self, hypothesis: Hypothesis, points: FramePoints) -> bool:
        """Whether a frame fits better a step aside, where the hypothesis then goes."""
        aside_m = self.config.relocalisation.spacing_m
        problem = self._problem(points, hypothesis.T_world_camera)
        here = best = register(problem)
        for axis in range(2):
            for side in (-aside_m, aside_m):
                other = register(problem, moved_camera(hypothesis.T_world_camera, side * np.eye(6)[axis]))
                best = min(best, other, key=lambda each: each.cost)
        change = camera_motion(here.T_world_camera, best.T_world_camera)
        if np.linalg.norm(change[:3]) <= _ASIDE_M:
            hypothesis.T_world_camera = best.T_world_camera
            return False
        # The field alone may fit better where the walls do not: what decides between places decides here too.
        if self._score(points, best) <= self._score(points, here):
            return False
        hypothesis.T_world_camera = best.T_world_camera
        return True

    def _register(self, hypothesis: Hypothesis, points: FramePoints) -> None:
        found = register(self._problem(points, hypothesis.T_world_camera))
        hypothesis.T_world_camera, hypothesis.found = found.T_world_camera, found
        hypothesis.score += self._score(points, found)
        hypothesis.num_frames += 1

    def _problem(self, points: FramePoints, T_world_camera: Float[np.ndarray, "4 4"]) -> RegistrationProblem:
        """A frame, seen from about a place."""
        config, basis = self.config.relocalisation, self._basis
        deviations = np.array([config.deviation_m] * 3 + [config.deviation_rad] * 3)
        prior = Prior(T_world_camera, basis.T @ np.diag(deviations**2) @ basis, basis)
        return RegistrationProblem(points, prior, self._probe, config.registration(self.config.registration))

    def _score(self, points: FramePoints, found: Registration) -> float:
        fits = self._probe.agreement(points, found.T_world_camera)
        return frame_score(fits, found, self.config.relocalisation)

    def _prune(self) -> None:
        """Keep the best, one of each place, and the one where odometry has the camera."""
        # A few frames before a part of the map that is wrong say nothing about the others.
        kept = [each for each in self.hypotheses if each.expected]
        for hypothesis in sorted(self.hypotheses, key=lambda each: -each.sobered):
            if hypothesis.mean < self.config.relocalisation.least_score / 2.0:
                break
            if not any(_are_same(hypothesis.T_world_camera, other.T_world_camera) for other in kept):
                kept.append(hypothesis)
        self.hypotheses = kept[: self.config.relocalisation.candidates]


def frame_score(fits: Agreement, found: Registration, config: RelocalisationConfig) -> float:
    """How well a frame fits where it was registered, in [0, 1]."""
    # Unknown space neither speaks for a place nor against it, but a frame of it proves nothing.
    certain = min(1.0, fits.known / config.least_known)
    return certain * known_score(fits, found)


def known_score(fits: Agreement, found: Registration) -> float:
    """How well that fits which the map knows of a frame, in [0, 1]."""
    # Rooms of one shape are told apart by their colours, which light changes.
    return fits.share * found.inliers * (0.5 + 0.5 * found.colors)


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


def _are_same(one: Float[np.ndarray, "4 4"], other: Float[np.ndarray, "4 4"]) -> bool:
    change = camera_motion(one, other)
    return bool(np.linalg.norm(change[:3]) < _SAME_M and np.linalg.norm(change[3:]) < _SAME_RAD)
