import pytest

from anm_mj.bench.suite import suite_file
from anm_mj.bench.sweep import read_sweeps
from anm_mj.errors import BenchError


def test_the_scenes_of_a_suite_are_known_by_their_names(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text('suite = "tune"\nscenes = ["tune_1"]\npolicies = ["gvg"]\n')

    sweeps, provided = read_sweeps(file)

    assert [sweep.scenes for sweep in sweeps] == [["tune_1"]]
    assert provided == read_sweeps(suite_file("tune"))[1]
    file.write_text('suite = "large_one"\nscenes = ["home"]\npolicies = ["gvg"]\n')
    with pytest.raises(BenchError, match="no suite 'large_one'"):
        read_sweeps(file)
