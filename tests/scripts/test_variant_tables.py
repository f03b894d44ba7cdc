"""The tables of what a sensor or a setting costs, from made-up runs."""

import pytest

from anm_mj.errors import AnmError
from scripts.variant_tables import main
from tests.scripts.test_noise_figure import write


def test_variants_are_paired_with_the_first_one(tmp_path, capsys):
    write(tmp_path, "gvg", None, 90.0)
    write(tmp_path, "gvg", 2, 80.0, steps=100, collisions=1)
    main(tmp_path)
    said = capsys.readouterr().out
    assert "| `gvg` | usual | sensor.noise_scale=2 |" in said
    assert "| somewhere | 90.0 | 80.0 |" in said
    # The area: half of the final value up to the run's end, all of it from there on.
    assert "| sensor.noise_scale=2 | 1 | -10.0 | +21.7 |" in said
    assert "gvg, usual: 0 of 1 runs with a contact; 1 decisions, median 5.0 ms" in said
    assert "1 of 1 runs with a contact; COMPLETE in somewhere, start 0, at 100 with 20.0 % left" in said


def test_another_variant_can_be_the_reference(tmp_path, capsys):
    write(tmp_path, "gvg", 0, 90.0)
    write(tmp_path, "gvg", 2, 80.0)
    main(tmp_path, "sensor.noise_scale=2")
    assert "| sensor.noise_scale=0 | 1 | +10.0 | +5.0 |" in capsys.readouterr().out
    with pytest.raises(AnmError, match="holds no variant 'exact' of gvg"):
        main(tmp_path, "exact")


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(AnmError, match="no finished run"):
        main(tmp_path)
