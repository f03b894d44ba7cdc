"""A finished run, frame by frame: where the robot was, what it had decided, what it had covered, what moved."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.errors import RunFolderError
from anm_mj.io.curve_file import read_curve
from anm_mj.io.plan_file import read_plan
from anm_mj.io.read_run import Run, read_run, run_title
from anm_mj.io.run_records import FrameRecord
from anm_mj.people.crowd import CHAIR, VACUUM
from anm_mj.people.walking_floor import BODY
from anm_mj.types import DEFAULT_FOOTPRINT, Plan

_PERSON_HEIGHT_M = 1.7


def read_timeline(path: Path) -> "Timeline":
    """Open a run folder. Raises RunFolderError if the folder contains no run, or a file in it is damaged."""
    return Timeline(read_run(path))


def discs(frame: FrameRecord) -> Float[np.ndarray, "p 4"]:
    """x, y, radius and height [m]: people, then vacuum robots, then the chair; as many in every frame of a run."""
    found = [(*state[:2], BODY.radius_m, _PERSON_HEIGHT_M) for state in frame.people]
    found += [(*state[:2], VACUUM.radius_m, VACUUM.z_max_m) for state in frame.vacuums]
    if frame.chair is not None:
        found.append((*frame.chair[:2], CHAIR.radius_m, CHAIR.z_max_m))
    return np.array(found, float).reshape(-1, 4)


def leaves(frame: FrameRecord) -> Float[np.ndarray, "d 4"]:
    """Of each leaf of a door: x and y of the hinge [m], yaw [rad], length [m]."""
    return np.array(frame.doors, float).reshape(-1, 4)


def leaf_ends(states: Float[np.ndarray, "d 4"]) -> Float[np.ndarray, "d 2 2"]:
    """Hinge and free end of each leaf [m]."""
    along = np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2])])
    return np.stack([states[:, :2], states[:, :2] + states[:, 3:] * along], axis=1)


def is_any(frame: FrameRecord) -> bool:
    """Whether anything moves in the run of a frame."""
    return bool(len(discs(frame)) or len(frame.doors))


@dataclass(frozen=True)
class Timeline:
    """A run in the order of its frames; killed runs end at their last whole frame."""

    run: Run

    def __post_init__(self) -> None:
        """Raises RunFolderError for a run without a frame."""
        if not self.run.frames:
            raise RunFolderError(f"{self.run.folder.path} holds no frame yet; wait for the run's first step.")

    @property
    def num_frames(self) -> int:
        """Number of observations."""
        return len(self.run.frames)

    @property
    def title(self) -> str:
        """Scene, policy and seed."""
        return run_title(self.run.folder)

    @property
    def radius_m(self) -> float:
        """Of the drawn robot [m]."""
        return (self.run.footprint or DEFAULT_FOOTPRINT).radius_m

    @cached_property
    def steps(self) -> Int[np.ndarray, " n"]:
        """Actions before each frame."""
        return np.array([frame.step for frame in self.run.frames])

    @cached_property
    def xy_m(self) -> Float[np.ndarray, "n 2"]:
        """Place of the base at each frame, world [m], as the robot believed it."""
        return np.array([frame.pose.xy_m for frame in self.run.frames])

    @cached_property
    def true_xy_m(self) -> Float[np.ndarray, "n 2"] | None:
        """Where the base truly was at each frame, world [m]; None where the robot believed just that."""
        true = np.array([frame.true_pose.xy_m for frame in self.run.frames])
        return None if np.array_equal(true, self.xy_m) else true

    @cached_property
    def is_lost(self) -> Bool[np.ndarray, " n"]:
        """At which frames the robot did not know where it was."""
        return np.array([frame.is_lost for frame in self.run.frames])

    def ellipse_m(self, index: int) -> Float[np.ndarray, "3"] | None:
        """Half axes [m] and direction of the longer one [rad] of a frame's position within 2 standard deviations."""
        covariance = self.run.frames[index].covariance_xy_m2
        if covariance is None:
            return None
        xx, xy, yy = covariance
        values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        short, long = 2.0 * np.sqrt(np.maximum(values, 0.0))
        return np.array([long, short, math.atan2(vectors[1, 1], vectors[0, 1])])

    @cached_property
    def plan_of_frame(self) -> Int[np.ndarray, " n"]:
        """Index of the latest decision at each frame; -1 before the first."""
        decided = np.array([plan["step"] for plan in self.run.plans], dtype=np.int64)
        return np.searchsorted(decided, self.steps, side="right") - 1

    def plan(self, index: int) -> Plan:
        """What a decision was read from; only its target where the run kept no more. Raises RunFolderError if the file
        of the decision is damaged.
        """
        line = self.run.plans[index]
        path = self.run.folder.plan(line["step"])
        if path.is_file():
            return read_plan(path)
        target = line.get("target_xy_m")
        return Plan("") if target is None else Plan("", np.array([target], dtype=np.float64))

    @cached_property
    def coverage(self) -> tuple[str, Float[np.ndarray, " n"]]:
        """Name and values of the headline metric at each frame [%]; NaN where it was not measured.

        The completion ratio of the observable surface where that is known, else of the whole surface. Raises
        RunFolderError if ``curve.csv`` holds no curve.
        """
        curve = read_curve(self.run.folder.curve)
        for name, key in (("observable", "observable_ratio"), ("completion", "completion_ratio")):
            known = np.isfinite(curve[key])
            if known.any():
                return name, np.interp(self.steps, curve["step"][known], curve[key][known], left=np.nan)
        return "completion", np.full(self.num_frames, np.nan)


def known_pieces(timeline: Timeline, index: int) -> list[Float[np.ndarray, "k 2"]]:
    """The trajectory up to a frame without the frames at which the robot was lost: the pieces between them."""
    known = np.flatnonzero(~timeline.is_lost[: index + 1])
    return [timeline.xy_m[each] for each in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(each)]
