"""Notices a camera that has stopped measuring, and keeps what it gives then out of the map.

A frame that cannot be true is handed on without depth: one without any although the map expects some
(:mod:`anm_mj.sensing.expected_view`), a black one without depth of a camera that had colours, or without new depth
although the robot moved, one that repeats the last although the robot moved, one of another shape, one without a pose.
The map and the policies then learn nothing from it. So many of them in a row end the run. In the dark, images are black
and depth is true. To see nothing where nothing is expected, such as beyond an edge, is a measurement. After a few such
frames the robot has to look around; a whole turn without any depth is a fault all the same.
Single pixels that nothing beside them agrees with are left out, and a jump of the pose is undone where the map says
that the robot did not jump (:mod:`anm_mj.sensing.pose_check`).
"""

import logging
import math
from dataclasses import astuple, replace

import numpy as np

from anm_mj.sensing.expected_view import ExpectedView, GridQuery, expected_view
from anm_mj.sensing.pixel_state import FAR_SHARE, find_outliers, is_measured, judge_pixels
from anm_mj.sensing.pose_check import PoseCheck
from anm_mj.types import TURN_STEP_RAD, Action, Intrinsics, Observation, SdfQuery

_logger = logging.getLogger(__name__)

PATIENCE_FRAMES = 12
"""This many faulty frames in a row make a fault."""
FULL_TURN_FRAMES = round(math.tau / TURN_STEP_RAD)
"""So many turns look all around: without any depth meanwhile the camera is broken, whatever the map expects."""
EXPECTED_SHARE = 0.1
"""A frame without depth is faulty where the map expects surface in this share of it. Less may be the error of a voxel
at an edge."""
FEW_FRAMES = 3
"""One frame without depth may show a wall that is too near; after this many, nothing is known of the surroundings."""
BLACK_LEVEL = 8
"""An image without any brighter value is black: what a closed lens shows is not all zero [0..255]."""
LEAST_SHARE = 0.1
"""Behind a black image only depth in at least this share of it counts: matching finds some in noise alone."""
LEAST_RANGE_M = 4.0
"""A camera that measured nothing farther than this may have stood in a small room [m]."""
RANGE_FRAMES = 24
"""After so many frames the robot has looked around."""
MANY_OUTLIERS = 0.002
"""A frame with a larger share of pixels that no neighbour agrees with is not a camera's usual one."""
SAY_AGAIN_FRAMES = 50
"""A fault that comes and goes is said again after so many faulty frames."""

BLIND, NOTHING, REPEATED, BLACK = "blind", "nothing", "repeated", "black"
SHAPE, POSE, SPECKLED = "shape", "pose", "speckled"
_FIRST = {
    BLIND: "Frame %d holds no depth, although some is to be expected; it is left out of the map.",
    REPEATED: "Frame %d repeats the last one although the robot moved.",
    BLACK: "Frame %d is black, and its depth is not new; it is left out of the map.",
    SHAPE: "Frame %d has another size than the camera's first one; it is left out of the map.",
    POSE: "The pose of frame %d is not finite; the frame is left out of the map.",
    SPECKLED: "Frame %d holds depth that no pixel beside it agrees with; such pixels are left out of the map.",
}
_FAULT = {
    NOTHING: "The camera measured no depth in {} frames in a row",
    BLIND: "The camera measured no depth in {} frames in a row",
    REPEATED: "The camera gave the same image {} times although the robot moved",
    BLACK: "The camera gave black images without new depth in {} frames in a row",
    SHAPE: "The camera gave images of another size than at first in {} frames in a row",
    POSE: "The pose was not finite in {} frames in a row",
}


