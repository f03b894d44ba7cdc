from dataclasses import replace

import numpy as np
from PIL import Image

from anm_mj.bench.figures import COLOURS, LINES, MARKS, draw_curves
from anm_mj.bench.job import Job
from anm_mj.bench.run_result import Result
from anm_mj.viz.figure_file import KINDS


def results(num_policies, num_runs):
    steps = np.arange(0, 201, 10)
    found = []
    for k in range(num_policies):
        for run in range(num_runs):
            ratio = 90.0 * (1.0 - np.exp(-steps * 0.01 * (1 + k + 0.8 * run)))
            job = Job("", "room", "0" * 64, f"policy-{k}", run, (0.0, 0.0, 0.0), 0, 200)
            found.append(
                Result(job, {}, "x", np.stack([steps, ratio, 100.0 - ratio, ratio + 5.0, 0.04 * steps], axis=1))
            )
    return found


def test_every_variant_has_a_style_of_its_own_without_colour():
    count = len(LINES) * len(MARKS)
    assert len({(LINES[k % len(LINES)], MARKS[k % len(MARKS)]) for k in range(count)}) == count >= 50
    assert len(set(COLOURS)) == len(COLOURS)


def test_curves_have_the_same_bytes_every_time(tmp_path):
    for name in ("a", "b"):
        draw_curves(tmp_path / f"{name}.png", "room", results(3, 3), KINDS)
    for kind in KINDS:
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_a_band_has_an_edge(tmp_path):
    """What overlaps stays apart, also in grey: from the middle of a band outwards there is a line before the white."""
    draw_curves(tmp_path / "one.png", "room", results(1, 2))
    with Image.open(tmp_path / "one.png") as picture:
        grey = np.asarray(picture.convert("L")).astype(int)
    rows, cols = grey.shape
    column = grey[int(0.1 * rows) : int(0.85 * rows), int(0.35 * cols)]
    dark = np.flatnonzero(column < 210)
    lines = np.split(dark, np.flatnonzero(np.diff(dark) > 3) + 1)
    # Its two edges and the mean.
    assert len(lines) == 3


def test_long_names_leave_room_for_the_curves(tmp_path, recwarn):
    settings = tuple(f"mapping.schedule.something_number_{k}=0" for k in range(12))
    runs = [replace(run, job=replace(run.job, settings=settings)) for run in results(3, 1)]
    draw_curves(tmp_path / "one.png", "room", runs)
    assert not [str(warning.message) for warning in recwarn if "layout" in str(warning.message)]


def test_variants_of_fewer_starts_are_left_out(tmp_path):
    runs = results(2, 3)
    few = replace(runs[0], job=replace(runs[0].job, policy="another"))
    draw_curves(tmp_path / "with.svg", "room", [*runs, few], ("svg",))
    draw_curves(tmp_path / "without.svg", "room", runs, ("svg",))
    lines = [(tmp_path / f"{name}.svg").read_text().count('id="line2d_') for name in ("with", "without")]
    assert lines[0] == lines[1]
