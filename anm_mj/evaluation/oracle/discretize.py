"""From a line on the floor to whole actions: which turns and moves follow it with the fewest steps.

A robot that turns by 10 degrees can go in 36 directions. Between two corners it goes so far in the direction on one
side of the line and the rest in the direction on the other side, which costs one turn; steering for the line all the
time would cost one every half metre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from anm_mj.evaluation.oracle.roadmap import Ways
from anm_mj.evaluation.pixel_rays import NUM_YAWS
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

OFF_LINE_M = 0.08
"""A corner need not be met nearer than this [m]."""
MIN_ROOM_M = 0.06
"""Frames stand at least so far from the edge of the floor [m], where there is any way to do so; the floor is good to a
cell, and a move that touches something is refused."""
TIGHT_STEPS = 400.0
"""What a metre less of room than that costs [steps]."""


@dataclass(frozen=True)
class Walk:
    """Straight pieces one after the other: turn to a direction, then move."""

    yaws: tuple[int, ...]
    """Number of the direction of each piece."""
    moves: tuple[int, ...]
    """Moves of each piece."""
    end_m: Float[np.ndarray, "2"]
    """Where it ends [m]."""

    def frames(
        self, start_m: Float[np.ndarray, "2"], yaw: int, yaw_rad: float
    ) -> tuple[Float[np.ndarray, "n 2"], list[int]]:
        """Place [m] and yaw of the frame after every action, from a place and a yaw on."""
        xy_m, yaws = list[Float[np.ndarray, "k 2"]](), list[int]()
        at = start_m
        for towards, moves in zip(self.yaws, self.moves, strict=True):
            turns = turned(yaw, towards, shorter(yaw, towards))
            yaws += [*turns, *[towards] * moves]
            yaw = towards
            # While it turns it stands still: moves 0, 0, ..., 1, 2, ...
            moved = np.concatenate([np.zeros(len(turns)), np.arange(1, moves + 1)])
            xy_m.append(at + moved[:, None] * (FORWARD_STEP_M * heading(yaw, yaw_rad)))
            at = xy_m[-1][-1] if len(moved) else at
        return np.concatenate([np.zeros((0, 2)), *xy_m]), yaws


def heading(yaw: int, yaw_rad: float) -> Float[np.ndarray, "2"]:
    """Unit vector of a numbered direction, yaw number 0 being ``yaw_rad``."""
    angle = yaw_rad + yaw * TURN_STEP_RAD
    return np.array([math.cos(angle), math.sin(angle)])


def shorter(a: int, b: int) -> int:
    """The side to which the turn from one yaw to another is shorter: 1 to the left, -1 to the right."""
    return 1 if (b - a) % NUM_YAWS <= NUM_YAWS // 2 else -1


def turned(a: int, b: int, side: int) -> list[int]:
    """The yaws after each turn from one to another."""
    return [(a + side * k) % NUM_YAWS for k in range(1, (side * (b - a)) % NUM_YAWS + 1)]


def walk(
    start_m: Float[np.ndarray, "2"], yaw: int | None, corners_m: Float[np.ndarray, "k 2"], ways: Ways, yaw_rad: float
) -> Walk:
    """The actions that lead along corners.

    Args:
        start_m: Where the robot stands [m].
        yaw: How it stands there; None where that makes no difference.
        corners_m: Where it is to go [m]; the way to each from the one before is open.
        ways: The floor.
        yaw_rad: Of yaw number 0.
    """
    yaws, moves = list[int](), list[int]()
    at = start_m
    for corner in corners_m:
        best: tuple[float, list[tuple[int, int]]] | None = None
        for pieces in _pieces(corner - at, yaw_rad):
            ends, rooms, before = at, math.inf, yaw
            turns = 0
            for towards, count in pieces:
                step_m = FORWARD_STEP_M * heading(towards, yaw_rad)
                rooms = min(rooms, ways.least_room_m(ends, step_m, count))
                ends = ends + count * step_m
                turns += count + (0 if before is None else (shorter(before, towards) * (towards - before)) % NUM_YAWS)
                before = towards
            score = turns + TIGHT_STEPS * max(MIN_ROOM_M - rooms, 0.0)
            if best is None or score < best[0]:
                best = score, pieces
        for towards, count in best[1] if best else []:
            if yaws and yaws[-1] == towards:
                moves[-1] += count
            else:
                yaws.append(towards)
                moves.append(count)
            at = at + count * FORWARD_STEP_M * heading(towards, yaw_rad)
            yaw = towards
    return Walk(tuple(yaws), tuple(moves), at)


def _pieces(delta_m: Float[np.ndarray, "2"], yaw_rad: float) -> list[list[tuple[int, int]]]:
    """Ways of going a straight line in the directions next to it: direction and moves of each piece."""
    length_m = float(np.hypot(*delta_m))
    if length_m < OFF_LINE_M:
        return []
    towards = (math.atan2(delta_m[1], delta_m[0]) - yaw_rad) / TURN_STEP_RAD
    low = math.floor(towards)
    above = (towards - low) * TURN_STEP_RAD
    below = TURN_STEP_RAD - above
    a, b = low % NUM_YAWS, (low + 1) % NUM_YAWS
    found = []
    for angle, direction in ((above, a), (below, b)):
        if length_m * math.sin(angle) <= OFF_LINE_M:
            found.append([(direction, max(1, round(length_m * math.cos(angle) / FORWARD_STEP_M)))])
    if not found:
        along_a = round(length_m * math.sin(below) / math.sin(TURN_STEP_RAD) / FORWARD_STEP_M)
        along_b = round(length_m * math.sin(above) / math.sin(TURN_STEP_RAD) / FORWARD_STEP_M)
        pieces = [(a, along_a), (b, along_b)]
        pieces = [piece for piece in pieces if piece[1] > 0]
        found += [pieces, pieces[::-1]]
    return found
