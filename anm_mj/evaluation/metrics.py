"""The numbers of a run, as they stand in ``metrics.json``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from anm_mj.evaluation.curve import CurveRow
from anm_mj.evaluation.ground_truth import GroundTruth
from anm_mj.evaluation.mesh import MeshQuality
from anm_mj.evaluation.novel_view_poses import HeldOut, ViewQuality
from anm_mj.types import TURN_STEP_RAD, Action

FULL_TURN = round(math.tau / TURN_STEP_RAD)
"""Turns to one side that make a look around."""


@dataclass(frozen=True)
class Ending:
    """What only the running program could know; all None where it was killed."""

    stop_reason: str | None = None
    wall_s: float | None = None
    """From the start of the program to the end of the loop [s]."""
    hz: float | None = None
    """Steps per second of the loop itself, without set-up and evaluation."""
    evaluation_s: float | None = None
    """Wall time spent on the numbers and on writing frames while the loop went [s]."""
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
    observable_share: float | None
    """Share of the true surface that can be seen at all [%]; None where that is not known."""
    accuracy_cm: float | None
    """Mean distance of the reconstructed mesh to the true surface [cm]; None without a mesh, as are the next four."""
    mesh_completion_cm: float | None
    """Mean distance of the true surface to the reconstructed mesh [cm]."""
    mesh_completion_ratio: float | None
    """Share of the true surface within 5 cm of the reconstructed mesh [%]."""
    f_score: float | None
    """Harmonic mean of that and of the mesh's share within 5 cm of the true surface [%]."""
    chamfer_cm: float | None
    """Mean of accuracy and mesh completion [cm]."""
    observed_accuracy_cm: float | None
    """The same five, culled to the surface that the run observed."""
    observed_mesh_completion_cm: float | None
    observed_mesh_completion_ratio: float | None
    observed_f_score: float | None
    observed_chamfer_cm: float | None
    heldout_views: int | None
    """Views from where the robot never stood that the map was compared on; None where that was not done."""
    heldout_psnr_db: float | None
    """Their mean PSNR over whole pictures [dB]; None without a view, as are the next four."""
    heldout_psnr_known_db: float | None
    """The same over pixels that the map has a surface at [dB]."""
    heldout_ssim: float | None
    """Their mean structural similarity."""
    heldout_depth_l1_cm: float | None
    """Their mean absolute error of planar depth [cm]."""
    heldout_known_percent: float | None
    """Share of their pixels at which the map has a surface [%]."""
    steps: int
    path_m: float
    """Distance driven [m]."""
    forwards: int
    """Steps that moved forward."""
    turns: int
    """Steps that turned on the spot."""
    blocked: int
    """Steps that asked to move forward and did not."""
    look_arounds: int
    """Full turns on the spot, without a move in between."""
    collisions: int
    """Steps that met an obstacle."""
    stage_hz: dict[str, float]
    """For each stage of the loop, how many steps a second there would be if it were the only one."""
    stop_reason: str | None
    """Why the run ended; None where it was killed, as are the next four."""
    wall_s: float | None
    """Wall time of the run until the end of the loop [s]."""
    hz: float | None
    """Steps per second of the loop itself, without set-up and evaluation."""
    evaluation_s: float | None
    """Wall time spent on the numbers and on writing frames while the loop went [s]."""
    peak_rss_mib: float | None
    """Largest memory of the process until the end of the loop [MiB]."""


