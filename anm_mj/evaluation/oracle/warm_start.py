"""Tours along the poses of finished runs, from which the search of the oracle also begins.

A run that looked well becomes a tour that the search improves, so that the oracle profits from whatever a policy found.
"""

import itertools
import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from anm_mj.errors import PlanError, RunFolderError
from anm_mj.evaluation.oracle.discretize import shorter_side
from anm_mj.evaluation.oracle.segments import NO_YAW
from anm_mj.evaluation.oracle.tour_annealing import MAX_STOPS, Stop
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.run_shapes import StepShape
from anm_mj.types import Pose2
from anm_mj.utils.read_file import convert

LEAST_TURNS = 3
"""Fewer turns in a row only follow a path."""
MOVED_M = 1e-3
"""A robot that moved less than this only turned [m]."""
WAYPOINT_M = 1.0
"""Distance between two stops that only keep a tour on its way [m]."""


def read_trajectories(folders: str) -> list[list[Pose2]]:
    """The poses after every step of finished runs. ``folders`` are separated as the system separates paths. Raises
    PlanError if a folder holds no log of steps, or a damaged one.
    """
    found = []
    for folder in filter(None, folders.split(os.pathsep)):
        try:
            lines = [convert(line, StepShape) for line in read_jsonl(Path(folder) / "steps.jsonl")]
        except (RunFolderError, ValueError) as err:
            raise PlanError(f"policy.warm_start: {folder} is no run to begin from ({err}); give run folders.") from err
        found.append([Pose2(line.x_m, line.y_m, line.yaw_rad) for line in lines])
    return found


def stops_along(
    poses: list[Pose2], place_at: Callable[[Pose2], int], yaw_at: Callable[[Pose2], int], budget: int
) -> list[Stop]:
    """The tour that follows a trajectory: its turns on the spot as they were, and the way between them. ``poses`` are
    those after each step, of which ``budget`` count.
    """
    poses = poses[:budget]
    stops, turned = list[Stop](), list[tuple[int, int]]()
    stopped_m = poses[0].xy_m if poses else np.zeros(2)
    for before, after in itertools.pairwise(poses):
        if math.dist(before.xy_m, after.xy_m) <= MOVED_M:
            if yaw_at(before) != yaw_at(after):
                turned.append((yaw_at(before), yaw_at(after)))
            continue
        looks = _looks(turned, place_at(before))
        turned.clear()
        if looks or math.dist(after.xy_m, stopped_m) >= WAYPOINT_M:
            stops += looks or [(place_at(after), NO_YAW, 1)]
            stopped_m = after.xy_m
    return [*stops, *(_looks(turned, place_at(poses[-1])) if poses else [])][:MAX_STOPS]


def _looks(turned: list[tuple[int, int]], place: int) -> list[Stop]:
    """Stops that turn at a place as a robot did, given the headings before and after each of its actions there."""
    if len(turned) < LEAST_TURNS:
        return []
    found = list[Stop]()
    for side, part in itertools.groupby(turned, key=lambda pair: shorter_side(*pair)):
        turns = list(part)
        # A stop says where a turn ends: half a rotation at a time.
        ends = [*range(NUM_HEADINGS // 2, len(turns), NUM_HEADINGS // 2), len(turns)]
        found += [(place, turns[end - 1][1], side) for end in ends]
    return found
