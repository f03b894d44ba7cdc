"""Findings on healthy and faulty machines."""

import subprocess
from pathlib import Path

import pytest

from anm_mj.cli import machine_checks
from anm_mj.cli.machine_checks import State


def test_broken_gl_back_end():
    check = machine_checks.check_backend("nonsense")

    assert check.state is State.NOTE
    assert "nonsense" in check.found


def test_broken_torch(monkeypatch: pytest.MonkeyPatch):
    broken = subprocess.CompletedProcess(
        [], 1, "", "Traceback\nImportError: libcudart.so.13: cannot open shared object"
    )
    monkeypatch.setattr(machine_checks, "run_python", lambda *_: broken)

    (check,) = machine_checks.check_torch()

    # A run on the native engine needs no torch.
    assert check.state is State.NOTE
    assert "libcudart" in check.found


@pytest.mark.slow
def test_native_engine_beside_a_gpu(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        machine_checks,
        "ENGINE_PROGRAM",
        "import torch\ntorch.cuda.is_available = lambda: True" + machine_checks.ENGINE_PROGRAM,
    )

    assert machine_checks.check_engine().found.startswith("native (")


def test_missing_native_engine(monkeypatch: pytest.MonkeyPatch):
    without = 'import sys; sys.modules["anm_mj._native"] = None\n'
    monkeypatch.setattr(machine_checks, "ENGINE_PROGRAM", without + machine_checks.ENGINE_PROGRAM)

    check = machine_checks.check_engine()

    assert check.state is State.BAD
    assert "anm_mj._native" in check.found
    assert "Install a C++17 compiler" in check.advice


def test_engine_that_does_not_start(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(machine_checks, "run_python", lambda *_: subprocess.CompletedProcess([], -4, "", ""))

    assert machine_checks.check_engine().state is State.BAD


def test_low_memory():
    check = machine_checks.check_memory(1000)

    assert check.state is State.NOTE
    assert "--preset quick" in check.advice


def test_disk_space(tmp_path: Path):
    assert str(tmp_path) in machine_checks.check_disk(tmp_path).found
