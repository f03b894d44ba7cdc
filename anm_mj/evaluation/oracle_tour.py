"""A short tour through views that together cover what is wanted.

Set cover and tour are one: views are inserted one after the other where they cost the fewest steps for what they add
(cost-benefit greedy for submodular orienteering; Zhang and Vorobeychik, Submodular Optimization with Routing
Constraints, AAAI 2016), then the order is improved by 2-opt and Or-opt moves until none helps. A step is a step: a turn
of 10 degrees costs as much as a move of 6.5 cm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from anm_mj.evaluation.oracle_views import Views
from anm_mj.evaluation.pixel_rays import NUM_YAWS
from anm_mj.types import FORWARD_STEP_M, TURN_STEP_RAD

PASSING_M = 0.4
"""Spacing of the frames along a way that are counted while it is planned [m]."""
BESIDE_M = 0.5
"""A place nearer than this to a way stands for what is seen from there [m]."""
MAX_SEGMENT = 3
"""Most views moved together by an Or-opt move."""
MAX_MOVES = 400


@dataclass(frozen=True)
class View:
    """A place, by its index, and a yaw, by its number of turns."""

    place: int
    yaw: int


@dataclass(frozen=True)
class Start:
    """Where the robot stands."""

    xy_m: Float[np.ndarray, "2"]
    yaw_rad: float
    distances_m: Float[np.ndarray, " p"]
    """Way from there to each place [m]."""


def cover(
    views: Views,
    wanted: Bool[np.ndarray, " n"],
    enough: int,
    start: Start,
    places_m: Float[np.ndarray, "p 2"],
    distances_m: Callable[[int], Float[np.ndarray, " p"]],
) -> list[View]:
    """Views that cover at least so many wanted samples, in an order that is short already.

    What the camera shows on the way to a view, looking ahead, and while it turns there, counts too.

    Args:
        views: What there is to choose from.
        wanted: Samples that count.
        enough: How many of them; fewer where the views do not cover so many.
        start: Where the robot stands.
        places_m: The places of the views.
        distances_m: Way from a place to all places [m].
    """
    left = wanted & views.coverable
    goal = min(enough, int(left.sum()))
    counts, found, tour = views.counts(left), 0, list[View]()
    rows, stops_m, yaws = [start.distances_m], [start.xy_m], [start.yaw_rad]
    every = np.arange(len(places_m))
    while found < goal:
        extra_m = _extra_m(rows, [view.place for view in tour])
        at = np.argmin(extra_m, axis=0)
        before_m, yaw_before = np.stack(stops_m)[at], np.array(yaws)[at]
        heading = _bearing(before_m, places_m, yaw_before)
        arriving = np.rint(heading / TURN_STEP_RAD).astype(np.int64) % NUM_YAWS
        # The turn from the arrival to each yaw, and from there to where the tour goes on.
        turns = np.abs((np.arange(NUM_YAWS)[None] - arriving[:, None] + NUM_YAWS // 2) % NUM_YAWS - NUM_YAWS // 2)
        steps = extra_m[at, every] / FORWARD_STEP_M + _turns(heading - yaw_before) + 1.0
        if tour:
            after_m = np.stack([*stops_m[1:], stops_m[-1]])[at]
            onward = _bearing(places_m, after_m, heading)
            onward_turns = _turns(onward[:, None] - np.arange(NUM_YAWS)[None] * TURN_STEP_RAD)
            turns = turns + np.where(at < len(tour), 1.0, 0.0)[:, None] * onward_turns
        gains = views.arc_gains(counts, arriving)
        # What is more than enough is worth nothing.
        ratio = np.minimum(gains, goal - found) / (steps[:, None] + turns)
        place, yaw = (int(k) for k in np.unravel_index(int(np.argmax(ratio)), ratio.shape))
        covered = views.covered(place, int(arriving[place]), yaw)
        passed = _passed(before_m[place], places_m[place], places_m)
        covered = np.concatenate(
            [covered, *(views.covered(k, int(arriving[place]), int(arriving[place])) for k in passed)]
        )
        covered = np.unique(covered[left[covered]])
        if len(covered) == 0:
            break
        position = int(at[place])
        tour.insert(position, View(place, yaw))
        rows.insert(position + 1, distances_m(place))
        stops_m.insert(position + 1, places_m[place])
        yaws.insert(position + 1, yaw * TURN_STEP_RAD)
        counts = views.without(counts, covered)
        left[covered] = False
        found += len(covered)
    return tour


def _bearing(
    a_m: Float[np.ndarray, "p 2"], b_m: Float[np.ndarray, "p 2"], otherwise_rad: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """Direction from one place to another; a given one where they are the same."""
    delta = b_m - a_m
    apart = np.hypot(delta[:, 0], delta[:, 1]) > FORWARD_STEP_M
    return np.where(apart, np.arctan2(delta[:, 1], delta[:, 0]), otherwise_rad)


def _passed(a_m: Float[np.ndarray, "2"], b_m: Float[np.ndarray, "2"], places_m: Float[np.ndarray, "p 2"]) -> list[int]:
    """Places next to the straight line between two others, about one in a metre."""
    length_m = float(np.linalg.norm(b_m - a_m))
    found = []
    for share in np.arange(PASSING_M, length_m, PASSING_M) / max(length_m, 1e-9):
        squared = ((places_m - (a_m + share * (b_m - a_m))) ** 2).sum(axis=1)
        if squared.min() < BESIDE_M**2:
            found.append(int(np.argmin(squared)))
    return found


def _extra_m(rows: list[Float[np.ndarray, " p"]], places: list[int]) -> Float[np.ndarray, "k p"]:
    """How much longer the tour becomes by each place at each position [m]; the last position is the open end."""
    to = np.stack(rows)
    if not places:
        return to
    leg_m = to[np.arange(len(places)), places]
    return np.concatenate([to[:-1] + to[1:] - leg_m[:, None], to[-1:]])


def step_costs(
    tour: list[View],
    start: Start,
    places_m: Float[np.ndarray, "p 2"],
    distances_m: Callable[[int], Float[np.ndarray, " p"]],
) -> Float[np.ndarray, "k k"]:
    """Steps from each view to each other, the start being view 0: the way, and the turns before and after it.

    The directions of leaving and arriving are taken from the straight line.
    """
    place = [view.place for view in tour]
    yaw_rad = np.array([start.yaw_rad, *(view.yaw * TURN_STEP_RAD for view in tour)])
    xy_m = np.concatenate([start.xy_m[None], places_m[place]])
    way_m = np.zeros((len(tour) + 1, len(tour) + 1))
    way_m[0, 1:] = start.distances_m[place]
    for i, view in enumerate(tour, start=1):
        way_m[i, 1:] = distances_m(view.place)[place]
    way_m[1:, 0] = way_m[0, 1:]
    delta = xy_m[None] - xy_m[:, None]
    there = np.linalg.norm(delta, axis=2) < FORWARD_STEP_M
    heading = np.arctan2(delta[..., 1], delta[..., 0])
    turns = _turns(heading - yaw_rad[:, None]) + _turns(yaw_rad[None] - heading)
    return way_m / FORWARD_STEP_M + np.where(there, _turns(yaw_rad[None] - yaw_rad[:, None]), turns)


def _turns(angle_rad: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
    """Steps that turning by an angle takes."""
    return np.abs((angle_rad + np.pi) % (2.0 * np.pi) - np.pi) / TURN_STEP_RAD


def shorten(costs: Float[np.ndarray, "k k"]) -> list[int]:
    """A short order of all points that begins at the first and ends anywhere: 2-opt and Or-opt, best move first.

    Args:
        costs: Steps from each point to each other; may differ by direction.
    """
    order = list(range(len(costs)))
    length = tour_length(costs, order)
    for _ in range(MAX_MOVES):
        candidate = _best_move(costs, order)
        shorter = tour_length(costs, candidate)
        if shorter > length - 1e-9:
            break
        order, length = candidate, shorter
    return order


def tour_length(costs: Float[np.ndarray, "k k"], order: list[int]) -> float:
    """Steps of a tour in an order."""
    return float(costs[order[:-1], order[1:]].sum())


def _best_move(costs: Float[np.ndarray, "k k"], order: list[int]) -> list[int]:
    """The order after the move that saves most; the same order where none does."""
    t = np.array(order)
    n = len(t)
    if n < 3:
        return order
    # A last leg that costs nothing lets the open end take part in every move.
    c = np.zeros((n + 1, n + 1))
    c[:n, :n] = costs[np.ix_(t, t)]
    leg = c[np.arange(n), np.arange(1, n + 1)]
    forward = np.concatenate([[0.0], np.cumsum(leg)])
    backward = np.concatenate([[0.0], np.cumsum(c[np.arange(1, n + 1), np.arange(n)])])
    best, found = -1e-9, order
    i, j = np.triu_indices(n, k=1)
    i, j = i[i > 0], j[i > 0]
    if len(i):
        change = c[i - 1, j] + backward[j] - backward[i] + c[i, j + 1]
        change -= leg[i - 1] + forward[j] - forward[i] + leg[j]
        k = int(np.argmin(change))
        if change[k] < best:
            best, a, b = change[k], int(i[k]), int(j[k])
            found = [*order[:a], *order[a : b + 1][::-1], *order[b + 1 :]]
    for size in range(1, min(MAX_SEGMENT, n - 1) + 1):
        a = np.arange(1, n - size + 1)[:, None]
        after = np.arange(n)[None]
        taken = c[a - 1, a + size] - leg[a - 1] - leg[a + size - 1]
        put = c[after, a] + c[a + size - 1, after + 1] - leg[after]
        change = np.where((after >= a - 1) & (after < a + size), np.inf, taken + put)
        k, m = (int(x) for x in np.unravel_index(int(np.argmin(change)), change.shape))
        if change[k, m] < best:
            best, first = change[k, m], k + 1
            rest = [*order[:first], *order[first + size :]]
            at = rest.index(order[m]) + 1
            found = [*rest[:at], *order[first : first + size], *rest[at:]]
    return found
