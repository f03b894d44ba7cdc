"""The numbers of a run, as they stand in ``metrics.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from anm_mj.evaluation.curve import CurveRow
from anm_mj.evaluation.mesh import MeshQuality
from anm_mj.types import Action


@dataclass(frozen=True)
class Ending:
    """What only the running program could know; all None where it was killed."""

    stop_reason: str | None = None
    wall_s: float | None = None
    """From the start of the program to the end of the loop [s]."""
    hz: float | None = None
    """Steps per second of the loop itself, without set-up and evaluation."""
    peak_rss_mib: float | None = None
    """Largest memory of the process until the end of the loop [MiB]."""


@dataclass(frozen=True)
class Metrics:
    """The numbers of a run."""

    completion_ratio: float | None
    """Share of the true surface within 5 cm of what was seen [%] (the paper's first number)."""
    completion_cm: float | None
    """Mean distance of the true surface to what was seen, capped at 1 m [cm] (the paper's second number)."""
    completion_uncapped_cm: float | None
    """The same without a cap [cm]; the paper does not say which of the two it prints."""
    observable_ratio: float | None
    """The ratio among what can be seen at all [%]; None where that is not known."""
    accuracy_cm: float | None
    """Mean distance of the reconstructed mesh to the true surface [cm]; None without a mesh, as are the next two."""
    mesh_completion_cm: float | None
    """Mean distance of the true surface to the reconstructed mesh [cm]."""
    mesh_completion_ratio: float | None
    """Share of the true surface within 5 cm of the reconstructed mesh [%]."""
    steps: int
    path_m: float
    """Distance driven [m]."""
    turns: int
    """Steps that turned on the spot."""
    collisions: int
    """Steps that met an obstacle."""
    stop_reason: str | None
    """Why the run ended; None where it was killed, as are the next three."""
    wall_s: float | None
    """Wall time of the run until the end of the loop [s]."""
    hz: float | None
    """Steps per second of the loop itself, without set-up and evaluation."""
    peak_rss_mib: float | None
    """Largest memory of the process until the end of the loop [MiB]."""


@dataclass(frozen=True)
class Travel:
    """What a run's steps add up to."""

    steps: int = 0
    turns: int = 0
    collisions: int = 0

    def after(self, action: Action, collided: bool) -> Travel:
        """The sums with one more step."""
        turned = action in (Action.TURN_LEFT, Action.TURN_RIGHT)
        return Travel(self.steps + 1, self.turns + int(turned), self.collisions + int(collided))


def summarise(
    travel: Travel,
    rows: Sequence[CurveRow],
    path_m: float,
    uncapped_cm: float | None,
    mesh: MeshQuality | None,
    ending: Ending,
) -> Metrics:
    """Put the numbers of a run together; ``rows`` is its curve, the last row of which stands for the whole."""
    last = rows[-1] if rows else None
    return Metrics(
        completion_ratio=last.completion_ratio if last else None,
        completion_cm=last.completion_cm if last else None,
        completion_uncapped_cm=uncapped_cm,
        observable_ratio=last.observable_ratio if last else None,
        accuracy_cm=mesh.accuracy_cm if mesh else None,
        mesh_completion_cm=mesh.completion_cm if mesh else None,
        mesh_completion_ratio=mesh.completion_ratio_percent if mesh else None,
        steps=travel.steps,
        path_m=path_m,
        turns=travel.turns,
        collisions=travel.collisions,
        stop_reason=ending.stop_reason,
        wall_s=ending.wall_s,
        hz=ending.hz,
        peak_rss_mib=ending.peak_rss_mib,
    )
