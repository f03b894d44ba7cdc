import pytest

from anm_mj.bench.tables import markdown

NOISE = "model.wheel_noise=0.02"


def row(scene, f_score, rmse_cm=None, *, pose="slam", sensor="exact", settings=NOISE, start=0):
    """A row of the results table of a run in a scene."""
    known = {"scene": scene, "scene_hash": "0" * 64, "policy": "gvg", "start": start, "seed": 0, "revision": "x"}
    known |= {"reality": "ideal", "preset": "default", "robot": "diff_drive", "drive": "kinematic", "goal": "both"}
    known |= {"pose": pose, "sensor": sensor, "settings": settings, "budget": 100, "budget_by": "", "run": scene}
    known |= {"observed_f_score": f_score, "observable_ratio": 80.0, "position_rmse_cm": rmse_cm}
    return known | {"best_known_auc": None, "stop_reason": "BUDGET"}


def section(rows):
    """Rows of the table of localisation, its heading first."""
    parts = [part for part in markdown(rows, "x").split("\n## ") if part.startswith("Localisation")]
    if not parts:
        return []
    head, _, *lines = [line for line in parts[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in (head, *lines)]


def test_a_run_is_compared_with_its_true_poses():
    rows = []
    for place, scene in enumerate("abcdef"):
        rows += [
            row(scene, 98.0, pose="true", settings=""),
            row(scene, 90.0, pose="true", settings="", sensor="d435i"),
            row(scene, 97.0 - place, 1.0 + place),
            row(scene, 96.0, 2.0, settings=f"{NOISE} policy.tour_depth=2"),
        ]

    head, plain, other = section(rows)

    # Those with true poses have no line of their own.
    assert plain[:3] == [f"gvg (slam {NOISE})", "6", "6"]
    assert plain[3].startswith("94.5 [")
    assert plain[4].startswith("-3.5 [")
    assert plain[head.index("position RMSE [cm]")].startswith("3.50 [")
    assert plain[-1] == "BUDGET 6"
    # Nothing is subtracted from runs that differ in more than their poses.
    assert other[4] == "–"


def test_with_few_scenes_there_is_no_interval():
    rows = [
        row("a", 98.0, pose="true", settings=""),
        row("a", 98.0, pose="true", settings="", start=1),
        row("a", 97.0, 1.0),
        row("a", 95.0, 3.0, start=1),
    ]

    _, line = section(rows)

    assert line[1:5] == ["1", "2", "96.0", "-2.0"]


@pytest.mark.parametrize("pose", ["true", "slam"])
def test_without_errors_there_is_no_table(pose):
    assert section([row("a", 98.0, pose=pose, settings="")]) == []
