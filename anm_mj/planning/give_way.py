"""What the robot has to wait for before its next forward step."""

import math
from collections.abc import Sequence

from anm_mj.sensing.moving_things import MovingThing
from anm_mj.types import FORWARD_STEP_M, Footprint, Pose2

KEPT_M, KEPT_STANDING_M = 0.2, 0.07
"""The robot stays so far from what moves, and from what has moved and stands [m]."""
_LOOK_AHEAD_S = (0.0, 0.5, 1.0)
_STEPS_AHEAD = 2
"""Forward steps that must be clear: a person steps as far meanwhile."""


def in_the_way(things: Sequence[MovingThing], footprint: Footprint, pose: Pose2, time_s: float) -> MovingThing | None:
    """What forward steps from a pose lead nearer to, now or within a second, than they may; None for nothing."""
    reach_m = _STEPS_AHEAD * FORWARD_STEP_M
    heading = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    for thing in things:
        kept_m = (KEPT_STANDING_M if thing.stands else KEPT_M) + thing.spread_m(time_s)
        least_m = footprint.radius_m + thing.radius_m + kept_m
        for ahead_s in _LOOK_AHEAD_S:
            x_m, y_m = thing.after(time_s + ahead_s)
            dx, dy = x_m - pose.x_m, y_m - pose.y_m
            along_m = dx * heading[0] + dy * heading[1]
            # A step leads away from what is beside or behind.
            if along_m <= 0.0:
                continue
            aside_m = abs(dy * heading[0] - dx * heading[1])
            if math.hypot(max(along_m - reach_m, 0.0), aside_m) < least_m:
                return thing
    return None


def held_disc(thing: MovingThing, footprint: Footprint, pose: Pose2, time_s: float) -> tuple[float, float, float]:
    """The disc, by x, y and radius [m], that paths around a thing keep off; the robot is not in it."""
    x_m, y_m = thing.after(time_s)
    room_m = math.dist((x_m, y_m), pose.xy_m) - footprint.radius_m
    return x_m, y_m, max(0.0, min(thing.radius_m + KEPT_STANDING_M, room_m - KEPT_STANDING_M))
