"""Draws completion over the noise of a depth camera from a finished comparison, and prints it as a table.

    anm-mj bench docs/noise.toml --out bench/noise
    python scripts/noise_figure.py bench/noise --out docs/experiments/noise.png

Every run of the comparison must set ``sensor.noise_scale``. One curve per scene and one panel per policy; an open mark
is a run that ended before its budget. Below the table: contacts, runs that ended early with more than 5 % of the
observable surface left, and the times of all decisions.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from matplotlib.figure import Figure

from anm_mj.bench.figures import style
from anm_mj.bench.run_result import OBSERVABLE, Result, read_results
from anm_mj.cli.command_line import run_script
from anm_mj.errors import AnmError
from anm_mj.viz.figure_file import save_figure

SETTING = "sensor.noise_scale="
LEFT_PERCENT = 5.0
"""A run that ends by itself with more of the observable surface left than this has given up [%]."""

Runs = dict[tuple[str, str, float], Result]
"""By policy, scene and noise scale."""


def main(comparison: Annotated[Path, tyro.conf.Positional], out: Path = Path("noise.png")) -> None:
    """Draw and print.

    Args:
        comparison: Output folder of ``anm-mj bench``.
        out: The figure; an SVG of the same name is written beside it.
    """
    runs = read_runs(comparison)
    draw(runs, out)
    print_table(runs)
    took_ms = defaultdict(list)
    for (policy, _, _), result in runs.items():
        took_ms[policy] += result.decisions_ms()
    for policy, ms in took_ms.items():
        half, most = np.percentile(ms, [50, 99])
        print(f"{policy}: {len(ms)} decisions, median {half:.1f} ms, 99th percentile {most:.1f} ms.")


def read_runs(comparison: Path) -> Runs:
    """The runs that set the noise scale.

    Raises:
        AnmError: There is none, or two runs differ in something else.
    """
    runs: Runs = {}
    for result in read_results(comparison):
        scale = [setting.removeprefix(SETTING) for setting in result.job.settings if setting.startswith(SETTING)]
        if not scale:
            continue
        key = result.job.policy, result.job.scene_name, float(scale[0])
        if key in runs:
            raise AnmError(f"{comparison} holds two runs of {key}; give a comparison with one start and one seed.")
        runs[key] = result
    if not runs:
        raise AnmError(f"{comparison} holds no run with {SETTING[:-1]}; make them by anm-mj bench docs/noise.toml.")
    return runs


def draw(runs: Runs, out: Path) -> None:
    """The figure: a panel per policy, a curve per scene."""
    policies, scenes = (list(dict.fromkeys(key[i] for key in runs)) for i in (0, 1))
    figure = Figure(figsize=(4.5 * len(policies) + 1.5, 4.0), dpi=120, layout="constrained")
    for panel, policy in enumerate(policies):
        axes = figure.add_subplot(1, len(policies), panel + 1)
        for k, scene in enumerate(scenes):
            found = sorted((key[2], result) for key, result in runs.items() if key[:2] == (policy, scene))
            scale, final = [s for s, _ in found], [r.curve[-1, OBSERVABLE] for _, r in found]
            colour, line, mark = (style(k)[key] for key in ("color", "ls", "marker"))
            axes.plot(scale, final, ls=line, lw=1.5, color=colour, label=scene if not panel else None)
            for x, y, (_, result) in zip(scale, final, found, strict=True):
                ended = result.metrics["steps"] < result.job.steps
                axes.plot(x, y, ls="", marker=mark, ms=6, color=colour, mfc="white" if ended else colour)
        axes.set(xlabel="noise scale", xlim=(-0.05, 2.05), ylim=(0.0, 100.0), title=policy)
        axes.set_ylabel("completion ratio, observable [%]" if not panel else "")
        axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", frameon=False, handlelength=3.5)
    save_figure(figure, out, ("png", "svg"))


def print_table(runs: Runs) -> None:
    """A row per policy and scene, a column per noise scale; then contacts, and runs that gave up."""
    scales = sorted({key[2] for key in runs})
    print("| policy | scene | " + " | ".join(f"{scale:g}" for scale in scales) + " |")
    print("|---" * (len(scales) + 2) + "|")
    for policy, scene in dict.fromkeys(key[:2] for key in runs):
        cells = []
        for scale in scales:
            result = runs.get((policy, scene, scale))
            cells.append("" if result is None else f"{result.curve[-1, OBSERVABLE]:.1f}")
        print(f"| {policy} | {scene} | " + " | ".join(cells) + " |")
    print()
    for (policy, scene, scale), result in runs.items():
        metrics, left = result.metrics, 100.0 - result.curve[-1, OBSERVABLE]
        if metrics["collisions"]:
            print(f"{policy} in {scene} at {scale:g}: {metrics['collisions']} contacts.")
        if metrics["steps"] < result.job.steps and left > LEFT_PERCENT:
            print(f"{policy} in {scene} at {scale:g}: {metrics['stop_reason']} with {left:.1f} % left.")


if __name__ == "__main__":
    run_script(main)
