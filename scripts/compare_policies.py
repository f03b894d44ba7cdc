"""Holds one policy of a finished comparison against another, start by start.

    python scripts/compare_policies.py bench/benchmark --policy gvg --other anm-s

Prints a Markdown table: what of the observable surface each has seen at its end and on average over the budget, after
how many steps the one has seen 90 % of what the other sees at its end, and how the one's run ended; below it in how
many runs the one is ahead, and how long its decisions took. Only runs that both have made are compared.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from anm_mj.bench.engine import RESULT
from anm_mj.bench.results_table import Result, read_result
from anm_mj.errors import AnmError
from anm_mj.io.jsonl import read_json_lines

SHARE = 0.9
"""Of what the other has seen at its end."""
USEFUL = 0.25
"""What is seen after the last useful step, of the observable surface [%]."""
HEADINGS = ("scene, budget", "start, seed", "at the end", "on average", "steps to 90 % of the other's end", "the end")


def main(comparison: Annotated[Path, tyro.conf.Positional], policy: str = "gvg", other: str = "anm-s") -> None:
    """Compare two policies.

    Args:
        comparison: Folder that ``anm-mj bench`` has written.
        policy: The one, as the tables name it: with settings, "anm-s (planning.target=random)".
        other: The other.
    """
    found, folder = {}, {}
    for path in sorted(comparison.glob(f"runs/*/{RESULT}")):
        result = read_result(path.parent)
        job = result.job
        key = result.variant, (job["scene_name"], job["steps"], job["start"], job["seed"])
        found[key], folder[key] = result, path.parent
    both = [key for name, key in found if name == policy and (other, key) in found]
    if not both:
        raise AnmError(f"{comparison} holds no runs that both {policy} and {other} have made; see its folder runs.")
    print(f"`{policy}` / `{other}`\n\n| " + " | ".join(HEADINGS) + " |\n|" + "---|" * len(HEADINGS))
    ratios, ends, means, took_ms = [], [], [], []
    for key in both:
        ours, theirs = found[policy, key], found[other, key]
        wanted = SHARE * theirs.curve[-1, 3]
        steps, their_steps = ours.steps_to(wanted), theirs.steps_to(wanted)
        ratios.append(steps / their_steps)
        ends.append((ours.curve[-1, 3], theirs.curve[-1, 3]))
        means.append((_mean(ours), _mean(theirs)))
        decisions = read_json_lines(folder[policy, key] / "plans.jsonl")
        took_ms += [sum(line["ms"].values()) for line in decisions if line["ms"]]
        cells = (
            f"{key[0]}, {key[1]}",
            f"{key[2]}, {key[3]}",
            "{:.1f} / {:.1f} %".format(*ends[-1]),
            "{:.1f} / {:.1f} %".format(*means[-1]),
            f"{steps:.0f} / {their_steps:.0f} ({100 * ratios[-1]:.0f} %)" if np.isfinite(steps) else "never",
            _end(ours),
        )
        print("| " + " | ".join(cells) + " |")
    known = np.array(ratios)[np.isfinite(ratios)]
    ahead = [sum(our > their for our, their in pairs) for pairs in (ends, means)]
    print(f"\nAhead at the end in {ahead[0]} of {len(both)} runs, on average over the budget in {ahead[1]}.")
    print(f"Steps to 90 % of the other's end: {100 * known.mean():.0f} % on average over {len(known)} runs.")
    half, most = np.percentile(took_ms or [np.nan], [50, 99])
    print(f"Decisions of {policy}: {len(took_ms)}, half within {half:.1f} ms and 99 of 100 within {most:.1f} ms.")


def _mean(result: Result) -> float:
    """Share of the observable surface covered, averaged over the budget; kept at its last value after an end [%]."""
    budget = result.job["steps"]
    steps, ratio = np.append(result.curve[:, 0], budget), np.append(result.curve[:, 3], result.curve[-1, 3])
    return float(np.trapezoid(ratio, steps) / budget)


def _end(result: Result) -> str:
    """Why and when the run ended, and when it last saw something useful."""
    last = result.steps_to(result.curve[-1, 3] - USEFUL)
    steps, collisions = result.metrics["steps"], result.metrics["collisions"]
    useful = f", last useful at {last:.0f} ({steps / max(last, 1.0):.2f})" if steps < result.job["steps"] else ""
    return f"{result.metrics['stop_reason']} at {steps}{useful}, {collisions} contacts"


if __name__ == "__main__":
    tyro.cli(main)
