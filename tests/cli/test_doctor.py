"""What the doctor finds on a healthy machine and on sick ones."""

import io
import subprocess
from pathlib import Path

import pytest
from rich.console import Console

from anm_mj.cli import doctor
from anm_mj.cli.doctor import Check, State


def _printed(checks: list[Check]) -> str:
    file = io.StringIO()
    doctor.render(checks, Console(file=file, width=200))
    return file.getvalue()


def test_a_machine_that_runs_these_tests_is_healthy(capsys: pytest.CaptureFixture[str]):
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


def test_an_old_python_is_wrong():
    check = doctor.check_python((3, 10))

    assert check.state is State.BAD
    assert "3.11" in check.advice


def test_a_back_end_that_does_not_work_is_a_note_with_its_error():
    check = doctor.check_backend("nonsense")

    assert check.state is State.NOTE
    assert "nonsense" in check.found


def test_a_broken_torch_is_wrong(monkeypatch: pytest.MonkeyPatch):
    broken = subprocess.CompletedProcess(
        [], 1, "", "Traceback\nImportError: libcudart.so.13: cannot open shared object"
    )
    monkeypatch.setattr(doctor, "_try", lambda *_: broken)

    (check,) = doctor.check_torch()

    assert check.state is State.BAD
    assert "libcudart" in check.found


def test_a_missing_native_engine_is_a_note_that_says_why(monkeypatch: pytest.MonkeyPatch):
    found = '["torch", "cpu", "the native engine is missing: it was not built", "native"]'
    monkeypatch.setattr(doctor, "_try", lambda *_: subprocess.CompletedProcess([], 0, found, ""))

    check = doctor.check_engine()

    assert check.state is State.NOTE
    assert check.found == "torch on the CPU, slower than native would be"
    assert "it was not built" in check.advice


# What the doctor runs in a process of its own, on a machine that differs in what stands before it.
NATIVE_WITHOUT_COMPILER = """
import shutil, sys, torch
torch.cuda.is_available = lambda: False
shutil.which = lambda name, **rest: None
sys.modules["anm_mj.mapping.backends._native"] = None
"""


def test_beside_a_gpu_the_map_is_trained_by_the_native_engine(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        doctor, "_TRY_ENGINE", "import torch\ntorch.cuda.is_available = lambda: True" + doctor._TRY_ENGINE
    )

    assert doctor.check_engine().found.startswith("native (")


def test_a_native_engine_that_cannot_be_built_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "_TRY_ENGINE", NATIVE_WITHOUT_COMPILER + doctor._TRY_ENGINE)

    check = doctor.check_engine()

    assert check.found == "torch on the CPU, slower than native would be"
    assert "it was not built; install a C++17 compiler (apt install g++) and run make setup" in check.advice


def test_an_engine_that_does_not_start_is_a_note_with_advice(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "_try", lambda *_: subprocess.CompletedProcess([], -4, "", ""))

    assert "mapping.engine=torch" in doctor.check_engine().advice


def test_little_memory_is_a_note_with_advice():
    check = doctor.check_memory(1000)

    assert check.state is State.NOTE
    assert "--preset quick" in check.advice


def test_room_on_the_disk_is_told(tmp_path: Path):
    assert str(tmp_path) in doctor.check_disk(tmp_path).found


def test_what_is_wrong_is_named_at_the_end():
    printed = _printed([Check("torch", State.BAD, "not installed", "Install it."), Check("disk", State.GOOD, "9 GiB")])

    assert "Install it." in printed
    assert "mend torch first" in printed


def test_any_fault_makes_the_exit_status_1(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(doctor, "diagnose", lambda: [Check("Python", State.BAD, "3.9")])

    assert doctor.main() == 1
