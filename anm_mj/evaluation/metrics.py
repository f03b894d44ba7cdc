"""Metrics of a run, as written to ``metrics.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.evaluation.mesh_quality import MeshQuality
from anm_mj.evaluation.view_quality import ViewQuality, ViewsResult
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.types import Action

NOVEL, FIXED = "novel_view", "fixed_view"
"""What the keys of ``metrics.json`` about novel and fixed views begin with."""
COUNTS = ("steps", "forwards", "turns", "blocked", "waits", "full_rotations", "collisions")
"""Keys of ``metrics.json`` that count steps."""
_OF_THE_MESH = {
    "accuracy_cm": "accuracy_cm",
    "mesh_completion_cm": "completion_cm",
    "mesh_completion_ratio": "completion_ratio_percent",
    "mesh_completion_ratio_25mm": "fine_completion_ratio_percent",
    "f_score": "f_score_percent",
    "chamfer_cm": "chamfer_cm",
}
"""Keys about the mesh and the fields of :class:`~anm_mj.evaluation.mesh_quality.MeshQuality`."""


@dataclass(frozen=True)
class RunSummary:
    """Facts that only the running program knows; all None if it was killed."""

    stop_reason: str | None = None
    """Why the run ended."""
    wall_s: float | None = None
    """Wall time from the start of the program to the end of the loop [s]."""
    hz: float | None = None
    """Steps per second of the loop itself, without set-up and evaluation."""
    evaluation_s: float | None = None
    """Time that the thread which records spent on the completion curve [s]."""
    peak_rss_mib: float | None = None
    """Peak resident memory of the process until map and mesh are written [MiB]; evaluation is not counted."""
    return_steps: int | None = None
    """Steps of the return to the start; None where the robot was not to go back, or did not come to it."""
    return_distance_m: float | None = None
    """Distance to the start at the end, as the robot believes it; None where it was not to go back [m]."""
    surface_lost_percent: float | None = None
    """Share of the observed surface that the map takes for free space: carved away [%]."""
    people_nearest_m: float | None = None
    """Between the robot's body and people or things that move; None, as the next three, among nobody [m]."""
    people_contacts: int | None = None
    """Steps by which the robot ran into one of them."""
    moved_precision_percent: float | None = None
    """Share of the pixels taken for moved that show people, once somebody was in view for five frames [%]."""
    moved_recall_percent: float | None = None
    """Share of the pixels that show people which were taken for moved, likewise [%]."""


