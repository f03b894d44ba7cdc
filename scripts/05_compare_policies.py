"""Compares policies from several starts and prints the table.

    python scripts/05_compare_policies.py
    python scripts/05_compare_policies.py --policies gvg anm-s frontier --scenes home office --starts 3 --workers 2

The same as ``anm-mj bench FILE.toml`` (docs/benchmarks.md). What is finished is never run again: a second call with
more policies or starts only adds what is missing.
"""

import csv
from pathlib import Path

from anm_mj.bench.comparison import run_bench
from anm_mj.cli.command_line import run_script
from anm_mj.errors import BenchError
from anm_mj.scene.folder import load_scene


def main(
    policies: tuple[str, ...] = ("gvg", "random"),
    scenes: tuple[str, ...] = ("flat",),
    starts: int = 2,
    steps: int = 200,
    workers: int = 1,
    out: Path = Path("bench/comparison"),
) -> None:
    """Run what is missing of a comparison, and print its results.

    Args:
        policies: names, or module:Class for your own; a module lies in the current folder.
        scenes: names (anm-mj scene list), or paths of scene folders.
        starts: the first so many start poses of every scene.
        steps: budget of actions.
        workers: runs in parallel.
        out: folder of the comparison.
    """
    for scene in scenes:
        # What cannot be explored leaves no folder.
        load_scene(scene)
    out.mkdir(parents=True, exist_ok=True)
    file = out / "comparison.toml"
    file.write_text(
        f"policies = {list(policies)}\nscenes = {list(scenes)}\nstarts = {starts}\nsteps = {steps}\nviews = false\n",
        encoding="utf-8",
    )
    made = run_bench(file, out, num_workers=workers, on_run=lambda done, total, last: print(f"{done}/{total} {last}"))
    for failure in made.failures:
        print(failure)
    if not made.has_tables:
        raise BenchError("All runs failed; there are no tables yet.")

    with (out / "results.csv").open(encoding="utf-8", newline="") as table:
        rows = list(csv.DictReader(table))
    for policy in policies:
        ratios = [float(row["observable_ratio"]) for row in rows if row["policy"] == policy]
        if ratios:
            print(f"{policy:10} {sum(ratios) / len(ratios):5.1f} % of what can be seen, mean of {len(ratios)} runs")
    print(f"means, deviations, paired differences, curves, trajectories: {out / 'report.html'}")


if __name__ == "__main__":
    run_script(main)
