import json
from pathlib import Path

import pytest

from anm_mj.errors import AnmError
from scripts import gain_calibration
from scripts.gain_calibration import main
from tests.scene.small import make_small_scene


def write_run(folder, scene, outcomes):
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text(json.dumps({"scene": scene}))
    names = "kind", "promised_m2", "expected_m2", "realised_m2", "judged"
    lines = [{"step": 0, "closed": None}, *({"closed": dict(zip(names, o, strict=True))} for o in outcomes)]
    (folder / "plans.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_expected_and_realised_gain_are_summed_up_by_kind_and_scene(tmp_path, capsys):
    write_run(tmp_path / "run", "flat", [("opening", 12.0, 10.0, 1.0, True), ("doorway", 5.0, 2.0, 1.0, False)])
    write_run(
        tmp_path / "bench" / "runs" / "a",
        "shop",
        [("opening", 10.0, 10.0, 3.0, True), ("doorway", 4.0, 4.0, 4.0, True)],
    )

    main((tmp_path / "run", tmp_path / "bench"))

    rows = capsys.readouterr().out.splitlines()[2:]
    assert rows == [
        "| kind doorway | 2 | 1 | 9.0 | 6.0 | 5.0 | 0.83 | 1.00 |",
        "| kind opening | 2 | 0 | 22.0 | 20.0 | 4.0 | 0.20 | 0.18 |",
        "| scene flat | 2 | 1 | 17.0 | 12.0 | 2.0 | 0.17 | 0.08 |",
        "| scene shop | 2 | 0 | 14.0 | 14.0 | 7.0 | 0.50 | 0.50 |",
        "| all | 4 | 1 | 31.0 | 26.0 | 9.0 | 0.35 | 0.31 |",
    ]


def test_runs_without_targets_are_named(tmp_path):
    with pytest.raises(AnmError, match=r"No run in .*empty has closed a target"):
        main((tmp_path / "empty",))
    with pytest.raises(AnmError, match=r"No run in nothing; name run folders, or scenes by --scenes"):
        main()


def test_scenes_are_run(tmp_path, capsys, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(gain_calibration.__file__).parent))
    make_small_scene(tmp_path)

    main(scenes=(str(tmp_path),), steps=150)

    *_, of_all = capsys.readouterr().out.splitlines()
    targets, _, promised, expected, realised, _, _ = of_all.removeprefix("| all | ").removesuffix(" |").split(" | ")
    assert int(targets) >= 1
    assert 0.0 < float(expected) <= float(promised)
    assert float(realised) > 0.0
