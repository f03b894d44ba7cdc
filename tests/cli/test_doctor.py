"""What the doctor prints, and its exit status."""

import io
import subprocess
import sys
from importlib import metadata

import pytest
from rich.console import Console

from anm_mj.cli import machine_checks
from anm_mj.cli.doctor import doctor, print_checks, report_text
from anm_mj.cli.machine_checks import Check, State


def _printed(checks: list[Check]) -> str:
    file = io.StringIO()
    print_checks(checks, Console(file=file, width=200))
    return file.getvalue()


def test_the_report_needs_no_library_that_may_be_broken():
    program = (
        "import sys; sys.modules |= dict.fromkeys(('scipy', 'torch', 'mujoco', 'matplotlib'))\n"
        "from anm_mj.cli.doctor import report_text\n"
        "from anm_mj.cli.machine_checks import Check, State\n"
        "print(report_text([Check('scipy', State.BAD, 'cannot be | imported')]))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "| scipy | wrong | cannot be \\| imported |" in done.stdout, done.stderr


def test_this_machine_is_healthy(capsys: pytest.CaptureFixture[str]):
    assert doctor().status == 0

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
    text = report_text(checks)
    assert "/home" not in text
    assert "/opt" not in text
    assert "…/anm_mj" in text
    assert "…/libEGL.so: no \\| file" in text
    assert "http://127.0.0.1:7000/static/" in text
    assert f"numpy {metadata.version('numpy')}" in text


def test_a_report_names_neither_the_working_folder_nor_the_user(tmp_path, monkeypatch):
    home, work = tmp_path / "Anna Smith", tmp_path / "Anna Smith" / "secret project"
    work.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(work)
    text = report_text([Check("disk", State.GOOD, f"9 GiB free in {work}", f"Delete {home}/old maps.")])
    assert not [word for word in ("Anna", "Smith", "secret", "project") if word in text]
    assert "free in . Delete" in text


def test_summary_names_faults():
    printed = _printed([Check("torch", State.BAD, "not installed", "Install it."), Check("disk", State.GOOD, "9 GiB")])

    assert "Install it." in printed
    assert "to fix first: torch" in printed


def test_exit_status_of_a_fault(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(machine_checks, "diagnose", lambda: [Check("Python", State.BAD, "3.9")])

    assert doctor().status == 1


@pytest.mark.parametrize(
    ("devices", "drawing", "visible", "state", "words"),
    [
        ([None], 0, None, State.GOOD, "0 (no CUDA) draws, the only one"),
        ([1, 0, None], 0, None, State.GOOD, "0 (CUDA 1) draws, of 0 (CUDA 1), 1 (CUDA 0), 2 (no CUDA)"),
        ([1, 0, None], 0, "1,0", State.GOOD, "MUJOCO_EGL_DEVICE_ID chooses another"),
        ([1, 0, None], 0, "0", State.NOTE, "MUJOCO_EGL_DEVICE_ID=1 does"),
        ([1, 0, None], 0, "GPU-5e4f", State.GOOD, "0 (CUDA 1) draws"),
        ([1, 0], 0, "7", State.GOOD, "0 (CUDA 1) draws"),
    ],
)
def test_the_egl_device_beside_cuda_visible_devices(monkeypatch, devices, drawing, visible, state, words):
    monkeypatch.setenv("MUJOCO_GL", "egl")
    (check,) = machine_checks.check_egl_devices(devices, drawing, visible)
    assert check.state is state
    assert words in f"{check.found} {check.advice}"
    monkeypatch.setenv("MUJOCO_GL", "off")
    assert machine_checks.check_egl_devices(devices, drawing, visible) == []


def test_egl_devices_of_this_machine():
    devices, drawing = machine_checks.egl_devices()
    assert drawing is None or drawing in range(len(devices))
