import re

import pytest

from anm_mj.bench.comparison import run_bench
from anm_mj.errors import AnmError
from scripts.compare_policies import main


@pytest.fixture
def comparison(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text('scenes = ["home"]\npolicies = ["random", "gvg"]\nstarts = 2\nseeds = [0]\nsteps = 300\n')
    run_bench(file, tmp_path / "out", num_workers=2, function="tests.bench.fake:quick")
    return tmp_path / "out"


def test_two_policies_are_compared_run_by_run(comparison, capsys):
    main(comparison, "gvg", "random")

    lines = capsys.readouterr().out.splitlines()

    assert lines[0] == "`gvg` / `random`"
    assert [line.split("|")[1:3] for line in lines[4:6]] == [[" home, 300 ", " 0, 0 "], [" home, 300 ", " 1, 0 "]]
    assert lines[-3].startswith("Of 2 runs, gvg has the higher final ratio in ")
    assert re.fullmatch(r"Steps to 90 % of the other's final: \d+ % on average; 2 of 2 runs arrive.", lines[-2])
    assert lines[-1] == "2 decisions of gvg: median, 90th, 99th percentile 12.0, 12.0, 12.0 ms."


def test_policies_without_common_runs_are_refused(comparison):
    with pytest.raises(AnmError, match="no runs that both gvg and upen"):
        main(comparison, "gvg", "upen")
