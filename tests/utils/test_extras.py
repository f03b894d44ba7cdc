"""A package that is not installed is named with the command that installs it."""

import platform
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from anm_mj.cli.main import main
from anm_mj.utils.extras import EXTRAS, install, missing_package

ROOT = Path(__file__).resolve().parents[2]

RUN_WITHOUT_EXTRAS = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None
from anm_mj.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def run_without_extras(*words):
    program = RUN_WITHOUT_EXTRAS.format(blocked=[*EXTRAS, "triton"])
    return subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True)


def test_every_extra_that_is_named_exists():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(EXTRAS.values()) <= set(declared)


@pytest.mark.parametrize(
    ("processor", "system", "version", "has_wheel"),
    [
        ("x86_64", "linux", (3, 13), True),
        ("aarch64", "linux", (3, 11), False),
        ("arm64", "darwin", (3, 12), True),
        ("x86_64", "linux", (3, 14), False),
    ],
)
def test_a_package_without_a_wheel_is_not_promised_by_its_extra(monkeypatch, processor, system, version, has_wheel):
    monkeypatch.setattr(platform, "machine", lambda: processor)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(sys, "version_info", version)
    advice = install("cyclonedds")
    assert ("anm-mj[ros]" in advice, "CYCLONEDDS_HOME" in advice) == (has_wheel, not has_wheel)
    marker = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["ros"][1]
    assert "python_version < '3.14' and (platform_machine == 'x86_64' or sys_platform == 'darwin')" in marker


def test_a_module_of_no_extra_has_no_advice():
    assert missing_package(ModuleNotFoundError("no module", name="nothing.at_all")) is None


@pytest.mark.parametrize("choice", [("--set", "mapping.engine=torch"), ("--policy", "anm")])
def test_what_runs_on_torch_names_torch(tmp_path, choice):
    done = run_without_extras("explore", "room", "--steps", "2", *choice, "--out", str(tmp_path / "run"))
    assert done.returncode == 2
    assert "pip install 'anm-mj[torch]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_environments_name_what_they_need():
    program = "import sys; sys.modules['gymnasium'] = None; import anm_mj.environments"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stderr.splitlines()[-1].endswith("pip install 'anm-mj[environments]'.")


def test_the_command_line_is_complete_without_extras():
    assert main(["--version"]) == 0
    assert run_without_extras("doctor").returncode == 0
