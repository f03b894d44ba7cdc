"""Search for a short tour that sees most of a known scene.

Set cover, the order of views and the paths between them are one problem, because a tour sees most of what it sees on
its way: a camera that passes a door shows the room behind it. So the cost of a tour depends on nothing but its coverage
curve: the samples covered by the frames after each of its actions, in order. It is the area above the curve within a
budget, or its distance from full coverage at the end, in steps: a sample that stays uncovered for the whole budget
costs the budget divided by the number of samples.

A tour is a list of stops. A stop is a place and, if need be, a yaw to turn to there and the side to turn by. Simulated
annealing (Kirkpatrick, Gelatt and Vecchi, Optimization by Simulated Annealing, Science 220, 1983) adds, removes, moves
and turns stops, and moves and reverses stretches of the tour (the Or-opt and 2-opt moves of the travelling salesman).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt64

from anm_mj import _native
from anm_mj.evaluation.oracle.discretize import shorter_side
from anm_mj.evaluation.oracle.roadmap import Roadmap
from anm_mj.evaluation.oracle.segments import NO_YAW, Segments
from anm_mj.evaluation.oracle.visibility import WORD, count, unpack
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.types import FORWARD_STEP_M

Stop = tuple[int, int, int]
"""Place, yaw (``NO_YAW`` for none), and the side to turn to it by."""

MEASURES = ("auc", "end")
"""What a tour is for: the area under its coverage curve, or its coverage at the end of the budget."""
EARLY_WEIGHT = 0.05
"""Weight of the area beside the end: of two tours with the same end the earlier one is better to begin from."""
HOT_STEPS = 10.0
"""Temperature at the start [steps]: a change that costs so much more is taken one time in e."""
WARM_STEPS = 4.0
"""Temperature at the start of a search that goes on from the best of several [steps]."""
COLD_STEPS = 0.4
"""Temperature at the end [steps]."""
NEAR_M = 1.0
"""Farthest that one change moves a stop [m]."""
LONGEST_PART = 12
"""Most stops moved or reversed together."""
NUM_DRAWN = 12
"""Places drawn for a new stop; the one nearest to the tour is taken."""
MAX_SEGMENTS = 120_000
"""Most segments in memory."""
MAX_STOPS = 300


@dataclass(frozen=True)
class Measure:
    """What is to be made small: what of ``num_samples`` is not covered within ``budget`` steps."""

    name: str
    """One of ``MEASURES``."""
    budget: int
    num_samples: int

    def cost(self, steps: Int[np.ndarray, " k"], covered: Int[np.ndarray, " k"]) -> float:
        """Mean share of uncovered samples times the budget [steps]: over the budget, or at its end.

        Args:
            steps: Steps after each segment of a tour; the first is 0 or more.
            covered: Samples covered by then. Within a segment they grow evenly, after the last one no more.
        """
        at = np.concatenate([steps[steps < self.budget], [self.budget]]).astype(float)
        share = np.interp(at, steps, covered) / self.num_samples
        # Before the first frame after the start nothing is known to be covered later than it.
        area = float(np.trapezoid(1.0 - share, at)) + float(at[0]) * (1.0 - float(share[0]))
        if self.name == "auc":
            return area
        return self.budget * (1.0 - float(share[-1])) + EARLY_WEIGHT * area


@dataclass(frozen=True)
class Task:
    """Start and goal of a tour: ``seen`` are covered already, ``samples`` is how many the first, greedy tour covers
    with them.
    """

    place: int
    yaw: int
    seen: UInt64[np.ndarray, " words"]
    samples: int
    measure: Measure


class TourCoverage(NamedTuple):
    """What a tour covers: steps and samples after each segment, and the samples at the end as bits."""

    steps: Int[np.ndarray, " k"]
    samples: Int[np.ndarray, " k"]
    final: UInt64[np.ndarray, " words"]
    num_stops: int
    """Stops that begin within the budget; the others count for nothing."""


class TourAnnealer:
    """Makes tours better."""

    def __init__(self, segments: Segments, roadmap: Roadmap, task: Task, seed: int) -> None:
        self._segments = segments
        self._roadmap = roadmap
        self._task = task
        self._rng = np.random.default_rng(seed)
        self._num_places = len(roadmap.places_m)
        self._near = roadmap.near(NEAR_M)
        self._frames_of: dict[int, list[int]] = {}

    def cost(self, stops: list[Stop]) -> float:
        """What the tour misses of its measure [steps]."""
        return self._cost(self.coverage(stops))

    def _cost(self, coverage: TourCoverage) -> float:
        return self._task.measure.cost(coverage.steps, coverage.samples)

    def coverage(self, stops: list[Stop]) -> TourCoverage:
        """What a tour covers within the budget, segment by segment (``native/tour.h``)."""
        segments, task = self._segments, self._task
        flat = np.array(stops, np.int64).reshape(-1, 3)
        start = np.array([task.place, task.yaw])
        numbers, covered = np.empty((2, 3 * len(stops) + 1), np.int64)
        wanted, final = np.empty(4, np.int64), task.seen.copy()
        while True:
            made = segments.turns, segments.paths, segments.yaws, segments.steps, segments.covers
            count, num_stops = _native.tour_coverage(
                flat, start, task.measure.budget, *made, final, numbers, covered, wanted
            )
            if count >= 0:
                return TourCoverage(np.cumsum(segments.steps[numbers[:count]]), covered[:count], final, num_stops)
            place, a, b, side = wanted.tolist()
            if side:
                segments.turn(place, a, b, side)
            else:
                segments.path(place, b)

    def anneal(self, stops: list[Stop], rounds: int, hot_steps: float = HOT_STEPS) -> list[Stop]:
        """Anneal a tour and return the best one met. ``hot_steps`` is the temperature at the start [steps]."""
        coverage = self.coverage(stops)
        present, now, cover = list(stops), self._cost(coverage), coverage.final
        best, least = present, now
        for k in range(rounds):
            if len(self._segments) > MAX_SEGMENTS:
                self._segments.clear()
            tried = self._changed(present, cover)
            coverage = self.coverage(tried)
            cost = self._cost(coverage)
            temperature = hot_steps * (COLD_STEPS / hot_steps) ** (k / rounds)
            if cost <= now or self._rng.random() < math.exp((now - cost) / temperature):
                # Stops beyond the budget cost nothing, so that they would gather until most changes are of them.
                present, now, cover = tried[: coverage.num_stops], cost, coverage.final
                if now < least - 1e-9:
                    best, least = present, now
        return best

    def _changed(self, stops: list[Stop], cover: UInt64[np.ndarray, " words"]) -> list[Stop]:
        """A tour with one change, at random."""
        draw, n = self._rng.random(), len(stops)
        if n < 2 or (draw < 0.28 and n < MAX_STOPS):
            return self._with_one_more(stops, cover)
        i = self._below(n)
        place, yaw, side = stops[i]
        if draw < 0.45:
            return stops[:i] + stops[i + 1 :]
        if draw < 0.62:
            near = self._near[place]
            return [*stops[:i], (near[self._below(len(near))], yaw, side), *stops[i + 1 :]]
        if draw < 0.82:
            return [*stops[:i], self._turned(stops[i]), *stops[i + 1 :]]
        length = 1 + self._below(min(n - 1, LONGEST_PART))
        i = self._below(n - length + 1)
        part, rest = stops[i : i + length], stops[:i] + stops[i + length :]
        if draw < 0.90:
            return stops[:i] + part[::-1] + stops[i + length :]
        j = self._below(n - length + 1) if draw < 0.95 else self._cheapest(rest, [part[0][0]], [part[-1][0]])[1]
        return rest[:j] + part + rest[j:]

    def _below(self, n: int) -> int:
        return int(self._rng.random() * n)

    def _side(self) -> int:
        return 1 if self._rng.random() < 0.5 else -1

    def _turned(self, stop: Stop) -> Stop:
        place, yaw, side = stop
        draw = self._rng.random()
        if yaw == NO_YAW or draw < 0.15:
            return place, self._below(NUM_HEADINGS), self._side()
        if draw < 0.3:
            return place, NO_YAW, side
        if draw < 0.4:
            return place, yaw, -side
        return place, (yaw + self._side() * (1 + self._below(4))) % NUM_HEADINGS, side

    def _with_one_more(self, stops: list[Stop], cover: UInt64[np.ndarray, " words"]) -> list[Stop]:
        """A tour with one more stop: near another, anywhere, or where something is seen that is still missing."""
        draw = self._rng.random()
        yaw = NO_YAW if self._rng.random() < 0.25 else self._below(NUM_HEADINGS)
        if stops and draw < 0.4:
            i = self._below(len(stops))
            near = self._near[stops[i][0]]
            place, j = near[self._below(len(near))], i + self._below(2)
        else:
            frames = self._frames_that_see(self._missing(cover)) if draw > 0.6 else []
            if frames:
                chosen = [divmod(frames[self._below(len(frames))], NUM_HEADINGS) for _ in range(NUM_DRAWN)]
            else:
                chosen = [(self._below(self._num_places), yaw) for _ in range(NUM_DRAWN)]
            k, j = self._cheapest(stops, [place for place, _ in chosen])
            place, yaw = chosen[k]
        return [*stops[:j], (place, yaw, self._side()), *stops[j:]]

    def _missing(self, cover: UInt64[np.ndarray, " words"]) -> int:
        """A sample that is not covered."""
        word = self._below(len(cover))
        missing = np.flatnonzero(~unpack(np.roll(cover, -word)))
        return (int(missing[0]) + word * WORD) % (len(cover) * WORD) if len(missing) else 0

    def _frames_that_see(self, sample: int) -> list[int]:
        """Places and yaws that cover a sample, as place times ``NUM_HEADINGS`` plus yaw."""
        if sample not in self._frames_of:
            shown = self._segments.bits[:, :, sample // WORD] >> np.uint64(sample % WORD) & np.uint64(1)
            self._frames_of[sample] = np.flatnonzero(shown).tolist()
        return self._frames_of[sample]

    def _cheapest(self, stops: list[Stop], first: list[int], last: list[int] | None = None) -> tuple[int, int]:
        """Which of several parts lengthens the way of a tour least, and where. ``first`` and ``last`` are the places
        where each begins and ends; None = where it begins.
        """
        places = np.array([self._task.place, *(stop[0] for stop in stops)])
        far_m = self._roadmap.distance_m
        extra_m = far_m[places[:, None], np.array(first)]
        onward_m = far_m[places[1:, None], np.array(first if last is None else last)]
        extra_m[:-1] += onward_m - far_m[places[:-1], places[1:]][:, None]
        j, k = divmod(int(np.argmin(extra_m)), len(first))
        return k, j


def greedy_tour(segments: Segments, roadmap: Roadmap, task: Task, yaw_rad: float) -> list[Stop]:
    """A tour to the task's samples that always goes on to the view with the most new samples per step.

    That is where a search begins; it finds the rest better by itself.
    """
    place, yaw, seen, stops = task.place, task.yaw, task.seen.copy(), list[Stop]()
    half = NUM_HEADINGS // 2
    while int(count(seen)) < task.samples and len(stops) < MAX_STOPS:
        gains = count(segments.bits & ~seen)
        delta = roadmap.places_m - roadmap.places_m[place]
        towards = np.rint((np.arctan2(delta[:, 1], delta[:, 0]) - yaw_rad) * (NUM_HEADINGS / math.tau))
        towards[place] = yaw
        before = np.abs((towards - yaw + half) % NUM_HEADINGS - half)
        after = np.abs((np.arange(NUM_HEADINGS)[None] - towards[:, None] + half) % NUM_HEADINGS - half)
        steps = roadmap.distance_m[place][:, None] / FORWARD_STEP_M + before[:, None] + after + 1.0
        to, towards_yaw = (int(k) for k in np.unravel_index(int(np.argmax(gains / steps)), gains.shape))
        if gains[to, towards_yaw] == 0:
            break
        if to != place:
            piece, first, last = segments.path(place, to)
            seen |= segments.covers[piece]
            yaw = last if first != NO_YAW else yaw
        side = shorter_side(yaw, towards_yaw)
        seen |= segments.covers[segments.turn(to, yaw, towards_yaw, side)]
        seen |= segments.bits[to, towards_yaw]
        stops.append((to, towards_yaw, side))
        place, yaw = to, towards_yaw
    return stops
