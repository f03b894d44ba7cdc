"""Executes every command that README and docs print, and applies every setting.

A command runs for real where that is cheap: in a small scene, for a few steps, in a temporary folder. A run that would
take longer stops before its first step, after the command line, the configuration, the scene and the policy. Scripts
parse their options. A command that this module has no way to execute fails.
"""

import argparse
import json
import pkgutil
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from functools import wraps
from pathlib import Path

import pytest
import trimesh
import tyro

import anm_mj.run
from anm_mj.bench.suite import suite_file
from anm_mj.bench.sweep import read_jobs, read_sweeps
from anm_mj.cli import command_line
from anm_mj.cli.main import COMMANDS as COMMANDS_OF_PROGRAM
from anm_mj.cli.main import PROGRAM, main
from anm_mj.config import make_config
from anm_mj.errors import AnmError
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy, policies
from anm_mj.protocols import Policy
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.robot.robot_presets import robot_presets
from anm_mj.ros.drive_config import DriveConfig
from anm_mj.scene.folder import load_scene
from anm_mj.types import Footprint
from tests.docs.pages import PAGES, ROOT, blocks, commands, files, inline_code, options, settings

pytestmark = pytest.mark.usefixtures("quick_results")

TEMPLATE = ROOT / "docs" / "templates" / "my_policy.py"
SCHEDULE = ["--set", "mapping.schedule.first_iterations=5", "--set", "mapping.schedule.final_iterations=0"]
QUICK = ["--set", "image_px=32", *SCHEDULE]
"""Makes a run of a few steps quick."""
REAL_RUN = "anm-mj explore home --steps 500"
"""The run that is made, of three steps; other commands read what it leaves."""
OWN_SCENES = ("room", "flat", "home", "office", "residence")
SYNOPSIS = re.compile(r"\[-|\b(SRC|OUT|PLAN\.json)\b")
"""What only a synopsis holds, as in ``anm-mj scene generate OUT [--rooms N]``."""

