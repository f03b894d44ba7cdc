from pathlib import Path

from anm_mj.bench import comparison
from anm_mj.cli.main import main


def test_failed_runs_are_told_on_stderr_as_they_are(tmp_path, monkeypatch, capsys):
    def run_bench(file, out, *, on_run, **options):
        on_run(0, 1, "[/bold] failed")
        return comparison.Comparison(Path(out), [], 0, ["[/bold] failed"])

    monkeypatch.setattr(comparison, "run_bench", run_bench)

    status = main(["bench", "runs.toml", "--out", str(tmp_path)])

    said = capsys.readouterr()
    assert status == 1
    assert said.err == "[/bold] failed\n"
    assert "0/1 [/bold] failed" in said.out
    # Where no run has ended, there are no tables to look at.
    assert "report.html" not in said.out
