"""Prints what people cost a run: a row per policy, sensor and settings of a comparison among people.

    anm-mj bench docs/people.toml --out runs/people
    python scripts/people_table.py runs/people

Coverage stands beside that of the same run without people: the mean over scenes of each scene's mean ratio, with the
95 % interval of a bootstrap over scenes.
"""

import statistics
from collections import defaultdict
from pathlib import Path
from typing import Annotated, Any

import tyro

from anm_mj.bench.statistics import LEAST_SCENES, bootstrap_interval, scene_means
from anm_mj.cli.command_line import run_script
from anm_mj.io.read_run import read_json
from anm_mj.types import StopReason

COLUMNS = {
    "coverage [%]": "observable_ratio",
    "ghosts [%]": "ghost_percent",
    "surface lost [%]": "surface_lost_percent",
    "accuracy [cm]": "observed_accuracy_cm",
    "contacts": "people_contacts",
    "nearest [m]": "people_nearest_m",
    "waits": "waits",
    "precision [%]": "moved_precision_percent",
    "recall [%]": "moved_recall_percent",
}
WORST = {"people_contacts": sum, "people_nearest_m": min}
"""Other figures are means over the runs."""


def main(comparison: Annotated[Path, tyro.conf.Positional]) -> None:
    """Print the table of a comparison's folder."""
    rows: dict[tuple[Any, ...], dict[tuple[Any, ...], dict[str, Any]]] = defaultdict(dict)
    for path in sorted(comparison.glob("runs/*/metrics.json")):
        config, metrics = read_json(path.with_name("config.json")), read_json(path)
        condition = config["policy"], config["sensor"]["name"], config["mapping"]["moving"]["detect"]
        where = Path(config["scene"]).name, str(config["start"]), config["seed"]
        rows[*condition[:2], config["people"]["number"], condition[2]][where] = metrics
    print("| policy | sensor | people | mask | runs | coverage, share | " + " | ".join(COLUMNS) + " | ended early |")
    print("|---" * (7 + len(COLUMNS)) + "|")
    for (policy, sensor, people, detects), runs in sorted(rows.items()):
        without = rows.get((policy, sensor, 0, False), {})
        both = [where for where in runs if where in without]
        shares = [100.0 * runs[where]["observable_ratio"] / without[where]["observable_ratio"] for where in both]
        by_scene = scene_means([scene for scene, _, _ in both], shares)
        share = f"{by_scene.mean():.1f} %" if shares and people else ""
        if share and len(by_scene) >= LEAST_SCENES:
            low, high = bootstrap_interval(by_scene)
            share += f" [{low:.1f}, {high:.1f}]"
        mask = "" if not people else "on" if detects else "off"
        early = sum(metrics["stop_reason"] != StopReason.BUDGET for metrics in runs.values())
        cells = [_cell([metrics[key] for metrics in runs.values()], key) for key in COLUMNS.values()]
        print("|", " | ".join([policy, sensor, str(people), mask, str(len(runs)), share, *cells, str(early)]), "|")


def _cell(values: list[Any], key: str) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return ""
    found = WORST.get(key, statistics.mean)(known)
    return str(found) if isinstance(found, int) else f"{found:.2f}"


if __name__ == "__main__":
    run_script(main)
