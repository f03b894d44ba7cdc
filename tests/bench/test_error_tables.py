import pytest

from anm_mj.bench.error_tables import reality_table
from anm_mj.bench.job import variant
from anm_mj.sim.simulation_config import REALITIES

_IDEAL = {"preset": "default", "robot": "diff_drive", "goal": "both", "reality": "ideal"}
_IDEAL |= {"drive": "kinematic", "pose": "true", "sensor": "exact", "settings": ""}
_REAL = {**_IDEAL, **REALITIES["real"].options, "reality": "real", "settings": " ".join(REALITIES["real"].texts)}


def row(scene, ratio, stop="BUDGET", *, policy="gvg", world=_IDEAL, f_score=98.0, start=0, **more):
    """A row of the results table of a run in a scene."""
    known = {"scene": scene, "policy": policy, "start": start, "seed": 0, "budget": 100, **world}
    known |= {"observable_ratio": ratio, "observed_f_score": f_score, "stop_reason": stop, "collisions": 0, "hz": 20.0}
    known |= {"people_contacts": None, "lost_percent": None, **more}
    return known | {"variant": variant(known)}


def lines(rows):
    text = reality_table(rows, "")
    found = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    return [dict(zip(found[0], line, strict=True)) for line in found[2:]]


def cells(line, *names):
    return [line[name] for name in names]


def test_every_error_is_held_against_the_ideal_run():
    camera = {**_IDEAL, "sensor": "d435i"}
    rows = []
    for place, scene in enumerate("abcdef"):
        rows += [row(scene, 80.0), row(scene, 72.0, world=camera)]
        rows.append(row(scene, 76.0, world=_REAL, f_score=93.1, people_contacts=place == 0, lost_percent=float(place)))
    # Another setting than those of the world, without its ideal run.
    rows.append(row("a", 10.0, world={**_IDEAL, "settings": "policy.tour_depth=2", "sensor": "d435i"}))

    ideal, noisy, real = lines(rows)

    assert cells(ideal, "policy", "scenes", "runs", "contacts", "runs lost", "false ends") == [
        "gvg", "6", "6", "–", "0", "0",
    ]  # fmt: skip
    assert cells(noisy, "policy", "final ratio, observable [%]") == ["gvg (d435i)", "72.0"]
    assert cells(real, "policy", "contacts", "frames lost [%]", "ended by") == ["gvg (real)", "1", "2.5", "BUDGET 6"]
    text = reality_table(rows, "area")
    assert "| 76.0 | 95.0 [95.0, 95.0] | 93.1 | 95.0 [95.0, 95.0] |" in text
    assert text.startswith("## What errors cost, budget by area")


@pytest.mark.parametrize(
    ("ratio", "stop", "false"),
    [(70.0, "COMPLETE", 1), (79.0, "COMPLETE", 0), (70.0, "BUDGET", 0), (30.0, "LOST", 1), (20.0, "STUCK", 1)],
)
def test_an_end_is_false_where_much_was_left_that_the_ideal_run_saw(ratio, stop, false):
    _, real = lines([row("a", 80.0), row("a", ratio, stop, world=_REAL)])
    assert cells(real, "runs lost", "false ends") == [str(int(stop == "LOST")), str(false)]


def test_only_runs_from_the_same_start_are_held_against_each_other():
    _, real = lines([row("a", 80.0, start=1), row("a", 70.0, "COMPLETE", world=_REAL)])
    assert cells(real, "of the ideal run's [%]", "false ends") == ["– (0/1)", "0 (0/1)"]


def test_a_real_run_that_saw_or_mapped_nothing_counts_with_nothing():
    lines_of_both = [row("a", 80.0), row("a", 0.0, "COMPLETE", world=_REAL, f_score=0.0)]
    _, real = lines([*lines_of_both, row("b", 60.0, world=_REAL)])
    assert cells(real, "runs", "false ends") == ["2", "1 (1/2)"]
    assert "| 0.0 (1/2) | 49.0 | 0.0 (1/2) |" in reality_table([*lines_of_both, row("b", 60.0, world=_REAL)], "")


def test_without_a_real_run_there_is_no_table():
    assert reality_table([row("a", 80.0), row("a", 70.0, world={**_IDEAL, "sensor": "d435i"})], "") == ""
