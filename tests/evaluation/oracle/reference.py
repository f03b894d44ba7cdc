"""What the native functions of the tour search compute, in NumPy."""

import numpy as np

from anm_mj.evaluation.oracle.discretize import direction, discretize, shorter_side, turn
from anm_mj.evaluation.oracle.segments import NO_YAW
from anm_mj.evaluation.oracle.tour_annealing import TourCoverage
from anm_mj.evaluation.oracle.visibility import count
from anm_mj.types import FORWARD_STEP_M


def tour_coverage(segments, task, stops):
    place, yaw = task.place, task.yaw
    numbers = [segments.turn(place, yaw, yaw, 1)]
    num_stops = 0
    for to, towards, side in stops:
        if segments.steps[numbers].sum() >= task.measure.budget:
            break
        num_stops += 1
        if to != place:
            path, first, last = segments.path(place, to)
            if first != NO_YAW:
                if first != yaw:
                    numbers.append(segments.turn(place, yaw, first, shorter_side(yaw, first)))
                numbers.append(path)
                yaw = last
            place = to
        if towards not in (NO_YAW, yaw):
            numbers.append(segments.turn(place, yaw, towards, side))
            yaw = towards
    covers = segments.covers[numbers]
    covers[0] |= task.seen
    covers = np.bitwise_or.accumulate(covers, axis=0)
    return TourCoverage(np.cumsum(segments.steps[numbers]), count(covers), covers[-1], num_stops)


def frames(path, start_m, yaw, yaw_rad):
    """Place [m] and heading after every action of a path, from a start place and heading; heading 0 is ``yaw_rad``."""
    xy_m, yaws = [], []
    at = start_m
    for towards, moves in zip(path.yaws, path.moves, strict=True):
        turns = turn(yaw, towards, shorter_side(yaw, towards))
        yaws += [*turns, *[towards] * moves]
        yaw = towards
        # The robot stands still while it turns: moves 0, 0, ..., 1, 2, ...
        moved = np.concatenate([np.zeros(len(turns)), np.arange(1, moves + 1)])
        xy_m.append(at + moved[:, None] * (FORWARD_STEP_M * direction(yaw, yaw_rad)))
        at = xy_m[-1][-1] if len(moved) else at
    return np.concatenate([np.zeros((0, 2)), *xy_m]), yaws


def roadmap_path(roadmap, bits, yaw_rad, a, b):
    """Steps, first and last yaw, and what the frames of the path from one place to another cover."""
    start_m = roadmap.places_m[a]
    path = discretize(start_m, None, roadmap.path_m(a, b), roadmap, yaw_rad)
    if not path.yaws:
        return 0, NO_YAW, NO_YAW, np.zeros(bits.shape[2], np.uint64)
    xy_m, yaws = frames(path, start_m, path.yaws[0], yaw_rad)
    covers = np.bitwise_or.reduce(bits[roadmap.nearest(xy_m), yaws], axis=0)
    return len(yaws), path.yaws[0], path.yaws[-1], covers
