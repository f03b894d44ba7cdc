"""What the native functions of the tour search compute, in NumPy."""

import numpy as np

from anm_mj.evaluation.oracle.discretize import discretize, shorter_side
from anm_mj.evaluation.oracle.segments import NO_YAW
from anm_mj.evaluation.oracle.tour_annealing import TourCoverage
from anm_mj.evaluation.oracle.visibility import count


def tour_coverage(segments, task, budget, stops):
    place, yaw = task.place, task.yaw
    numbers = [segments.turn(place, yaw, yaw, 1)]
    num_stops = 0
    for to, towards, side in stops:
        if segments.steps[numbers].sum() >= budget:
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


def roadmap_path(roadmap, bits, yaw_rad, a, b):
    """Steps, first and last yaw, and what the frames of the path from one place to another cover."""
    start_m = roadmap.places_m[a]
    path = discretize(start_m, None, roadmap.path_m(a, b), roadmap, yaw_rad)
    if not path.yaws:
        return 0, NO_YAW, NO_YAW, np.zeros(bits.shape[2], np.uint64)
    xy_m, yaws = path.frames(start_m, path.yaws[0], yaw_rad)
    covers = np.bitwise_or.reduce(bits[roadmap.nearest(xy_m), yaws], axis=0)
    return len(yaws), path.yaws[0], path.yaws[-1], covers
