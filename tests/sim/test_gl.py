"""The choice of a GL back-end, in processes of its own because a process can choose only once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from anm_mj.sim.gl import ProbeError, probe

_SELECT = "from anm_mj.sim.gl import select_backend; print(select_backend())"


def _run(program: str, cache: Path, **env: str) -> subprocess.CompletedProcess[str]:
    base = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"}
    return subprocess.run(
        [sys.executable, "-c", program],
        env={**base, "XDG_CACHE_HOME": str(cache), **env},
        capture_output=True,
        text=True,
        check=False,
    )


def test_selected_back_end_is_cached(tmp_path):
    done = _run(_SELECT, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "renderer_string=''" not in done.stdout
    cached = list((tmp_path / "anm_mj").iterdir())
    assert len(cached) == 1
    cached[0].write_text('{"renderer": "remembered"}')
    assert "remembered" in _run(_SELECT, tmp_path).stdout


def test_choosing_does_not_import_mujoco(tmp_path):
    done = _run(_SELECT + "; import sys; print('mujoco' in sys.modules)", tmp_path)
    assert done.stdout.splitlines()[-1] == "False"


def test_invalid_back_end_of_the_user(tmp_path):
    done = _run(_SELECT, tmp_path, MUJOCO_GL="foo")
    message = done.stderr.splitlines()[-1]
    assert "RenderError: MUJOCO_GL=foo is set" in message
    assert "apt install libegl1" in message
    assert "unset MUJOCO_GL" in message


def test_pictures_can_be_turned_off(tmp_path):
    assert "name='off'" in _run(_SELECT, tmp_path, MUJOCO_GL="off").stdout


def test_no_back_end_works(tmp_path):
    # A device that does not exist spoils egl; a platform that contradicts the back-end spoils the other.
    done = _run(_SELECT, tmp_path, MUJOCO_EGL_DEVICE_ID="99", PYOPENGL_PLATFORM="egl")
    assert "name='off'" in done.stdout
    (message,) = [line for line in done.stderr.splitlines() if "No GL back-end" in line]
    assert "egl:" in message
    assert "osmesa:" in message
    assert "apt install libegl1" in message


def test_a_library_that_is_not_installed_is_said(monkeypatch):
    said = "Traceback\nAttributeError: 'NoneType' object has no attribute 'glGetError'\n"
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: subprocess.CompletedProcess([], 1, "", said))
    with pytest.raises(ProbeError, match="its library is not installed"):
        probe("osmesa")


def test_unwritable_cache(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert _run(_SELECT, blocked).returncode == 0