@dataclass(frozen=True, kw_only=True)
class Metrics(RunSummary):
    """Metrics of a run, behind its summary. Fields are None if they could not be measured."""

    completion_ratio: float | None = None
    """Share of the true surface within 5 cm of a depth point [%] (first metric of the paper)."""
    completion_cm: float | None = None
    """Mean distance of the true surface to the nearest depth point, capped at 1 m [cm] (second metric of the paper)."""
    completion_uncapped_cm: float | None = None
    """Completion without the cap [cm]; the paper does not say which of the two it prints."""
    observable_ratio: float | None = None
    """Completion ratio of the observable surface alone [%]."""
    observable_share: float | None = None
    """Observable share of the true surface [%]."""
    completion_ratio_before: float | None = None
    """Completion ratio by the runs that this one went on from alone [%]; None for a run that began with nothing."""
    observable_ratio_before: float | None = None
    """Completion ratio of the observable surface by those runs alone [%]."""
    accuracy_cm: float | None = None
    """Mean distance of the reconstructed mesh to the true surface [cm]."""
    mesh_completion_cm: float | None = None
    """Mean distance of the true surface to the reconstructed mesh [cm]."""
    mesh_completion_ratio: float | None = None
    """Share of the true surface within 5 cm of the reconstructed mesh [%]."""
    mesh_completion_ratio_25mm: float | None = None
    """Share of the true surface within 2.5 cm of the reconstructed mesh [%]."""
    f_score: float | None = None
    """F-score of the mesh at 5 cm [%]."""
    chamfer_cm: float | None = None
    """Mean of accuracy and mesh completion [cm]."""
    observed_accuracy_cm: float | None = None
    """This and the next five: the mesh metrics, culled to the observed surface."""
    observed_mesh_completion_cm: float | None = None
    observed_mesh_completion_ratio: float | None = None
    observed_mesh_completion_ratio_25mm: float | None = None
    observed_f_score: float | None = None
    observed_chamfer_cm: float | None = None
    ghost_percent: float | None = None
    """Share of the reconstructed mesh farther than 10 cm from the true surface [%]."""
    novel_views: int | None = None
    """Novel views that the map was evaluated on. The next six are means over them."""
    novel_view_psnr_db: float | None = None
    """PSNR over whole images [dB]."""
    novel_view_psnr_known_db: float | None = None
    """PSNR over pixels where the map has a surface [dB]."""
    novel_view_ssim: float | None = None
    """Structural similarity, by a uniform window of 7 x 7 pixels."""
    novel_view_depth_l1_cm: float | None = None
    """Mean absolute error of planar depth over pixels where the map has a surface [cm]."""
    novel_view_depth_error_cm: float | None = None
    """Mean absolute error of planar depth over all pixels, each capped at 1 m; without a surface it is 1 m [cm]."""
    novel_view_known_percent: float | None = None
    """Share of the pixels where the map has a surface [%]."""
    fixed_views: int | None = None
    """Fixed views that the map was evaluated on. The next six are means over them, as for novel views."""
    fixed_view_psnr_db: float | None = None
    fixed_view_psnr_known_db: float | None = None
    fixed_view_ssim: float | None = None
    fixed_view_depth_l1_cm: float | None = None
    fixed_view_depth_error_cm: float | None = None
    fixed_view_known_percent: float | None = None
    position_rmse_cm: float | None = None
    """As the next nine: :class:`~anm_mj.evaluation.trajectory_error.TrajectoryError`; None with true poses."""
    ate_rmse_cm: float | None = None
    rpe_cm_per_m: float | None = None
    rpe_deg_per_m: float | None = None
    rpe_deg_per_quarter_turn: float | None = None
    final_position_error_cm: float | None = None
    final_heading_error_deg: float | None = None
    lost_percent: float | None = None
    unmapped_percent: float | None = None
    loops_closed: int | None = None
    aligned_observed_accuracy_cm: float | None = None
    """This and the next one: the mesh metrics after the alignment of the trajectory; None with true poses."""
    aligned_observed_f_score: float | None = None
    steps: int
    """Number of steps."""
    path_m: float
    """Driven distance [m]."""
    forwards: int
    """Steps that moved forward."""
    turns: int
    """Steps that turned on the spot."""
    blocked: int
    """Forward steps that did not move."""
    waits: int
    """Steps that waited for something that moved."""
    full_rotations: int
    """Full turns on the spot without a move in between."""
    collisions: int
    """Steps with a collision."""
    stage_hz: dict[str, float]
    """Rate of each stage of the loop, as if it were the only one [steps/s]."""