class SensorMonitor:
    """Counts faulty frames in a row, and hands on what can be believed."""

    def __init__(self) -> None:
        self._in_a_row = dict.fromkeys(_FAULT, 0)
        self._num_seen = 0
        """Frames in a row with depth."""
        self._patience = PATIENCE_FRAMES
        """Frames in a row without depth after which the robot has to look around."""
        self._num_faulty = dict.fromkeys(_FIRST, 0)
        self._farthest_m = 0.0
        """Largest depth that was measured by more than single pixels [m]; 0 before the first."""
        self._says_far = False
        """Whether the camera says where it looked farther than its range."""
        self._num_frames = 0
        self._expected: ExpectedView | None = None
        """Of the last frame without depth."""
        self._sees = False
        self._has_colour = False
        self._camera: tuple[int | float, ...] = ()
        """The intrinsics of the first frame, as numbers; empty before it."""
        self._last: Observation | None = None
        self._pose = PoseCheck()

    @property
    def is_blind(self) -> bool:
        """Whether the camera has measured nothing yet, or nothing in the last few frames."""
        unusable = max(count for kind, count in self._in_a_row.items() if kind != NOTHING)
        return not self._has_measured or unusable >= FEW_FRAMES

    @property
    def sees(self) -> bool:
        """Whether the last frame tells what lies ahead; else the robot must not drive forward."""
        return self._sees

    @property
    def must_look_around(self) -> bool:
        """Whether the camera has measured nothing for so long that a turn has to show whether it still can."""
        # A few more tell the policy of an obstacle first: see FEW_FRAMES.
        return self._in_a_row[BLIND] > FEW_FRAMES or self._shows_nothing

    @property
    def _shows_nothing(self) -> bool:
        """Whether so many frames have no depth that a whole turn has to show some."""
        return self._in_a_row[NOTHING] >= self._patience

    @property
    def _has_measured(self) -> bool:
        return self._farthest_m > 0.0

    @property
    def fault(self) -> str | None:
        """What is wrong with the camera, as the beginning of a sentence; None while nothing is."""
        for kind, sentence in _FAULT.items():
            if self._in_a_row[kind] >= (self._patience + FULL_TURN_FRAMES if kind == NOTHING else PATIENCE_FRAMES):
                told = sentence.format(self._in_a_row[kind] + (kind == REPEATED))
                return told + self._expectation() if kind in (NOTHING, BLIND) else told
        return None

    def _expectation(self) -> str:
        """What a frame without depth was held against, as the end of a sentence."""
        if self._expected is None:
            return ", and none before"
        share, within_m = self._expected
        return f"; the last time, the map expected surface within {within_m:.1f} m in {share:.0%} of the view"

    def check(
        self,
        observation: Observation,
        *,
        action: Action | None = None,
        moved: bool = False,
        sdf_m: SdfQuery | None = None,
        grid_at: GridQuery | None = None,
        judges_pose: bool = True,
    ) -> Observation:
        """Take a frame in. Returns the frame as far as it can be believed: with a pose, without outliers, without any
        depth where it is faulty.

        Since the last one the robot did ``action``, None for nothing, or unknown, and ``moved``, or turned, by that.
        Signed distance and occupancy are of the map before this frame: ``sdf_m`` [m] judges a jump of the pose, None:
        nobody does; ``grid_at`` tells whether there was anything to see, None: there was. ``judges_pose`` is False
        where localisation judges a pose that is not where the action led.
        """
        self._camera = self._camera or astuple(observation.intrinsics)
        raw, faulty = observation, False
        if not self._count(POSE, _has_pose(observation), observation):
            observation, faulty = self._pose.without_pose(observation, action if moved else None), True
        if not self._count(SHAPE, _has_shape_of(observation, self._camera), observation):
            observation, faulty = _blank(observation, self._camera), True
        has_depth = bool(is_measured(observation.depth_m).any())
        if has_depth and not faulty:
            measured_m = observation.depth_m[is_measured(observation.depth_m)]
            self._farthest_m = max(self._farthest_m, float(np.quantile(measured_m, 0.99)))
        self._note_depth(has_depth=has_depth)
        # A frame that was blanked here counts once, for its own reason.
        self._count(NOTHING, has_depth or faulty, observation)
        nothing = not (has_depth or faulty)
        if nothing and self._expects_nothing(observation, grid_at):
            # It neither proves the camera nor accuses it.
            self._last, self._sees = raw, True
            return judge_pixels(self._pose.check(observation, action if moved else None, None, judges=judges_pose))
        if not self._count(BLIND, not nothing, observation):
            faulty = True
        same = moved and self._last is not None and has_depth and _is_same_image(self._last, raw)
        if moved and not self._count(REPEATED, not same, observation):
            faulty = True
        black = int(observation.rgb.max(initial=0)) <= BLACK_LEVEL
        self._has_colour |= not black
        # In the dark, or among black walls, the depth goes on; before a robot that stands still it is the same, and
        # tells nothing about the camera: what was not believed is not believed then either.
        stale = self._in_a_row[BLACK] or self._in_a_row[REPEATED]
        before = self._last if moved or stale else None
        good = not black or not self._has_colour or faulty or _has_new_depth(before, observation)
        if (moved or not black or not good) and not self._count(BLACK, good, observation):
            faulty = True
        self._last, self._sees = raw, not faulty
        judge = None if faulty else sdf_m
        observation = self._pose.check(observation, action if moved else None, judge, judges=judges_pose)
        if faulty:
            observation = replace(observation, depth_m=np.full_like(observation.depth_m, np.nan))
            return judge_pixels(observation)
        return self._without_outliers(self._with_learnt_range(observation))

    def _note_depth(self, *, has_depth: bool) -> None:
        """Learn how patient to be: where a look around has just shown that the camera measures, the robot may go on
        into what it sees nothing of, or it would be turned back for ever.
        """
        self._num_seen = self._num_seen + 1 if has_depth else 0
        if has_depth and self._shows_nothing:
            self._patience = FULL_TURN_FRAMES
        elif self._num_seen >= FULL_TURN_FRAMES:
            self._patience = PATIENCE_FRAMES

    def _with_learnt_range(self, observation: Observation) -> Observation:
        """The frame with the range that images have shown so far, where the camera does not say what is beyond it."""
        self._num_frames += 1
        self._says_far |= bool(np.isposinf(observation.depth_m).any())
        if self._says_far or self._num_frames <= RANGE_FRAMES or not np.isnan(observation.depth_m).any():
            return observation
        return replace(observation, shown_range_m=max(self._farthest_m, LEAST_RANGE_M))

    def _expects_nothing(self, observation: Observation, grid_at: GridQuery | None) -> bool:
        """Whether the map knows of nothing that the camera should measure in a frame without depth."""
        self._expected = None
        if grid_at is None or not self._has_measured:
            return False
        # At the end of its range a camera loses surface, and where that end is, it need not say.
        within_m = FAR_SHARE * min(observation.range_m, self._farthest_m)
        self._expected = expected_view(observation, within_m, grid_at)
        return self._expected.share < EXPECTED_SHARE

    def _count(self, kind: str, good: bool, observation: Observation) -> bool:
        """Count a frame as good or faulty in one way, say so now and then, and return whether it is good."""
        if good:
            self._in_a_row[kind] = 0
            return True
        self._in_a_row[kind] += 1
        self._say(kind, observation)
        return False

    def _say(self, kind: str, observation: Observation) -> None:
        if kind in _FIRST and self._num_faulty[kind] % SAY_AGAIN_FRAMES == 0:
            _logger.warning(_FIRST[kind], observation.step)
        self._num_faulty[kind] = self._num_faulty.get(kind, 0) + 1

    def _without_outliers(self, observation: Observation) -> Observation:
        """The judged frame, without outliers if it has too many of them for a camera."""
        alone = find_outliers(observation.depth_m, support=1)
        if np.count_nonzero(alone) <= MANY_OUTLIERS * alone.size:
            return judge_pixels(observation)
        self._say(SPECKLED, observation)
        return judge_pixels(observation, find_outliers(observation.depth_m))


