"""The wheel, outside of the checkout: robots and scenes come with it; without a compiler there is none."""

import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CALL_S = 800
"""Longest time of one call; a build of all kernels on a busy machine takes minutes [s]."""
QUICK = ("--set", "image_px=32", "--set", "mapping.schedule.first_iterations=5")
EPISODE = """
import gymnasium
import anm_mj.environments

env = gymnasium.make("AnmMj/Explore-v0", scene="room", image_px=32, num_steps=2)
env.reset(seed=0)
print(anm_mj.__file__, *env.step(1)[1:4])
env.close()
"""


def uv(*words, **environment):
    """Call uv."""
    subprocess.run(
        [sys.executable, "-m", "uv", *map(str, words), "--offline"],
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
        timeout=CALL_S,
    )


def build(folder, *options, **environment):
    """The wheel of the checkout, built into a folder."""
    where = ("--out-dir", folder, "--python", sys.executable, f"-Cbuild-dir={folder / 'build'}")
    uv("build", "--wheel", "--no-build-isolation", *where, *options, ROOT, **environment)
    (wheel,) = folder.glob("*.whl")
    return wheel


def install(wheel, folder):
    """A new environment with the wheel; everything that it needs is borrowed from the present one."""
    uv("venv", "--python", sys.executable, folder)
    (packages,) = folder.glob("lib/python*/site-packages")
    # The present one's own .pth files are not read, the editable installation's among them; pin's is needed.
    (packages / "lent.pth").write_text(f"{sysconfig.get_path('purelib')}\nimport cmeel_pth\n")
    python = folder / "bin" / "python"
    uv("pip", "install", "--no-deps", "--no-index", "--python", python, wheel)
    return python


def call(python, place, *words):
    """Run a program of the new environment in a folder of its own."""
    done = subprocess.run(
        [str(python.parent / words[0]), *words[1:]],
        cwd=place,
        env={**os.environ, "ANM_MJ_SCENES": str(place / "scenes"), "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        timeout=CALL_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_without_a_compiler(tmp_path):
    with pytest.raises(subprocess.CalledProcessError) as failed:
        build(tmp_path / "wheel", CXX=str(tmp_path / "no-compiler"))
    assert "install a C++17 compiler (apt install g++) and call again." in failed.value.stderr
    assert not list((tmp_path / "wheel").glob("*.whl"))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_with_the_native_engine(tmp_path):
    wheel = build(tmp_path / "wheel")
    assert wheel.name.endswith("_x86_64.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "anm_mj/py.typed" in names
    assert "anm_mj/data/models/diff_drive/diff_drive.xml" in names
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"anm_mj"}
    python = install(wheel, tmp_path / "venv")
    call(python, tmp_path, "anm-mj", "explore", "home", "--steps", "5", "--out", "run", *QUICK)
    made = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert made["engine"].startswith("native-")
    assert made["git"] is None
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["steps"] == 5
    where, *_ = call(python, tmp_path, "python", "-c", EPISODE).split()
    assert Path(where).is_relative_to(tmp_path / "venv")
    settings = [f"{name}={value}" for name, value in (("image_px", 32), ("mapping.schedule.first_iterations", 5))]
    comparison = f'scenes = ["room"]\npolicies = ["random", "gvg"]\nsteps = 5\nsettings = {json.dumps(settings)}\n'
    (tmp_path / "comparison.toml").write_text(comparison)
    assert "2 runs" in call(python, tmp_path, "anm-mj", "bench", "comparison.toml")
    # Nothing was written where the package is installed, which others may not write to.
    installed = [path for path in Path(where).parent.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert len(installed) == len([name for name in names if name.startswith("anm_mj/") and not name.endswith("/")])


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_source_distribution_holds_documentation_and_tests(tmp_path):
    uv("build", "--sdist", "--no-build-isolation", "--python", sys.executable, "--out-dir", tmp_path, ROOT)
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"docs/start.md", "docs/film.gif", "tests/install/test_wheel.py", "native/CMakeLists.txt"} <= names
