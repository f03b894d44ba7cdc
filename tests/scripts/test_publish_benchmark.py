import json
import tarfile

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.bench.run_result import read_results
from anm_mj.errors import AnmError
from scripts.publish_benchmark import BEGIN, END, main, without_scene_tables


def test_tables_pictures_and_rows_take_the_place_of_the_former_ones(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text('scenes = ["home"]\npolicies = ["random", "gvg"]\nstarts = 1\nseeds = [0]\nsteps = 300\n')
    run_bench(file, tmp_path / "small", num_workers=2, function="tests.bench.fake:quick")
    pages = tmp_path / "docs"
    main(tmp_path / "small", pages)
    page = pages / "small.md"
    page.write_text(f"# Own title\n\nSaid by hand.\n\n{BEGIN}\nformer tables\n{END}\n\nSaid below.\n")
    (pages / "small" / "former.png").write_text("")
    (pages / "small" / "start7.tar.xz").write_text("")

    main(tmp_path / "small", pages)

    text = page.read_text()
    assert text.startswith("# Own title\n\nSaid by hand.")
    assert text.endswith("Said below.\n")
    assert "former" not in text
    assert (tmp_path / "small" / "table.md").read_text().splitlines()[2] in text
    shown = {line.partition("](")[2][:-1] for line in text.splitlines() if line.startswith("![")}
    assert shown == {f"small/{path.name}" for path in (pages / "small").glob("*.png")}
    assert "[results.csv](small/results.csv)" in text
    assert "[start0.tar.xz](small/start0.tar.xz)" in text
    assert [path.name for path in (pages / "small").glob("*.xz")] == ["start0.tar.xz"]
    assert (pages / "small" / "results.csv").read_bytes() == (tmp_path / "small" / "results.csv").read_bytes()
    assert {"small/curves_home.png", "small/scene_home.png"} <= shown


def test_unpacked_runs_give_the_tables_and_pictures_again_beside_another_policy(tmp_path):
    policies = '["random", "gvg"]'
    file = tmp_path / "small.toml"
    file.write_text(f'scenes = ["home"]\npolicies = {policies}\nstarts = 2\nseeds = [0]\nsteps = 300\n')
    run_bench(file, tmp_path / "small", num_workers=2, function="tests.bench.fake:quick")
    for run in (tmp_path / "small" / "runs").iterdir():
        manifest = json.loads((run / "manifest.json").read_text())
        (run / "manifest.json").write_text(json.dumps({**manifest, "scene": str(tmp_path), "command": [str(tmp_path)]}))
    main(tmp_path / "small", tmp_path / "docs")

    for packed in sorted((tmp_path / "docs" / "small").glob("*.tar.xz")):
        with tarfile.open(packed) as archive:
            archive.extractall(tmp_path / "again", filter="data")
    made = run_bench(file, tmp_path / "again", num_workers=2, function="tests.bench.fake:quick", policies=["frontier"])

    assert (len(made.jobs), made.skipped, made.failures) == (6, 4, [])
    others = [result for result in read_results(tmp_path / "again") if result.job.policy != "frontier"]
    for run, other in zip(read_results(tmp_path / "small"), others, strict=True):
        assert (run.job, run.metrics, run.revision) == (other.job, other.metrics, other.revision)
        assert (run.curve == other.curve).all()
        assert (run.trajectory_xy_m() == other.trajectory_xy_m()).all()
        assert str(tmp_path) not in (other.folder / "manifest.json").read_text()


def test_a_folder_without_tables_or_rows_and_a_page_without_marks_are_refused(tmp_path):
    with pytest.raises(AnmError, match=r"cannot be published .*table\.md"):
        main(tmp_path, tmp_path / "docs")
    (tmp_path / "table.md").write_text("")
    with pytest.raises(AnmError, match=r"cannot be published .*results\.csv"):
        main(tmp_path, tmp_path / "docs")
    assert not (tmp_path / "docs").exists()
    (tmp_path / "results.csv").write_text("")
    (tmp_path / f"{tmp_path.name}.md").write_text("no marks")
    with pytest.raises(AnmError, match="holds no marks"):
        main(tmp_path, tmp_path)


def test_tables_of_single_scenes_stay_where_there_is_one_scene_only():
    means = ["## Mean over 2 scenes, 4 runs of each policy", "", "| gvg | 90.0 |", ""]
    one, two = (["## " + name, "", "Scene hash 0123.", "", "| gvg | 91.0 |", ""] for name in ("home", "flat"))

    assert without_scene_tables(means + one) == means + one
    assert without_scene_tables(means + one + two) == means + one[:4] + two[:4]