@dataclass(frozen=True)
class Travel:
    """What a run's steps add up to."""

    forwards: int = 0
    turns: int = 0
    blocked: int = 0
    look_arounds: int = 0
    collisions: int = 0
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Wall time of each stage of the loop [ms]."""
    turned_in_a_row: int = 0
    """Turns to one side since the last other action: positive to the left, negative to the right."""

    @property
    def steps(self) -> int:
        """All steps."""
        return self.forwards + self.turns + self.blocked

    def after(self, action: Action, collided: bool, moved_m: float, stage_ms: dict[str, float]) -> Travel:
        """The sums with one more step."""
        side = {Action.TURN_LEFT: 1, Action.TURN_RIGHT: -1}.get(action, 0)
        in_a_row = self.turned_in_a_row + side if side * self.turned_in_a_row > 0 else side
        moved = side == 0 and moved_m > 0.0
        return Travel(
            forwards=self.forwards + moved,
            turns=self.turns + abs(side),
            blocked=self.blocked + (side == 0 and not moved),
            look_arounds=self.look_arounds + (side != 0 and in_a_row % FULL_TURN == 0),
            collisions=self.collisions + collided,
            stage_ms={
                name: self.stage_ms.get(name, 0.0) + stage_ms.get(name, 0.0) for name in {**self.stage_ms, **stage_ms}
            },
            turned_in_a_row=in_a_row,
        )

    @property
    def stage_hz(self) -> dict[str, float]:
        """For each stage, how many steps a second there would be if it were the only one."""
        return {name: 1e3 * self.steps / ms for name, ms in self.stage_ms.items() if ms > 0.0}


def summarise(
    travel: Travel,
    rows: Sequence[CurveRow],
    path_m: float,
    uncapped_cm: float | None,
    truth: GroundTruth,
    mesh: tuple[MeshQuality, MeshQuality | None] | None,
    ending: Ending,
    heldout: HeldOut | None = None,
) -> Metrics:
    """Put the numbers of a run together.

    Args:
        travel: What its steps add up to.
        rows: Its curve, the last row of which stands for the whole.
        path_m: Distance driven [m].
        uncapped_cm: Completion without a cap [cm].
        truth: The true surface.
        mesh: Quality of its mesh, of the whole and culled to what was observed; None without a mesh.
        ending: What only the running program knew.
        heldout: Quality of its views from where the robot never stood; None where that was not measured.
    """
    last = rows[-1] if rows else None
    whole, observed = mesh or (None, None)
    return Metrics(
        completion_ratio=last.completion_ratio if last else None,
        completion_cm=last.completion_cm if last else None,
        completion_uncapped_cm=uncapped_cm,
        observable_ratio=last.observable_ratio if last else None,
        observable_share=None if truth.observable is None else 100.0 * float(truth.observable.mean()),
        accuracy_cm=whole.accuracy_cm if whole else None,
        mesh_completion_cm=whole.completion_cm if whole else None,
        mesh_completion_ratio=whole.completion_ratio_percent if whole else None,
        f_score=whole.f_score_percent if whole else None,
        chamfer_cm=whole.chamfer_cm if whole else None,
        observed_accuracy_cm=observed.accuracy_cm if observed else None,
        observed_mesh_completion_cm=observed.completion_cm if observed else None,
        observed_mesh_completion_ratio=observed.completion_ratio_percent if observed else None,
        observed_f_score=observed.f_score_percent if observed else None,
        observed_chamfer_cm=observed.chamfer_cm if observed else None,
        steps=travel.steps,
        path_m=path_m,
        forwards=travel.forwards,
        turns=travel.turns,
        blocked=travel.blocked,
        look_arounds=travel.look_arounds,
        collisions=travel.collisions,
        stage_hz=travel.stage_hz,
        stop_reason=ending.stop_reason,
        wall_s=ending.wall_s,
        hz=ending.hz,
        evaluation_s=ending.evaluation_s,
        peak_rss_mib=ending.peak_rss_mib,
        **held_out_numbers(heldout),
    )


def held_out_numbers(heldout: HeldOut | None) -> dict[str, Any]:
    """The fields of :class:`Metrics` that tell of held-out views."""
    values = vars(heldout.mean) if heldout and heldout.mean else {}
    numbers = {field.name: values.get(field.name, math.nan) for field in fields(ViewQuality)}
    found = {f"heldout_{name}": value if math.isfinite(value) else None for name, value in numbers.items()}
    return {"heldout_views": heldout.num_views if heldout else None, **found}
