import numpy as np

from anm_mj.bench.figures import draw_overview, median_run
from anm_mj.bench.run_result import OBSERVABLE, drawn_variants
from anm_mj.viz.figure_file import KINDS
from tests.bench.test_best_known import RISE, result


def runs_in(scene, policies):
    return [result(name, ratios, scene_name=scene) for name, ratios in policies.items()]


POLICIES = {"gvg": RISE, "my:Own": RISE[:6], "oracle": [value + 2.0 for value in RISE], "random": RISE[:2]}


def test_the_figure_has_the_same_bytes_every_time(tmp_path):
    runs = [run for scene in ("a", "b", "c") for run in runs_in(scene, POLICIES)]
    for name in ("one", "two"):
        draw_overview(tmp_path / f"{name}.png", runs, KINDS)
    for kind in KINDS:
        assert (tmp_path / f"one.{kind}").read_bytes() == (tmp_path / f"two.{kind}").read_bytes()


def test_variants_of_fewer_starts_are_not_drawn_beside_the_others():
    runs = [run for scene in ("a", "b", "c") for run in runs_in(scene, {"gvg": RISE, "random": RISE[:2]})]
    seeds = [result("gvg", RISE, scene_name=scene, seed=k) for scene in ("a", "b", "c") for k in (1, 2)]
    drawn, count = drawn_variants([*runs, *seeds, *runs_in("a", {"anm": RISE})])
    assert sorted(map(id, (run for own in drawn.values() for run in own))) == sorted(map(id, [*runs, *seeds]))
    assert count == 1
    assert drawn_variants([*runs_in("a", {"gvg": RISE}), *runs_in("b", {"anm": RISE})])[1] == 0


def test_variants_are_drawn_over_the_starts_that_all_of_them_have():
    runs = [run for scene in "abcdefghijkl" for run in runs_in(scene, {"gvg": RISE})]
    others = [run for scene in "abcdefghijk" for run in runs_in(scene, {"anm": RISE})]
    drawn, count = drawn_variants([*runs, *others])
    assert count == 0
    where = {name: "".join(run.job.scene_name for run in own) for name, own in drawn.items()}
    assert where == {"gvg": "abcdefghijk", "anm": "abcdefghijk"}


def test_variants_that_have_no_start_in_common_are_drawn(tmp_path):
    apart = [*runs_in("a", {"gvg": RISE}), *runs_in("b", {"anm": RISE})]
    with_both = [*apart, *runs_in("a", {"random": RISE}), *runs_in("b", {"random": RISE})]
    assert {name: len(own) for name, own in drawn_variants(apart)[0].items()} == {"gvg": 1, "anm": 1}
    drawn, count = drawn_variants(with_both)
    assert ({name: len(own) for name, own in drawn.items()}, count) == ({"random": 2}, 2)
    for runs in (apart, with_both):
        assert all(path.is_file() for path in draw_overview(tmp_path / "overview.png", runs))


def test_the_median_run_is_one_of_the_runs():
    runs = [result("gvg", np.array(RISE) * scale, start=k) for k, scale in enumerate((0.5, 1.0, 0.7, 0.9))]
    assert median_run(runs).job.start == 2
    assert median_run(runs[:1]) is runs[0]


def test_the_median_run_is_found_where_nobody_knows_what_is_observable():
    runs = [result("gvg", np.array(RISE) * scale, start=k) for k, scale in enumerate((0.5, 1.0, 0.7, 0.9))]
    for run in runs:
        run.curve[:, OBSERVABLE] = np.nan
    assert median_run(runs).job.start == 2