def _is_same_image(a: Observation, b: Observation) -> bool:
    # Next to all images differ in their first rows.
    if not np.array_equal(a.rgb[:8], b.rgb[:8]):
        return False
    return np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth_m, b.depth_m, equal_nan=True)


def _has_new_depth(last: Observation | None, observation: Observation) -> bool:
    """Whether a frame measures depth that neighbours agree with, and another than the last one's."""
    believed = is_measured(observation.depth_m) & ~find_outliers(observation.depth_m)
    if believed.mean() < LEAST_SHARE:
        return False
    return last is None or not np.array_equal(last.depth_m, observation.depth_m, equal_nan=True)


def _has_pose(observation: Observation) -> bool:
    pose = observation.pose
    return bool(np.isfinite([pose.x_m, pose.y_m, pose.yaw_rad]).all() and np.isfinite(observation.T_world_camera).all())


def _has_shape_of(observation: Observation, camera: tuple[int | float, ...]) -> bool:
    intrinsics = observation.intrinsics
    shape = intrinsics.height, intrinsics.width
    return astuple(intrinsics) == camera and observation.depth_m.shape == shape and observation.rgb.shape == (*shape, 3)


def _blank(observation: Observation, camera: tuple[int | float, ...]) -> Observation:
    """The frame without an image, in the shape of the first one."""
    width, height, *optics = camera
    intrinsics = Intrinsics(int(width), int(height), *optics)
    shape = intrinsics.height, intrinsics.width
    return replace(
        observation,
        rgb=np.zeros((*shape, 3), np.uint8),
        depth_m=np.full(shape, np.nan, np.float32),
        intrinsics=intrinsics,
    )
