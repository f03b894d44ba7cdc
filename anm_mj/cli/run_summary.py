"""What a command that leaves a run prints at its end."""

import dataclasses
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from anm_mj.cli.command_line import Report
from anm_mj.cli.console import PlainConsole
from anm_mj.evaluation.metrics import Metrics


def print_folder(console: PlainConsole, folder: Path) -> None:
    """Print where a run lies, and how to look at it."""
    console.say(f"Run folder: {folder}", f"Replay: anm-mj view {shlex.quote(str(folder))}")


def print_fit(console: PlainConsole, metrics: Mapping[str, Any]) -> None:
    """Print how well the frames of a sequence fit their map, from its ``metrics.json``."""
    if metrics.get("fit_residual_cm") is not None:
        console.say(
            f"{metrics['fit_percent']:.1f} % of the points of later frames fit the map; their median distance is "
            f"{metrics['fit_residual_cm']:.2f} cm (half of all frames "
            f"within {metrics['fit_residual_spread_cm']:.2f} cm of it)."
        )


def print_tracking(console: PlainConsole, metrics: Mapping[str, Any]) -> None:
    """Print how a sequence was tracked, from its ``metrics.json``."""
    parts = [
        f"{words} {metrics[key]:.2f} {unit}"
        for words, key, unit in (
            ("frames lost", "lost_percent", "%"),
            ("not mapped", "unmapped_percent", "%"),
            ("ATE RMSE, aligned", "ate_rmse_cm", "cm"),
            ("position RMSE from the first pose", "position_rmse_cm", "cm"),
            ("drift per metre", "rpe_cm_per_m", "cm"),
        )
        if metrics.get(key) is not None
    ]
    parts += [f"{stage} {ms:.0f} ms a frame" for stage, ms in metrics.get("frame_ms", {}).items()]
    console.say("; ".join(parts) + ".")


def report_metrics(console: PlainConsole, metrics: Metrics, folder: Path, status: int = 0) -> Report:
    """Print the metrics of a run as a table, and where it lies; both as a report with an exit status."""
    table = Table(box=None, show_header=False)
    for label, value, unit in (
        ("completion ratio, observable", metrics.observable_ratio, "%"),
        ("completion ratio (< 5 cm)", metrics.completion_ratio, "%"),
        ("completion (capped at 1 m)", metrics.completion_cm, "cm"),
        ("mesh accuracy", metrics.accuracy_cm, "cm"),
        ("mesh completion ratio (< 5 cm)", metrics.mesh_completion_ratio, "%"),
        ("mesh F-score, observed", metrics.observed_f_score, "%"),
        ("novel-view PSNR", metrics.novel_view_psnr_db, "dB"),
        ("novel-view SSIM", metrics.novel_view_ssim, ""),
        ("novel-view depth L1", metrics.novel_view_depth_l1_cm, "cm"),
        ("fixed-view PSNR", metrics.fixed_view_psnr_db, "dB"),
        ("fixed-view SSIM", metrics.fixed_view_ssim, ""),
        ("fixed-view depth error", metrics.fixed_view_depth_error_cm, "cm"),
        ("position RMSE", metrics.position_rmse_cm, "cm"),
        ("ATE RMSE, aligned", metrics.ate_rmse_cm, "cm"),
        ("final position error", metrics.final_position_error_cm, "cm"),
        ("final heading error", metrics.final_heading_error_deg, "deg"),
        ("frames lost", metrics.lost_percent, "%"),
        ("loops closed", metrics.loops_closed, ""),
        ("steps", metrics.steps, f"({metrics.turns} turns, {metrics.blocked} blocked)"),
        ("path length", metrics.path_m, "m"),
        ("rate", metrics.hz, "steps/s"),
        ("peak RSS", metrics.peak_rss_mib, "MiB"),
    ):
        if value is not None:
            table.add_row(label, f"{value:.2f}" if isinstance(value, float) else str(value), unit)
    table.add_row("stop reason", metrics.stop_reason or "killed", "")
    console.print(table)
    print_folder(console, folder)
    return Report({"folder": folder, **dataclasses.asdict(metrics)}, status)
