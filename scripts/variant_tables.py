"""Prints what a sensor or a setting costs, or brings, from a finished comparison: variants paired by scene and start.

    anm-mj bench docs/sensors.toml --out bench/sensors
    python scripts/variant_tables.py bench/sensors

For each policy two Markdown tables of the completion ratio, observable [%]: its mean at the end, with the range over
starts and seeds, by scene and variant; and the differences from the reference, with their standard error over scenes.
Below them: contacts, runs that ended before their budget with more than 5 % left, mesh accuracy, and the times of all
decisions.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float

from anm_mj.bench.run_result import OBSERVABLE, Result, read_results
from anm_mj.bench.statistics import scene_means
from anm_mj.cli.command_line import run_script
from anm_mj.errors import AnmError

LEFT_PERCENT = 5.0
"""A run that ends by itself with more of the observable surface left than this has given up [%]."""
USUAL = "usual"
"""Name of the variant whose sensor, goal and settings are the defaults."""

Runs = dict[tuple[str, str, int, int], Result]
"""By variant, scene, start and seed."""


def main(comparison: Annotated[Path, tyro.conf.Positional], reference: str | None = None) -> None:
    """Compare the variants.

    Args:
        comparison: Output folder of ``anm-mj bench``.
        reference: Variant that the others are compared with, as the tables name it; the first one, if not given.
    """
    found = _by_policy(comparison)
    variants_of = {policy: list(dict.fromkeys(key[0] for key in runs)) for policy, runs in found.items()}
    for policy, variants in variants_of.items():
        if reference is not None and reference not in variants:
            raise AnmError(f"{comparison} holds no variant {reference!r} of {policy}, but {', '.join(variants)}.")
    for policy, runs in found.items():
        variants = variants_of[policy]
        _print_finals(policy, runs, variants)
        _print_differences(runs, variants, variants[0] if reference is None else reference)
        for variant in variants:
            print(f"{policy}, {variant}: {_told([runs[key] for key in runs if key[0] == variant])}")
        print()


def _by_policy(comparison: Path) -> dict[str, Runs]:
    """All runs of a comparison.

    Raises:
        AnmError: There is none, or two of one kind.
    """
    found: dict[str, Runs] = defaultdict(dict)
    for whole in read_results(comparison):
        # A run with several budgets counts at the first one.
        result = whole.cuts[0]
        job = result.job
        variant = result.variant.removeprefix(job.policy).strip(" ()") or USUAL
        scene = f"{job.scene_name}, by {result.budget_by}" if result.budget_by else job.scene_name
        key = variant, scene, job.start, job.seed
        if key in found[job.policy]:
            raise AnmError(f"{comparison} holds two runs of {job.policy} with {key}; their scenes have one name.")
        found[job.policy][key] = result
    if not found:
        raise AnmError(f"{comparison} holds no finished run; make them by anm-mj bench.")
    # The usual variant first, then those with the shortest names.
    return {policy: {key: runs[key] for key in sorted(runs, key=_place)} for policy, runs in found.items()}


def _place(key: tuple[str, str, int, int]) -> tuple[bool, int, tuple[str, str, int, int]]:
    return key[0] != USUAL, len(key[0]), key


def _print_finals(policy: str, runs: Runs, variants: list[str]) -> None:
    print(f"| `{policy}` | " + " | ".join(variants) + " |\n" + "|---" * (len(variants) + 1) + "|")
    for scene in sorted({key[1] for key in runs}):
        cells = []
        for variant in variants:
            final = [run.curve[-1, OBSERVABLE] for key, run in runs.items() if key[:2] == (variant, scene)]
            spread = f" ({min(final):.1f} to {max(final):.1f})" if len(final) > 1 else ""
            cells.append(f"{np.mean(final):.1f}{spread}" if final else "")
        print(f"| {scene} | " + " | ".join(cells) + " |")


def _print_differences(runs: Runs, variants: list[str], reference: str) -> None:
    print(f"\n| minus {reference} | pairs | final | area under the curve |\n|---|---|---|---|")
    for variant in variants:
        if variant == reference:
            continue
        pairs = [(run, runs[reference, *key[1:]]) for key, run in runs.items()
                 if key[0] == variant and (reference, *key[1:]) in runs]  # fmt: skip
        scenes = [ours.job.scene_name for ours, _ in pairs]
        final = [ours.curve[-1, OBSERVABLE] - theirs.curve[-1, OBSERVABLE] for ours, theirs in pairs]
        area = [ours.area_under_curve(OBSERVABLE) - theirs.area_under_curve(OBSERVABLE) for ours, theirs in pairs]
        changed = (_mean(scene_means(scenes, values)) for values in (final, area))
        print(f"| {variant} | {len(pairs)} | {' | '.join(changed)} |")
    print()


def _mean(values: Float[np.ndarray, " n"]) -> str:
    """Mean over scenes and its standard error; starts of one scene are not independent."""
    if len(values) < 2:
        return f"{values[0]:+.1f}" if len(values) else ""
    return f"{np.mean(values):+.1f} ± {np.std(values, ddof=1) / len(values) ** 0.5:.1f}"


def _told(runs: list[Result]) -> str:
    """Contacts, early ends, mesh accuracy and decision times of a variant's runs."""
    touched = sum(run.metrics["collisions"] > 0 for run in runs)
    early = [
        f"{run.metrics['stop_reason']} in {run.job.scene_name}, start {run.job.start}, at {run.metrics['steps']} "
        f"with {100.0 - run.curve[-1, OBSERVABLE]:.1f} % left"
        for run in runs
        if run.metrics["steps"] < run.job.steps and run.curve[-1, OBSERVABLE] < 100.0 - LEFT_PERCENT
    ]
    accuracy_cm = [run.metrics["accuracy_cm"] for run in runs if run.metrics.get("accuracy_cm") is not None]
    took_ms = [ms for run in runs for ms in run.decisions_ms()]
    told = [f"{touched} of {len(runs)} runs with a contact", *early]
    if accuracy_cm:
        told.append(f"mesh accuracy {min(accuracy_cm):.2f} to {max(accuracy_cm):.2f} cm")
    if took_ms:
        told.append("{} decisions, median {:.1f} ms, 99th percentile {:.1f} ms".format(
            len(took_ms), *np.percentile(took_ms, [50, 99])))  # fmt: skip
    return "; ".join(told)


if __name__ == "__main__":
    run_script(main)
