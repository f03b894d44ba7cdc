"""Completion against steps; a live run and its folder give the same rows."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt16

from anm_mj.evaluation.completion import Completion, Coverage
from anm_mj.frames import wrap_angle
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.curve_file import COLUMNS
from anm_mj.types import Intrinsics, Pose2

CHECKPOINT_STEPS = 10
"""Steps between two rows of the curve."""
CURVE_HEADER = ",".join(COLUMNS)
"""First line of ``curve.csv``; ratios in per cent."""


@dataclass(frozen=True)
class CurveRow:
    """Completion at a step."""

    step: int
    completion_ratio: float
    """Completion ratio (< 5 cm) [%]."""
    completion_cm: float
    """Completion, capped at 1 m [cm]."""
    observable_ratio: float | None
    """Completion ratio of the observable surface [%]; None if that is not known."""
    path_m: float
    position_error_cm: float | None = None
    """Distance between the believed and the true place of the base [cm]; None where the pose is exact or not known."""
    heading_error_deg: float | None = None
    """Angle between the believed and the true heading, without sign [deg]; None likewise."""

    @property
    def csv(self) -> str:
        """The row as a line of ``curve.csv``, every digit kept."""
        return ",".join("" if value is None else repr(value) for value in vars(self).values())


class CompletionCurve:
    """Adds the frames of a run in order and keeps a row for every tenth step and for the last."""

    def __init__(
        self,
        truth: GroundTruth | None,
        before_m: Float32[np.ndarray, " n"] | None = None,
        num_threads: int | None = None,
    ) -> None:
        """Start with what was covered before: the distance of each sample of the true surface to the nearest depth
        point of the runs that this one goes on from [m]; None for a run that began with nothing. There are no rows
        where nobody knows the truth. The rows do not depend on the number of threads, None = as many as usual.
        """
        self.rows: list[CurveRow] = []
        self._coverage = None if truth is None else Coverage(truth.samples, truth.observable, before_m, num_threads)
        self.before: Completion | None = self._coverage and (None if before_m is None else self._coverage.completion())
        """What was covered before the first frame; None for a run that began with nothing."""
        self._step: int | None = None
        self._pose: Pose2 | None = None
        self._believed: Pose2 | None = None
        self.path_m = 0.0
        """Driven distance: the sum of the distances between consecutive frames [m]."""

    @property
    def distance_m(self) -> Float[np.ndarray, " n"]:
        """Distance of every sample to the nearest depth point [m]; infinite from 1 m on."""
        return np.zeros(0) if self._coverage is None else self._coverage.distance_m

    def frame(
        self,
        step: int,
        depth_mm: UInt16[np.ndarray, "rows cols"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
        pose: Pose2,
        believed: Pose2 | None = None,
    ) -> CurveRow | None:
        """Add the frame after ``step`` actions, at a pose of the base; returns its row, if it has one.

        Depth, intrinsics and camera as of :meth:`~anm_mj.evaluation.completion.Coverage.add`. ``believed`` is where the
        robot thought that its base was; None where that was the same, or it did not know.
        """
        if self._coverage is not None:
            self._coverage.add(depth_mm, intrinsics, T_world_camera)
        if self._pose is not None:
            self.path_m += math.dist(self._pose.xy_m, pose.xy_m)
        self._step, self._pose, self._believed = step, pose, believed
        return self._row(step) if step % CHECKPOINT_STEPS == 0 else None

    def last(self) -> CurveRow | None:
        """Add a row for the last frame; None if it has one already, or there is no frame."""
        if self._step is None or (self.rows and self.rows[-1].step == self._step):
            return None
        return self._row(self._step)

    def _row(self, step: int) -> CurveRow | None:
        if self._coverage is None:
            return None
        now = self._coverage.completion()
        row = CurveRow(
            step, now.ratio_percent, now.completion_cm, now.observable_ratio_percent, self.path_m, *self._pose_error()
        )
        self.rows.append(row)
        return row

    def _pose_error(self) -> tuple[float | None, float | None]:
        """Error of the last frame's believed pose [cm, deg]; None where there is none."""
        true, believed = self._pose, self._believed
        if true is None or believed is None or believed == true:
            return None, None
        turned = abs(wrap_angle(believed.yaw_rad - true.yaw_rad))
        return 100.0 * math.dist(believed.xy_m, true.xy_m), math.degrees(turned)
