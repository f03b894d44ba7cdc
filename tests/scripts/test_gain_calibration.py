import json

import pytest

from anm_mj.errors import AnmError
from scripts.gain_calibration import main


def write_run(folder, scene, outcomes):
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text(json.dumps({"scene": scene}))
    names = "kind", "expected_m2", "realised_m2", "judged"
    lines = [{"step": 0, "closed": None}, *({"closed": dict(zip(names, o, strict=True))} for o in outcomes)]
    (folder / "plans.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_expected_and_realised_gain_are_summed_up_by_kind_and_scene(tmp_path, capsys):
    write_run(tmp_path / "run", "flat", [("opening", 10.0, 1.0, True), ("doorway", 5.0, 0.0, False)])
    write_run(tmp_path / "bench" / "runs" / "a", "shop", [("opening", 10.0, 3.0, True), ("doorway", 4.0, 4.0, True)])

    main((tmp_path / "run", tmp_path / "bench"))

    rows = capsys.readouterr().out.splitlines()[2:]
    assert rows == [
        "| kind doorway | 1 | 1 | 4.0 | 4.0 | 1.00 |",
        "| kind opening | 2 | 0 | 20.0 | 4.0 | 0.20 |",
        "| scene flat | 1 | 1 | 10.0 | 1.0 | 0.10 |",
        "| scene shop | 2 | 0 | 14.0 | 7.0 | 0.50 |",
        "| all | 3 | 1 | 24.0 | 8.0 | 0.33 |",
    ]


def test_runs_without_targets_are_named(tmp_path):
    with pytest.raises(AnmError, match=r"No run in .*empty has closed a target"):
        main((tmp_path / "empty",))
