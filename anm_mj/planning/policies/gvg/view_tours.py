"""Beam search for a tour: a short sequence of views with the most gain, each part discounted by the steps until then.

The discount puts near gains first, and near ones on the way to more before other near ones. The transitions between
views (:mod:`anm_mj.planning.policies.gvg.transitions`) know what each adds to what the tour has covered already.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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


def best_tours(
    table: TransitionTable,
    heading: int,
    *,
    discount_steps: float,
    preference: Float[np.ndarray, " k"],
    depth: int,
    width: int,
) -> list[Tour]:
    """The best tours of all lengths for a robot at the first place, best first.

    Args:
        table: transitions between the places.
        heading: azimuth sector that the robot looks along now.
        discount_steps: gain after this many steps counts 1/e.
        preference: factor on the value of tours that begin at each place (hysteresis).
        depth: most views in a tour.
        width: tours kept at each depth.
    """
    # The beam: tours of equal length, and where each ends.
    tours, covered = [Tour((), 0.0)], np.zeros((1, table.num_patches), bool)
    place, headings, steps, factor = np.array([0]), np.array([heading]), np.zeros(1), preference[None]
    found: list[Tour] = []
    for _ in range(depth):
        arrival, further, gain_m2 = table.expand(place, headings, covered)
        value = gain_m2 * np.exp(-(steps[:, None, None] + further) / discount_steps)
        value[further < 0.5] = 0.0
        value *= factor[:, :, None]
        turn, added = value.argmax(axis=2), value.max(axis=2)
        tour, to = np.nonzero(added > 0.0)
        total = np.array([tour.value for tour in tours])[tour] + added[tour, to]
        best = np.lexsort((-added[tour, to], tour, -total))[:width]
        if not len(best):
            break
        tour, to = tour[best], to[best]
        view = tour, to, turn[tour, to]
        new_headings = (arrival[tour, to] + TURNS[view[2]]) % NUM_AZIMUTHS
        covered = covered[tour]
        table.cover(covered, (place[tour], headings[tour]), (to, new_headings))
        steps, first = steps[tour] + further[view], factor[tour, to]
        tours = [
            Tour(
                (*tours[t].views, TourView(int(p), int(h), float(g), float(s))),
                tours[t].value + float(g) * math.exp(-s / discount_steps) * float(f),
            )
            for t, p, h, g, s, f in zip(tour, to, new_headings, gain_m2[view], steps, first, strict=True)
        ]
        place, headings, factor = to, new_headings, np.repeat(first[:, None], table.num_places, axis=1)
        found += tours
    return sorted(found, key=lambda tour: -tour.value)
