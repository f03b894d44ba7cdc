"""The table of runs whose poses may err: by how much they do, and what is lost against true poses."""

import numpy as np

from anm_mj.bench.job import CONDITIONS
from anm_mj.bench.markdown_table import Rows, ended_by, heading, numbers, split_by, table, with_interval
from anm_mj.bench.run_result import split_settings
from anm_mj.bench.statistics import LEAST_SCENES, TASK, paired_difference

RMSE = "position_rmse_cm"
COLUMNS = (
    ("observed_f_score", "mesh F-score, observed [%]", 1),
    ("observable_ratio", "final ratio, observable [%]", 1),
    (RMSE, "position RMSE [cm]", 2),
    ("ate_rmse_cm", "ATE RMSE [cm]", 2),
    ("final_position_error_cm", "position at the end [cm]", 2),
    ("final_heading_error_deg", "heading at the end [deg]", 2),
    ("lost_percent", "frames lost [%]", 1),
    ("unmapped_percent", "frames not mapped [%]", 1),
    ("loops_closed", "loops closed", 1),
)
"""Column of the results table, heading, decimals."""
PAIRED = 2
"""So many of them have runs with true poses, too."""
OF_THE_POSE = ("model.wheel_noise=", "sensor.odometry_", "localisation.")
"""What settings begin with that change nothing where poses are true."""
OTHER_SETTINGS = "other_settings"
SAME = (*TASK, "policy", *(key for key in CONDITIONS if key != "pose"), OTHER_SETTINGS)
"""Columns in which a run agrees with the one with true poses that it is compared with."""
_TEXT = f"""\
Runs whose poses may err, with their errors; minus the runs with true poses that are the same otherwise, where there are
any. Means of each scene's mean, with the 95 % interval of a bootstrap over scenes ({LEAST_SCENES} at least)."""


def localisation_table(rows: Rows, by: str) -> str:
    """A row for each variant whose poses may err; empty without one. ``rows`` are those of the results table, with
    their ``variant``; ``by`` is the name of the budget.
    """
    rows = [{**row, OTHER_SETTINGS: _other_settings(row["settings"])} for row in rows]
    exact = [row for row in rows if row["pose"] == "true"]
    lines = []
    for name, own in split_by([row for row in rows if row.get(RMSE) is not None], "variant").items():
        scenes = split_by(own, "scene").values()
        cells = [name, str(len(scenes)), str(len(own))]
        for place, (column, _, decimals) in enumerate(COLUMNS):
            per_scene = [found.mean() for here in scenes if len(found := numbers(here, column))]
            cells.append(with_interval(np.array(per_scene), f".{decimals}f"))
            if place < PAIRED:
                pair = paired_difference(own, exact, column, SAME)
                cells.append(with_interval(np.zeros(0) if pair is None else pair.by_scene, f"+.{decimals}f"))
        lines.append([*cells, ended_by(own)])
    if not lines:
        return ""
    headings = ["policy", "scenes", "runs"]
    for place, (_, text, _) in enumerate(COLUMNS):
        headings += [text, "minus that with true poses [points]"] if place < PAIRED else [text]
    headings.append("ended by")
    text = table(headings, lines, text_columns=(0, len(headings) - 1))
    return "\n\n".join([heading("Localisation", by), _TEXT, text])


def _other_settings(text: str) -> str:
    """Settings, as the results table has them, without those of the pose."""
    robot, others = split_settings(text)
    return " ".join(one for one in (*robot, *others) if not one.startswith(OF_THE_POSE))
