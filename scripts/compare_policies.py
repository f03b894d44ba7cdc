"""Compares two policies of a finished comparison, run by run.

    python scripts/compare_policies.py bench/smoke --policy gvg --other anm-s

Prints a Markdown table. For each start and seed it gives the completion ratio of the observable surface (final, and
area under the curve), the steps to 90 % of the other policy's final ratio, and how the first policy's run ended. Below
the table: the share of runs that the first policy wins, and its decision times. Only runs of both policies count; one
that never gets there counts with its budget.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from anm_mj.bench.run_result import OBSERVABLE, Result, read_results
from anm_mj.bench.statistics import restricted_steps
from anm_mj.cli.command_line import run_script
from anm_mj.errors import AnmError

SHARE = 0.9
"""Of the other policy's final ratio."""
USEFUL = 0.25
"""Gain after the last useful step [% of the observable surface]."""
HEADINGS = (
    "scene, budget",
    "start, seed",
    "final",
    "area under the curve",
    "steps to 90 % of the other's final",
    "stop reason",
)


def main(comparison: Annotated[Path, tyro.conf.Positional], policy: str = "gvg", other: str = "anm-s") -> None:
    """Compare two policies.

    Args:
        comparison: Output folder of ``anm-mj bench``.
        policy: First policy, as the tables name it: with settings, "anm-s (policy.target=random)".
        other: Second policy.
    """
    found = {}
    for result in read_results(comparison):
        job = result.job
        found[result.variant, (job.scene_name, job.steps, job.start, job.seed)] = result
    both = [key for name, key in found if name == policy and (other, key) in found]
    if not both:
        raise AnmError(f"{comparison} holds no runs that both {policy} and {other} have made; see its folder runs.")
    print(f"`{policy}` / `{other}`\n\n| " + " | ".join(HEADINGS) + " |\n|" + "---|" * len(HEADINGS))
    ratios, finals, areas, took_ms, num_reached = [], [], [], [], 0
    for key in both:
        ours, theirs = found[policy, key], found[other, key]
        wanted = SHARE * theirs.curve[-1, OBSERVABLE]
        steps, their_steps = ours.steps_to(wanted), theirs.steps_to(wanted)
        ratios.append(restricted_steps(steps, ours.job.steps) / max(their_steps, 1.0))
        num_reached += bool(np.isfinite(steps))
        finals.append((ours.curve[-1, OBSERVABLE], theirs.curve[-1, OBSERVABLE]))
        areas.append((ours.area_under_curve(OBSERVABLE), theirs.area_under_curve(OBSERVABLE)))
        took_ms += ours.decisions_ms()
        cells = (
            f"{key[0]}, {key[1]}",
            f"{key[2]}, {key[3]}",
            "{:.1f} / {:.1f} %".format(*finals[-1]),
            "{:.1f} / {:.1f} %".format(*areas[-1]),
            f"{steps:.0f} / {their_steps:.0f} ({100 * ratios[-1]:.0f} %)" if np.isfinite(steps) else "never",
            _end(ours),
        )
        print("| " + " | ".join(cells) + " |")
    ahead = [sum(our > their for our, their in pairs) for pairs in (finals, areas)]
    print(f"\nOf {len(both)} runs, {policy} has the higher final ratio in {ahead[0]}, the larger area in {ahead[1]}.")
    least = "at least " * (num_reached < len(both))
    mean = f"{least}{100 * np.mean(ratios):.0f} %"
    print(f"Steps to 90 % of the other's final: {mean} on average; {num_reached} of {len(both)} runs arrive.")
    half, many, most = np.percentile(took_ms or [np.nan], [50, 90, 99])
    print(f"{len(took_ms)} decisions of {policy}: median, 90th, 99th percentile {half:.1f}, {many:.1f}, {most:.1f} ms.")


def _end(result: Result) -> str:
    """Why and when the run ended, and when it last saw something useful."""
    last = result.steps_to(result.curve[-1, OBSERVABLE] - USEFUL)
    missing = [name for name in ("steps", "collisions", "stop_reason") if name not in result.metrics]
    if missing:
        raise AnmError(
            f"{result.folder / 'metrics.json'} lacks {missing[0]}; delete the run, and give the command again."
        )
    steps, collisions = result.metrics["steps"], result.metrics["collisions"]
    useful = f", last useful at {last:.0f} ({steps / max(last, 1.0):.2f})" if steps < result.job.steps else ""
    return f"{result.metrics['stop_reason']} at {steps}{useful}, {collisions} collisions"


if __name__ == "__main__":
    run_script(main)