COMMANDS = sorted(commands())
PRINTED = sorted({command for _, command in COMMANDS}, key=lambda command: (command != REAL_RUN, command))
"""Every command once, the real run first."""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder that holds what the printed commands name."""
    folder = tmp_path_factory.mktemp("docs")
    trimesh.creation.box((4.0, 2.6, 4.0)).export(folder / "house.glb")
    (folder / "stretch").mkdir()
    for name in ("my_robot.xml", "stretch/stretch.xml"):
        (folder / name).write_text((ROOT / "tests" / "rover.xml").read_text())
    (folder / "my_package").mkdir()
    for name in ("my_package/my_module.py", "my_policy.py"):
        shutil.copy(TEMPLATE, folder / name)
    (folder / "own_comparison.toml").write_text(own_comparison("policy.md"))
    (folder / "comparison.toml").write_text(own_comparison().replace("my_module", "my_package.my_module"))
    (folder / "docs").symlink_to(ROOT / "docs")
    (folder / "scripts").symlink_to(ROOT / "scripts")
    return folder


@pytest.fixture(autouse=True)
def there(place, monkeypatch):
    """Commands are given in that folder, and remember scenes in it alone."""
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(str(place))
    monkeypatch.setenv("ANM_MJ_SCENES", str(place / "scenes"))


@pytest.mark.parametrize("command", PRINTED)
def test_command(command, place, monkeypatch, capsys):
    words = shlex.split(command)
    if words[0] == "anm-mj" and SYNOPSIS.search(command):
        options_are_complete(words, capsys)
    elif words[0] == "anm-mj":
        anm_mj_command(words[1:], command, place, monkeypatch, capsys)
    elif words[:1] == ["python"] and words[1].startswith("scripts/"):
        assert script_parses(ROOT / words[1], [word.replace("RUN...", "RUN") for word in words[2:]], monkeypatch)
    elif words[0] == "make":
        subprocess.run([*words, "--dry-run"], cwd=ROOT, check=True, capture_output=True)
    elif words[0] == "pytest":
        assert (ROOT / words[1]).exists()
    elif words == ["pip", "install", "."]:
        pass  # tests/install/test_wheel.py installs it.
    elif words[:2] == ["pip", "install"]:
        extras = re.fullmatch(r"(?:anm-mj|\.)\[([\w,]+)\]", words[2])
        assert extras
        declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert set(extras[1].split(",")) <= set(declared)
    elif words[:2] == ["apt", "install"]:
        assert all(package in (ROOT / "scripts" / "setup.sh").read_text() for package in words[2:])
    elif words[:1] == ["source"]:
        assert words[1] in (ROOT / "scripts" / "setup.sh").read_text() or (ROOT / words[1]).is_file()
    elif words[:1] == ["export"]:
        assert re.fullmatch(r"ANM_MJ_(SCENES|ROBOTS)=.+", words[1])
    else:
        pytest.fail(f"nothing here knows how to execute: {command}")


@pytest.mark.parametrize("setting", sorted(settings()))
def test_setting(setting):
    applied, refusals = [], []
    # Somebody has to be there.
    given = ["people.number=1", setting] if setting.startswith("people.") else [setting]
    for policy in policies():
        try:
            live = {"kind": DriveConfig, "pose": "slam"} if setting.startswith("ros.") else {}
            make_config("default", given, scene="room", policy=policy, **live)
            applied.append(policy)
        except AnmError as err:
            refusals.append(err)
    assert applied, refusals


def test_settings_of_the_default_policy():
    text = (ROOT / "docs" / "planning.md").read_text(encoding="utf-8")
    section = text.partition("## The default policy")[2].partition("\n## ")[0]
    named = {name for name in re.findall(r"`([a-z]+(?:_[a-z0-9]+)+)`", section)}
    assert len(named) > 10
    settings = make_config("default", [], scene="room").policy_settings
    assert {name for name in named if not hasattr(settings, name)} == set()


@pytest.mark.slow
def test_own_policy(place):
    # More steps than the turn that it begins with.
    assert main(["explore", "room", "--steps", "40", "--policy", "my_policy:MyPolicy", "--out", "own", *QUICK]) == 0
    assert "border of the unknown" in (place / "own" / "plans.jsonl").read_text(encoding="utf-8")


def test_reference_is_that_of_the_code():
    for name, page in runpy.run_path(str(ROOT / "scripts" / "make_reference.py"))["pages"]().items():
        assert (ROOT / "docs" / name).read_text(encoding="utf-8") == page, "call python scripts/make_reference.py"


def test_every_environment_variable_of_the_program_has_a_line():
    code = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "anm_mj").rglob("*.py"))
    pages = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("commands.md", "bad_input.md"))
    said = dict(re.findall(r"^\| `(ANM_MJ_\w+)` \| ([^|,]+)", pages, re.MULTILINE))
    assert set(re.findall(r"ANM_MJ_[A-Z0-9_]*[A-Z0-9]", code)) == set(said)
    for name, default in re.findall(r'limit\("(\w+)", ([\d_]+)\)', code):
        assert said[name].strip() == default.replace("_", "")


def test_run_folder(place):
    if not (place / "runs").exists():
        run_for_real()
    folder = place / "runs" / "latest"
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8").partition("## The run folder")[2]
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", text))))
    assert {path.stem for path in folder.iterdir()} <= named | {"novel_views"}
    for name in ("steps.jsonl", "plans.jsonl", "frames.jsonl", "metrics.json", "manifest.json", "config.json"):
        lines = (folder / name).read_text(encoding="utf-8")
        keys = json.loads(lines.splitlines()[0] if name.endswith("l") else lines).keys()
        assert keys <= named, name
    assert (folder / "curve.csv").read_text(encoding="utf-8").splitlines()[0] in text


def test_options(capsys):
    known = set()
    for words in (
        ["explore"],
        ["eval"],
        ["view"],
        ["export"],
        ["map"],
        ["localise"],
        ["simulate"],
        ["drive"],
        ["bench"],
        ["doctor"],
        ["completion"],
        *(["scene", action] for action in ("import", "generate", "check")),
    ):
        known |= set(re.findall(r"--[a-z][a-z-]*", help_of(words, capsys)))
    for script in (ROOT / "scripts").glob("*.py"):
        text = script.read_text()
        known |= {"--" + name.replace("_", "-") for name in re.findall(r"\b([a-z_]+): ", text)}
        known |= set(re.findall(r"\"(--[a-z-]+)\"", text))
    assert options() - known == set()


def test_files():
    assert [(page, path) for page, path in sorted(files()) if not (ROOT / path).exists()] == []


def test_names():
    code = [span for page in PAGES for span in inline_code(page.read_text(encoding="utf-8"))]
    names = {name for span in code for name in re.findall(r"\banm_mj(?:\.\w+)+", span)}
    assert names
    for name in names:
        pkgutil.resolve_name(name)


def test_anchors():
    pages = {page: page.read_text(encoding="utf-8") for page in PAGES}
    for page, text in pages.items():
        for path, anchor in re.findall(r"\]\(([^)\s#:]*)#([^)\s]+)\)", text):
            target = (page.parent / path).resolve() if path else page
            headings = re.findall(r"^#+ (.+)$", pages[target], re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
            assert anchor in slugs, (page.name, path, anchor)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_blocks(page):
    for block in blocks(page.read_text(encoding="utf-8")):
        match block.language:
            case "python":
                compile(block.text, str(page), "exec")
            case "toml":
                tomllib.loads(block.text)
            case "console" | "text" | "{include}":
                pass
            case language:
                pytest.fail(f"nothing here knows what to do with a block of {language}")


def test_folders_of_the_readme_are_those_of_the_package():
    table = {path.removeprefix("anm_mj/").strip("/") for _, path in files() if path.startswith("anm_mj/")}
    folders = {path.name for path in (ROOT / "anm_mj").iterdir() if (path / "__init__.py").is_file()}
    assert folders <= {path.split("/")[0] for path in table}


def anm_mj_command(words, command, place, monkeypatch, capsys):
    """Execute a command of the program."""
    if not words or words in (
        ["scene"],
        ["scene", "import"],
        ["scene", "generate"],
        ["scene", "check"],
        ["eval"],
        ["view"],
        ["export"],
        ["map"],
        ["localise"],
        ["simulate"],
        ["drive"],
        ["robot", "check"],
        ["completion"],
    ):
        help_of(words, capsys)  # Only the name of a command.
    elif words in (["explore"], ["bench"]) or "--help" in words:
        help_of([word for word in words if word != "--help"], capsys)
    elif words[:2] == ["explore", "--resume"]:
        parsed = parse(words)  # tests/integration/test_kills.py executes these.
        assert parsed["resume"]
    elif words[0] == "explore" and "--continue" in words:
        parsed = parse(words)  # tests/integration/test_continue.py executes these.
        assert parsed["continue_from"]
    elif words[0] == "explore":
        explore(words, command, place, monkeypatch)
    elif words[0] == "bench":
        parsed = parse(words)
        if "suite" in parsed:
            assert read_sweeps(suite_file(parsed["suite"]))[1]
        elif parsed["file"] in (Path("comparison.toml"), Path("own_comparison.toml")):
            assert read_jobs(place / parsed["file"])
        else:
            assert parsed["file"].is_file()
    elif words[0] in ("map", "localise"):
        parse(words)  # tests/test_map_sequence.py and tests/test_localise_images.py execute these.
    elif words[0] in ("simulate", "drive"):
        parse(words)  # tests/ros executes these.
    elif words[:2] in (["view", "runs/latest"], ["export", "runs/latest"]):
        if len(words) > 2:
            if not (place / words[1]).exists():
                run_for_real()
            assert main(words) == 0
        else:
            parse(words)  # tests/replay serves a page.
    elif words[0] == "view":
        assert {"run", "other"} <= parse(words).keys()  # tests/replay/test_pair.py executes it.
    elif words == ["eval", "runs/latest"]:
        if not (place / words[1]).exists():  # The real run may be a test of another process.
            run_for_real()
        assert main(words) == 0
    elif words[0] == "completion":
        assert main(words) == 0
    elif words[0] in ("eval", "doctor"):
        parse(words)  # tests/evaluation and tests/cli/test_doctor.py execute these.
    elif words[:2] == ["scene", "import"]:
        scene_import(words, place)
    elif words[:2] == ["scene", "check"]:
        assert main([*words[:2], "room", *words[3:]]) == 0
    elif words[:2] == ["scene", "generate"]:
        assert main([*words, "--rooms", "1"]) == 0
    elif words[:2] == ["scene", "list"]:
        assert main(words) == 0
    elif words[:2] == ["robot", "check"]:
        assert words[2] in robot_presets() or (place / words[2]).is_file()
        parse(words)  # tests/cli/test_robot.py executes these.
    else:
        pytest.fail(f"nothing here knows how to execute: {command}")


def explore(words, command, place, monkeypatch):
    """Explore ``room`` in place of the scene; for real, or up to the first step."""
    shortened = [words[0], "room", *words[2:]]
    if command == REAL_RUN:
        run_for_real()
        return
    asked = []

    class Stop(BaseException):
        pass

    def stop(config, **_):
        asked.append(config)
        raise Stop

    monkeypatch.setattr(anm_mj.run, "run", stop)
    with pytest.raises(Stop):
        main(shortened)
    config = asked[0]
    if words[1] in OWN_SCENES:
        load_scene(words[1])
    if config.robot != DEFAULT_ROBOT:
        assert config.robot in robot_presets() or (place / config.robot).is_file()
    made = make_policy(
        config.policy, PolicyContext(Footprint(0.18, 0.05, 1.35), config.policy_settings, config.planning, config.seed)
    )
    assert isinstance(made, Policy)


def run_for_real():
    """The first run that the README prints, in a small scene."""
    assert main(["explore", "room", "--steps", "3", *QUICK]) == 0


def scene_import(words, place):
    """Import a mesh from where the command says, to where it says."""
    source = place / words[2]
    if not source.exists():
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_bytes((place / "house.glb").read_bytes())
    out = str(place / Path(words[3].replace("$ANM_MJ_SCENES", "scenes")))
    assert main(["scene", "import", str(source), out, *words[4:]]) == 0


def options_are_complete(words, capsys):
    """The synopsis of a command names all its options, and no others."""
    named = set(re.findall(r"--[a-z][a-z-]*", " ".join(words)))
    action = [word for word in words[1:3] if word.islower()]
    # The first name of each: others are old ones.
    printed = set(re.findall(r"^  (--[a-z][a-z-]*)", help_of(action, capsys), re.MULTILINE))
    if "PLAN.json" in words:
        assert named <= printed
    else:
        assert named == printed


def help_of(words, capsys):
    """What ``--help`` prints."""
    assert main([*words, "--help"]) == 0
    return capsys.readouterr().out


def parse(words):
    """What the real parser makes of a command, which is not executed."""
    prog, command, rest = command_line.find(PROGRAM, COMMANDS_OF_PROGRAM, words)
    return command_line.parse(prog, command, rest)[0]


def script_parses(script, words, monkeypatch):
    """Whether a script takes its options; it stops where its work would begin."""
    done = []

    def parsed_only(function):
        @wraps(function)
        def stop(*args, **kwargs):
            done.append((args, kwargs))

        return stop

    real_cli, real_parse = tyro.cli, argparse.ArgumentParser.parse_args
    real_several = tyro.extras.subcommand_cli_from_dict

    def parse_args(self, *args, **kwargs):
        done.append(real_parse(self, *args, **kwargs))
        raise SystemExit(0)

    monkeypatch.setattr(tyro, "cli", lambda function, **options: real_cli(parsed_only(function), **options))
    monkeypatch.setattr(
        tyro.extras,
        "subcommand_cli_from_dict",
        lambda several: real_several({name: parsed_only(one) for name, one in several.items()}),
    )
    if "tyro" not in script.read_text():
        monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    monkeypatch.setattr(sys, "argv", [str(script), *(words or ["--help"])])
    monkeypatch.syspath_prepend(str(script.parent))  # As when Python is given a script.
    status = None
    try:
        runpy.run_path(str(script), run_name="__main__")
    except SystemExit as ended:
        status = ended.code
    return not status and (bool(done) or not words)


def own_comparison(page="benchmarks.md"):
    """The comparison that a page of the documentation shows."""
    return next(
        block.text for block in blocks((ROOT / "docs" / page).read_text(encoding="utf-8")) if block.language == "toml"
    )


def test_pages_print_commands():
    assert len(PRINTED) > 20
    assert REAL_RUN in PRINTED
