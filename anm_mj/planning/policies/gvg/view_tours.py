"""Beam search for a tour: a short sequence of views with the most gain, each part discounted by the steps until then.

The discount puts near gains first, and near ones on the way to more before other near ones. The transitions between
views (:mod:`anm_mj.planning.policies.gvg.transitions`) know what each adds to what the tour has covered already.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.policies.gvg.transitions import TURNS, TransitionTable
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS


@dataclass(frozen=True)
class TourView:
    """One view of a tour."""

    place: int
    """Index into the places of the table."""
    heading: int
    """Azimuth sector that the robot turns to there."""
    gain_m2: float
    """Expected new surface from the view before to this one, turns included [m2]."""
    at_step: float
    """Steps from the start of the tour."""


@dataclass(frozen=True)
class Tour:
    """A sequence of views."""

    views: tuple[TourView, ...]
    value: float
    """Discounted gain [m2]."""

    @property
    def gain_m2(self) -> float:
        """Expected new surface of the whole tour [m2]."""
        return sum(view.gain_m2 for view in self.views)

    @property
    def steps(self) -> float:
        """Steps of the whole tour."""
        return self.views[-1].at_step

    @property
    def rate(self) -> float:
        """Expected new surface per step [m2]."""
        return self.gain_m2 / max(self.steps, 1.0)


@dataclass(frozen=True)
class _Beam:
    """Tours of equal length that the search extends together."""

    tours: list[Tour]
    place: Int[np.ndarray, " b"]
    heading: Int[np.ndarray, " b"]
    steps: Float[np.ndarray, " b"]
    factor: Float[np.ndarray, "b k"]
    """Factor on the value of the next view at each place; once a tour has begun, that of its first place."""
    covered: Bool[np.ndarray, "b patches"]

    @property
    def value(self) -> Float[np.ndarray, " b"]:
        """Value of each tour."""
        return np.array([tour.value for tour in self.tours])


@dataclass(frozen=True)
class _Extensions:
    """The best next view at each place for each tour of a beam."""

    value: Float[np.ndarray, "b k"]
    """What the view adds to the value of the tour."""
    heading: Int[np.ndarray, "b k"]
    steps: Float[np.ndarray, "b k"]
    gain_m2: Float[np.ndarray, "b k"]


class TourSearch:
    """Searches tours over the transitions between some places."""

    def __init__(
        self, transitions: TransitionTable, *, discount_steps: float, preference: Float[np.ndarray, " k"]
    ) -> None:
        """Set the objective.

        Args:
            transitions: between the places.
            discount_steps: gain after this many steps counts 1/e.
            preference: factor on the value of tours that begin at each place (hysteresis).
        """
        self._transitions = transitions
        self._discount_steps = discount_steps
        self._preference = preference

    def best(self, heading: int, *, depth: int, width: int) -> list[Tour]:
        """The best tours of all lengths for a robot at the first place, best first.

        Args:
            heading: azimuth sector that the robot looks along now.
            depth: most views in a tour.
            width: tours kept at each depth.
        """
        covered = np.zeros((1, self._transitions.num_patches), bool)
        beam = _Beam([Tour((), 0.0)], np.array([0]), np.array([heading]), np.zeros(1), self._preference[None], covered)
        found: list[Tour] = []
        for _ in range(depth):
            following = self._expand(beam)
            tour, place = np.nonzero(following.value > 0.0)
            added = following.value[tour, place]
            best = np.lexsort((-added, tour, -(beam.value[tour] + added)))[:width]
            if not len(best):
                break
            beam = self._extend(beam, following, tour[best], place[best])
            found += beam.tours
        return sorted(found, key=lambda tour: -tour.value)

    def _expand(self, beam: _Beam) -> _Extensions:
        """The best next views."""
        each = np.arange(len(beam.tours))[:, None]
        after = self._transitions.expand(beam.place, beam.heading, beam.covered)
        value = after.gain_m2 * np.exp(-(beam.steps[:, None, None] + after.steps) / self._discount_steps)
        value[after.steps < 0.5] = 0.0
        value *= beam.factor[:, :, None]
        turn = value.argmax(axis=2)
        best = each, np.arange(self._transitions.num_places), turn
        heading = (after.arrival + TURNS[turn]) % NUM_AZIMUTHS
        return _Extensions(value[best], heading, after.steps[best], after.gain_m2[best])

    def _extend(
        self, beam: _Beam, following: _Extensions, tour: Int[np.ndarray, " c"], place: Int[np.ndarray, " c"]
    ) -> _Beam:
        """Some tours of a beam, each with its next view at a place."""
        chosen = tour, place
        heading, gain = following.heading[chosen], following.gain_m2[chosen]
        steps, factor = beam.steps[tour] + following.steps[chosen], beam.factor[chosen]
        covered = beam.covered[tour]
        self._transitions.cover(covered, (beam.place[tour], beam.heading[tour]), (place, heading))
        tours = [
            Tour(
                (*beam.tours[t].views, TourView(int(p), int(h), float(g), float(s))),
                beam.tours[t].value + float(g) * math.exp(-s / self._discount_steps) * float(f),
            )
            for t, p, h, g, s, f in zip(tour, place, heading, gain, steps, factor, strict=True)
        ]
        factors = np.repeat(factor[:, None], self._transitions.num_places, axis=1)
        return _Beam(tours, place, heading, steps, factors, covered)
