"""Findings of the doctor on healthy and faulty machines."""

import io
import subprocess
from importlib import metadata
from pathlib import Path

import pytest
from rich.console import Console

from anm_mj.cli import doctor
from anm_mj.cli.doctor import Check, State
from anm_mj.cli.doctor_report import report


def _printed(checks: list[Check]) -> str:
    file = io.StringIO()
    doctor.render(checks, Console(file=file, width=200))
    return file.getvalue()


def test_this_machine_is_healthy(capsys: pytest.CaptureFixture[str]):
    assert doctor.main() == 0

    printed = capsys.readouterr().out
    for name in (
        "Python",
        "torch",
        "CUDA",
        "map engine",
        "GL egl",
        "GL osmesa",
        "ffmpeg",
        "live view",
        "memory",
        "disk",
    ):
        assert name in printed
    assert "A run will use" in printed


def test_a_report_holds_versions_and_no_folders():
    checks = [
        Check("disk", State.GOOD, "55.8 GiB free in /home/me/projects/anm_mj"),
        Check(
            "GL egl", State.NOTE, "does not work: /opt/lib/libEGL.so: no | file", "See http://127.0.0.1:7000/static/"
        ),
    ]
    text = report(checks)
    assert "/home" not in text
    assert "/opt" not in text
    assert "…/anm_mj" in text
    assert "…/libEGL.so: no \\| file" in text
    assert "http://127.0.0.1:7000/static/" in text
    assert f"numpy {metadata.version('numpy')}" in text


def test_old_python():
    check = doctor.check_python((3, 10))

    assert check.state is State.BAD
    assert "3.11" in check.advice


def test_broken_gl_back_end():
    check = doctor.check_backend("nonsense")

    assert check.state is State.NOTE
    assert "nonsense" in check.found


def test_broken_torch(monkeypatch: pytest.MonkeyPatch):
    broken = subprocess.CompletedProcess(
        [], 1, "", "Traceback\nImportError: libcudart.so.13: cannot open shared object"
    )
    monkeypatch.setattr(doctor, "run_python", lambda *_: broken)

    (check,) = doctor.check_torch()

    assert check.state is State.BAD
    assert "libcudart" in check.found


@pytest.mark.slow
def test_native_engine_beside_a_gpu(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        doctor, "ENGINE_PROGRAM", "import torch\ntorch.cuda.is_available = lambda: True" + doctor.ENGINE_PROGRAM
    )

    assert doctor.check_engine().found.startswith("native (")


def test_missing_native_engine(monkeypatch: pytest.MonkeyPatch):
    without = 'import sys; sys.modules["anm_mj._native"] = None\n'
    monkeypatch.setattr(doctor, "ENGINE_PROGRAM", without + doctor.ENGINE_PROGRAM)

    check = doctor.check_engine()

    assert check.state is State.BAD
    assert "The compiled part of anm-mj is missing" in check.found
    assert "Install a C++17 compiler" in check.advice


def test_engine_that_does_not_start(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "run_python", lambda *_: subprocess.CompletedProcess([], -4, "", ""))

    assert doctor.check_engine().state is State.BAD


def test_low_memory():
    check = doctor.check_memory(1000)

    assert check.state is State.NOTE
    assert "--preset quick" in check.advice


def test_disk_space(tmp_path: Path):
    assert str(tmp_path) in doctor.check_disk(tmp_path).found


def test_summary_names_faults():
    printed = _printed([Check("torch", State.BAD, "not installed", "Install it."), Check("disk", State.GOOD, "9 GiB")])

    assert "Install it." in printed
    assert "to fix first: torch" in printed


def test_exit_status_of_a_fault(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "diagnose", lambda: [Check("Python", State.BAD, "3.9")])

    assert doctor.main() == 1
