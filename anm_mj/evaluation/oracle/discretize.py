"""Paths as whole actions: the turns and moves that follow a polyline with the fewest steps.

A robot that turns by 10 degrees has 36 headings. Between two corners it drives along the heading on one side of the
line, then along the one on the other side, which costs one turn; steering for the line would cost one turn every half
metre.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.evaluation.oracle.roadmap import Roadmap
from anm_mj.geometry.polyline import NUM_HEADINGS, heading_legs
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

TOLERANCE_M = 0.08
"""Corners are met to this distance [m]."""
CLEARANCE_M = 0.06
"""Clearance that paths keep where they can [m]. The map is good to a cell, and the simulator refuses a move that
touches something."""
CLEARANCE_COST_STEPS = 400.0
"""Cost of a metre less clearance than that [steps]."""


@dataclass(frozen=True)
class DiscretePath:
    """Straight legs in a row: turn to a heading, then make so many moves; the last one ends at ``end_m``."""

    yaws: tuple[int, ...]
    moves: tuple[int, ...]
    end_m: Float[np.ndarray, "2"]


def direction(yaw: int, yaw_rad: float) -> Float[np.ndarray, "2"]:
    """Unit vector of a heading; heading 0 is ``yaw_rad``."""
    angle = yaw_rad + yaw * TURN_STEP_RAD
    return np.array([math.cos(angle), math.sin(angle)])


def shorter_side(a: int, b: int) -> int:
    """The side of the shorter turn from one heading to another: 1 to the left, -1 to the right."""
    return 1 if (b - a) % NUM_HEADINGS <= NUM_HEADINGS // 2 else -1


def turn(a: int, b: int, side: int) -> list[int]:
    """The headings after each action of a turn from one heading to another."""
    return [(a + side * k) % NUM_HEADINGS for k in range(1, (side * (b - a)) % NUM_HEADINGS + 1)]


def discretize(
    start_m: Float[np.ndarray, "2"],
    yaw: int | None,
    corners_m: Float[np.ndarray, "k 2"],
    roadmap: Roadmap,
    yaw_rad: float,
) -> DiscretePath:
    """The actions that lead along corners. The segment to each corner from the one before is clear. Heading 0 is
    ``yaw_rad``; ``yaw`` None = the start heading makes no difference.
    """
    yaws, moves = list[int](), list[int]()
    at = start_m
    for corner in corners_m:
        best: tuple[float, list[tuple[int, int]]] | None = None
        for legs in _candidate_legs(corner - at, yaw_rad):
            end, clearance_m, before = at, math.inf, yaw
            steps = 0
            for towards, count in legs:
                step_m = FORWARD_STEP_M * direction(towards, yaw_rad)
                clearance_m = min(clearance_m, roadmap.least_clearance_m(end, step_m, count))
                end = end + count * step_m
                if before is not None:
                    steps += (shorter_side(before, towards) * (towards - before)) % NUM_HEADINGS
                steps += count
                before = towards
            cost = steps + CLEARANCE_COST_STEPS * max(CLEARANCE_M - clearance_m, 0.0)
            if best is None or cost < best[0]:
                best = cost, legs
        for towards, count in best[1] if best else []:
            if yaws and yaws[-1] == towards:
                moves[-1] += count
            else:
                yaws.append(towards)
                moves.append(count)
            at = at + count * FORWARD_STEP_M * direction(towards, yaw_rad)
            yaw = towards
    return DiscretePath(tuple(yaws), tuple(moves), at)


def _candidate_legs(delta_m: Float[np.ndarray, "2"], yaw_rad: float) -> list[list[tuple[int, int]]]:
    """Candidates for following a straight line: heading and moves of each leg."""
    length_m = float(np.hypot(*delta_m))
    if length_m < TOLERANCE_M:
        return []
    headings, angles, lengths_m = heading_legs(delta_m, yaw_rad)
    a, b = (heading % NUM_HEADINGS for heading in headings)
    found = []
    for angle, heading in zip(angles, (a, b), strict=True):
        if length_m * math.sin(abs(angle)) <= TOLERANCE_M:
            found.append([(heading, max(1, round(length_m * math.cos(angle) / FORWARD_STEP_M)))])
    if not found:
        legs = [(a, round(lengths_m[0] / FORWARD_STEP_M)), (b, round(lengths_m[1] / FORWARD_STEP_M))]
        legs = [leg for leg in legs if leg[1] > 0]
        found += [legs, legs[::-1]]
    return found
