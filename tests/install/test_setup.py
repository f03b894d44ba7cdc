"""The set-up script, with a Python in its place that only writes down what it is asked to do."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = """#!/usr/bin/env bash
echo "$*" >>"$CALLS"
case "$*" in
    *--torch-backend*) exit ${BACKEND_STATUS:-0} ;;
    *--requirement*requirements.txt*) echo "   Downloading numpy (16.1MiB)" >&2 ;;
    *select_backend*) echo egl ;;
    *sysconfig*) echo / ;;
esac
"""


@pytest.fixture
def set_up(tmp_path):
    """A function that sets a small checkout up and returns what it printed and the calls of its Python."""
    for name in ("requirements.txt", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("scripts", "native", ".venv/bin", "bin"):
        (tmp_path / name).mkdir(parents=True)
    shutil.copy(ROOT / "scripts" / "setup.sh", tmp_path / "scripts")
    (tmp_path / "native" / "empty").touch()
    python = tmp_path / ".venv" / "bin" / "python"
    python.write_text(STUB)
    python.chmod(0o755)
    # No test installs a system package, and there is an NVIDIA GPU.
    for name in ("apt-get", "nvidia-smi"):
        (tmp_path / "bin" / name).write_text("#!/bin/sh\n")
        (tmp_path / "bin" / name).chmod(0o755)

    def run(status=0, **environment):
        calls = tmp_path / "calls"
        calls.write_text("")
        path = f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"
        clean = {name: value for name, value in os.environ.items() if name not in ("UV_TORCH_BACKEND", "ANM_MJ_PYTHON")}
        done = subprocess.run(
            ["bash", "scripts/setup.sh"],
            cwd=tmp_path,
            env={**clean, "PATH": path, "CALLS": str(calls), **environment},
            capture_output=True,
            text=True,
        )
        assert done.returncode == status, done.stderr
        return done.stdout + done.stderr, calls.read_text()

    return run


def test_the_usual_build_of_torch(set_up):
    said, calls = set_up()
    assert "--torch-backend" not in calls
    assert "--requirement requirements.txt" in calls
    assert "set-up: downloading numpy (16.1MiB)\n" in said


@pytest.mark.skipif(Path("/proc/driver/nvidia/version").exists(), reason="an NVIDIA GPU is here")
@pytest.mark.parametrize("is_reached", [True, False])
def test_without_a_gpu_the_build_for_cpus_is_taken_where_its_index_can_be_reached(set_up, tmp_path, is_reached):
    if shutil.which("nvidia-smi"):
        pytest.skip("nvidia-smi is here")
    (tmp_path / "bin" / "nvidia-smi").unlink()
    said, calls = set_up(BACKEND_STATUS="0" if is_reached else "1")
    assert ("torch for 'cpu'" in said) == is_reached
    assert ("--requirement requirements.txt" in calls) != is_reached
    assert "could not be fetched" not in said


def test_a_python_that_is_not_there_is_named_and_nothing_is_touched(set_up, tmp_path):
    said, calls = set_up(status=1, ANM_MJ_PYTHON="python3.99")
    assert "set-up: python3.99 is needed, but" in said
    assert "pip install" not in calls
    assert (tmp_path / ".venv" / "bin" / "python").is_file()


def assert_hashed(pins):
    """Every entry has a version and a hash, and none names a place to get it from."""
    entries = re.split(r"\n(?=\S)", "\n" + re.sub(r"(?m)^#.*\n", "", pins))[1:]
    assert len(entries) > 100
    assert [entry for entry in entries if not re.match(r"[a-z0-9._-]+==\S+", entry)] == []
    assert [entry for entry in entries if "--hash=sha256:" not in entry] == []
    assert "://" not in pins


def test_every_pin_has_hashes_that_set_up_requires(set_up):
    assert_hashed((ROOT / "requirements.txt").read_text())
    _, calls = set_up()
    installs = [call for call in calls.splitlines() if "--requirement" in call]
    assert installs
    assert [call for call in installs if "--require-hashes" not in call] == []


def test_a_build_of_torch_without_cuda(set_up, tmp_path):
    _, calls = set_up(UV_TORCH_BACKEND="cpu")
    assert "--torch-backend cpu torch==" in calls
    assert "--require-hashes --requirement .venv/requirements.txt" in calls
    assert "--requirement requirements.txt" not in calls
    pins = (tmp_path / ".venv" / "requirements.txt").read_text()
    for name in ("torch", "triton", "nvidia-nccl-cu13"):
        assert f"\n{name}==" in (ROOT / "requirements.txt").read_text()
        assert f"\n{name}==" not in pins
    assert "\nnumpy==" in pins
    assert_hashed(pins)
    # The next call keeps to it, and has nothing to do.
    assert "pip install" not in set_up()[1]


def test_what_cannot_be_fetched_is_replaced_by_the_usual_build(set_up):
    said, calls = set_up(UV_TORCH_BACKEND="cpu", BACKEND_STATUS="1")
    assert "torch could not be fetched for 'cpu'" in said
    assert "--requirement requirements.txt" in calls