@dataclass(frozen=True)
class EpisodeStatistics:
    """Sums over the steps of a run."""

    forwards: int = 0
    turns: int = 0
    blocked: int = 0
    waits: int = 0
    full_rotations: int = 0
    collisions: int = 0
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Wall time of each stage of the loop [ms]."""
    turned_in_a_row: int = 0
    """Turns to one side since the last move or turn to the other: positive to the left, negative to the right."""

    @property
    def steps(self) -> int:
        """Number of steps."""
        return self.forwards + self.turns + self.blocked + self.waits

    def after(self, action: Action, collided: bool, moved_m: float, stage_ms: dict[str, float]) -> EpisodeStatistics:
        """The statistics with one more step."""
        side = {Action.TURN_LEFT: 1, Action.TURN_RIGHT: -1}.get(action, 0)
        # In the physics drive a robot that waits creeps.
        moved = action is Action.MOVE_FORWARD and moved_m > 0.0
        goes_on = not moved and side * self.turned_in_a_row >= 0
        in_a_row = self.turned_in_a_row + side if goes_on else side
        return EpisodeStatistics(
            forwards=self.forwards + moved,
            turns=self.turns + abs(side),
            blocked=self.blocked + (action is Action.MOVE_FORWARD and not moved),
            waits=self.waits + (action is Action.WAIT),
            full_rotations=self.full_rotations + (side != 0 and in_a_row % NUM_HEADINGS == 0),
            collisions=self.collisions + collided,
            stage_ms={
                name: self.stage_ms.get(name, 0.0) + stage_ms.get(name, 0.0) for name in {**self.stage_ms, **stage_ms}
            },
            turned_in_a_row=in_a_row,
        )

    @property
    def stage_hz(self) -> dict[str, float]:
        """Rate of each stage, as if it were the only one [steps/s]."""
        return {name: 1e3 * self.steps / ms for name, ms in self.stage_ms.items() if ms > 0.0}


def summarise(
    statistics: EpisodeStatistics,
    curve: CompletionCurve,
    uncapped_cm: float | None,
    truth: GroundTruth | None,
    mesh: tuple[MeshQuality, MeshQuality | None] | None,
    summary: RunSummary,
    views: Mapping[str, Any] | None = None,
    trajectory: Mapping[str, Any] | None = None,
) -> Metrics:
    """Assemble the metrics of a run with a finished curve.

    ``mesh`` is the quality of the whole mesh, and culled to the observed surface; None without a mesh, or a truth.
    ``views`` is that of the map on novel and fixed views, as :func:`view_metrics` has it, ``trajectory`` the errors of
    the trajectory by the keys of ``metrics.json``; None if not measured.
    """
    last, before = curve.rows[-1] if curve.rows else None, curve.before
    whole, observed = mesh or (None, None)
    return Metrics(
        completion_ratio=last and last.completion_ratio,
        completion_cm=last and last.completion_cm,
        observable_ratio=last and last.observable_ratio,
        completion_uncapped_cm=uncapped_cm,
        observable_share=None if truth is None or truth.observable is None else 100.0 * float(truth.observable.mean()),
        completion_ratio_before=before and before.ratio_percent,
        observable_ratio_before=before and before.observable_ratio_percent,
        **{name: getattr(whole, field, None) for name, field in _OF_THE_MESH.items()},
        ghost_percent=whole and whole.ghost_percent,
        **{f"observed_{name}": getattr(observed, field, None) for name, field in _OF_THE_MESH.items()},
        **(views or {}),
        **(trajectory or {}),
        path_m=curve.path_m,
        **{name: getattr(statistics, name) for name in (*COUNTS, "stage_hz")},
        **vars(summary),
    )


def pictured(curve: CompletionCurve, statistics: EpisodeStatistics) -> dict[str, Any]:
    """Those of a run's metrics that its pictures name, by the keys of ``metrics.json``."""
    last = curve.rows[-1] if curve.rows else None
    return {
        "observable_ratio": last and last.observable_ratio,
        "completion_ratio": last and last.completion_ratio,
        "steps": statistics.steps,
        "path_m": curve.path_m,
    }


def view_metrics(result: ViewsResult, prefix: str) -> dict[str, Any]:
    """The fields of :class:`Metrics` about views. ``prefix`` is ``NOVEL`` or ``FIXED``."""
    means = {} if result.mean is None else vars(result.mean)
    values = {spec.name: means.get(spec.name, math.nan) for spec in fields(ViewQuality)}
    named = {f"{prefix}_{name}": value if math.isfinite(value) else None for name, value in values.items()}
    return {f"{prefix}s": result.num_views, **named}
