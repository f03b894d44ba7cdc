import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from rich.console import Console

from anm_mj.cli.console import busy
from anm_mj.cli.explore import show_run
from anm_mj.cli.main import COMMANDS, main
from anm_mj.config import OPTIONS
from anm_mj.evaluation.metrics import COUNTS, Metrics
from anm_mj.io.run_folder import RunFolder
from anm_mj.planning.policies.registry import policies
from anm_mj.sim.sensors.sensor_config import SENSORS


def fails(capsys, *argv):
    """Run a command that must fail: its exit status and what it said, which must be one line without a traceback."""
    assert main([str(arg) for arg in argv]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize(
    ("options", "wrong", "right"),
    [
        (["--policy", "greedy"], "greedy", "gvg, anm-s, anm, upen"),
        (["--policy", "no_such_module:Policy"], "no_such_module", "cannot be imported"),
        (["--policy", "json:Nothing"], "Nothing", "has no class"),
        (["--policy", "json:JSONDecoder"], "JSONDecoder", "plan, on_collision"),
        (["--preset", "best"], "best", "quick"),
        (["--drive", "fly"], "fly", "kinematic, physics"),
        (["--device", "tpu"], "tpu", "auto, cpu, cuda"),
        (["--steps", "0"], "0", "at least 1"),
        (["--steps", "many"], "many", "int"),
        (["--steps", "9" * 400], "999...", "1000000000 steps at most"),
        (["--set", "image_px=" + "-" * 200_000 + "1"], "---...", "int"),
        (["--set", "planning.margin_m=" + "9" * 400], "999...", "float"),
        (["--view", "--port", "-1"], "-1", "from 1 to 65535"),
        (["--out", ""], "--out", "it is empty"),
        (["--out", "a\udcff"], r"'a\udcff'", "UTF-8"),
        (["--seed", "-1"], "-1", "from 0 up"),
        (["--start", "1,2"], "1,2", "X,Y,YAW_DEG"),
        (["--start", "-1,2,x"], "-1,2,x", "X,Y,YAW_DEG"),
        (["--start", "1,2,nan"], "1,2,nan", "X,Y,YAW_DEG"),
        (["--set", "planning.margin_m"], "planning.margin_m", "group.name=value"),
        (["--set", "planning.margin=0.1"], "margin", "margin_m"),
        (["--set", "planning.margin_m=wide"], "wide", "float"),
        (["--set", "planning.margin_m=-0.1"], "-0.1", "at least 0"),
        (["--set", "planning=1"], "planning", "planning.margin_m"),
        (["--set", "planning.margin_m=1e999"], "1e999", "float"),
        (["--set", "planning.region_percentile=150"], "150", "below 100"),
        (["--set", "sensor.odometry_radius_error=0.3", "--set", "sensor.noise_scale=5"], "is 0.3", "noise_scale is 5"),
        *(
            (["--policy", name, "--set", "policy.range_m=101"], "101", "at most 100")
            for name in ("frontier", "upen", "anm")
        ),
        (["--policy", "anm-s", "--set", "policy.visited_by=hearsay"], "hearsay", "sight, place"),
        (["--set", "mapping.field.blob_period_m=(1,2)"], "(1,2)", "tuple"),
        (["--set", "preset=paper"], "preset", "--preset paper"),
        (["--policy", ":Policy"], ":Policy", "cannot be imported"),
        (["--policy", "..a:Policy"], "..a", "cannot be imported"),
        (["--port", "7001"], "7001", "--view"),
        (["--policy", "anm-s", "--target", "best"], "best", "best-anchored"),
        (["--target", "random"], "policy.target", "no such setting"),
        (["--wrong"], "--wrong", "--help"),
    ],
)
def test_a_wrong_option_is_named_with_its_value_and_what_would_be_right(capsys, options, wrong, right):
    said = fails(capsys, "explore", "home", *options)
    assert wrong in said
    assert right in said


@pytest.mark.parametrize(
    "words",
    [
        ["localise", "run", "images", "--set", "mapping.geometry=occupancy"],
        ["robot", "check", "diff_drive", "--set", "image_px=64", "--set", "planning.margin_m=1"],
        ["simulate", "room", "--ros", "--set", "sensor.delay_s=0.1", "--set", "planning.margin_m=1"],
    ],
)
def test_a_setting_that_a_command_does_not_read_is_refused(capsys, words):
    assert f"--set {words[-1].partition('=')[0]} has no effect here" in fails(capsys, *words)


def test_a_missing_scene_is_named(capsys):
    assert "nowhere" in fails(capsys, "explore", "nowhere")
    assert "no_such_folder" in fails(capsys, "explore", "no_such_folder/at_all")
    assert "xxx" in fails(capsys, "explore", "x" * 300)


@pytest.mark.parametrize(
    "words",
    [
        ["home"],
        ["--steps", "3"],
        ["--return"],
        ["--set", "image_px=32"],
        ["--continue", "x"],
        ["--seed", "0"],
        ["--no-visibility-guidance"],
    ],
)
def test_a_resumed_run_takes_no_options_of_a_new_one(capsys, tmp_path, words):
    left = "the scene" if words == ["home"] else words[0]
    assert f"leave out {left}." in fails(capsys, "explore", "--resume", tmp_path, *words)


@pytest.mark.parametrize(
    "words",
    [["--dry"], ["--pose", "slam"], ["--return"], ["--steps", "3"], ["--topic", "depth=x"], ["--set", "image_px=32"]],
)
def test_a_resumed_run_of_a_live_robot_drives_as_it_was_set_up(capsys, tmp_path, words):
    assert f"leave out {words[0]}." in fails(capsys, "drive", "--resume", tmp_path, *words)


@pytest.mark.parametrize("command", ["explore", "drive"])
def test_the_policy_of_a_resumed_run_may_be_named(capsys, tmp_path, command):
    for name in ("steps.jsonl", "frames.jsonl", "camera.json"):
        (tmp_path / name).touch()
    (tmp_path / "config.json").write_text('{"policy": "gvg"}')
    assert "but the run's policy is 'gvg'" in fails(capsys, command, "--resume", tmp_path, "--policy", "random")


def test_a_folder_that_merely_has_a_scenes_name_does_not_hide_the_catalogue(tmp_path, monkeypatch):
    from anm_mj.scene.folder import load_scene

    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_scene("home").rooms == 7


@pytest.mark.parametrize("command", [["explore", "home"], ["drive"]])
def test_a_policy_beside_the_user_is_found_and_one_that_cannot_be_made_leaves_no_folder(tmp_path, command):
    (tmp_path / "mine.py").write_text(
        "class Plain:\n    def observe(self, observation): ...\n    def plan(self, mapper, observation): ...\n"
        "    def on_collision(self, pose, action): ...\n"
    )
    script = Path(sys.executable).parent / "anm-mj"
    words = [script, *command, "--policy", "mine:Plain", "--out", "run"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert "'mine:Plain' cannot be made from a PolicyContext" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_start_inside_a_wall_is_refused_and_leaves_no_folder(capsys, tmp_path):
    said = fails(capsys, "explore", "home", "--start", "0.0,4.0,0", "--out", tmp_path / "run")
    assert "(0.00, 4.00)" in said
    assert not (tmp_path / "run").exists()


def test_a_start_outside_of_the_house_is_refused(capsys, tmp_path):
    assert "-50" in fails(capsys, "explore", "home", "--start", "-50,4.0,0", "--out", tmp_path / "run")


def test_an_output_folder_that_cannot_be_written_is_refused(capsys, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    said = fails(capsys, "explore", "home", "--out", tmp_path / "file" / "run")
    assert str(tmp_path / "file" / "run") in said
    assert "cannot be made" in fails(capsys, "explore", "home", "--out", tmp_path / ("x" * 300))
    if os.geteuid() != 0:  # The superuser may write everywhere.
        (tmp_path / "locked").mkdir(mode=0o500)
        assert "locked" in fails(capsys, "explore", "home", "--out", tmp_path / "locked" / "run")


def test_an_output_folder_that_holds_something_is_not_overwritten(capsys, tmp_path):
    (tmp_path / "thesis.tex").write_text("important")
    assert "not empty" in fails(capsys, "explore", "home", "--out", tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "important"


def good_glb(path: Path) -> bytes:
    trimesh.creation.box((4.0, 2.6, 4.0)).export(path)
    return path.read_bytes()


def test_files_that_are_no_scenes_are_refused_and_nothing_is_left_behind(capsys, tmp_path):
    data = good_glb(tmp_path / "good.glb")
    (tmp_path / "corrupt.glb").write_bytes(data[: len(data) // 2])
    (tmp_path / "noise.glb").write_bytes(np.random.default_rng(0).bytes(2000))
    (tmp_path / "empty.ply").write_bytes(b"")
    (tmp_path / "odd.gltf").write_text('{"asset": {"version": "2.0"}, "images": ["a"], "extensionsUsed": 5}')
    (tmp_path / "notes.txt").write_text("no mesh")
    for name in ("corrupt.glb", "noise.glb", "odd.gltf", "empty.ply", "notes.txt", "missing.obj"):
        assert name in fails(capsys, "scene", "import", tmp_path / name, tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_a_folder_that_is_no_run_cannot_be_evaluated(capsys, tmp_path):
    assert str(tmp_path) in fails(capsys, "eval", tmp_path)
    assert "nowhere" in fails(capsys, "eval", tmp_path / "nowhere")
    assert "--scene is home, but" in fails(capsys, "eval", tmp_path, "--scene", "home")


def test_help_answers_at_once_and_shows_every_option():
    run = [sys.executable, "-X", "importtime", "-m", "anm_mj.cli", "explore", "--help"]
    shown = subprocess.run(run, capture_output=True, text=True, check=True)
    for option in (*(words.split()[0] for words in OPTIONS.values()), "--resume", "--out", "--view", "--set"):
        assert f"  {option}" in shown.stdout
    for name in (*policies(), *SENSORS):
        assert name in shown.stdout
    for heavy in ("torch", "mujoco", "scipy", "trimesh", "numpy", "rich"):
        assert f" {heavy}\n" not in shown.stderr


def test_the_catalogue_is_listed(capsys):
    assert main(["scene", "list"]) == 0
    assert "home" in capsys.readouterr().out


def test_json_is_all_that_is_printed(capsys):
    assert main(["scene", "list", "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    home = next(one for one in json.loads(said.out) if one["name"] == "home")
    assert (home["rooms"], Path(home["folder"]).name) == (7, "home")


def test_quiet_prints_neither_results_nor_progress(capsys, tmp_path):
    assert main(["scene", "list", "--quiet"]) == 0
    assert main(["scene", "generate", str(tmp_path / "hut"), "--rooms", "1", "-q"]) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")
    assert "nowhere" in fails(capsys, "explore", "nowhere", "-q")
    # The next command speaks again.
    assert main(["scene", "list"]) == 0
    assert "home" in capsys.readouterr().out


def test_a_table_is_not_broken_where_no_terminal_is(capsys):
    assert main(["scene", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    # Scenes of a user's own may stand between them.
    whole = {line.split()[0] for line in lines[1:] if "MIT" in line}
    assert whole >= {"flat", "home", "office", "residence", "room"}


def test_the_version_is_printed(capsys):
    assert main(["--version"]) == 0
    assert re.match(r"anm-mj \d+\.\d+\.\d+", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["explore", "hom"], "home"),
        (["explore", "room", "--policy", "frontir"], "frontier"),
        (["explore", "room", "--sensor", "d453i"], "d435i"),
        (["explore", "room", "--preset", "qick"], "quick"),
        (["explore", "room", "--stpes", "3"], "--steps"),
        (["exploer", "room"], "explore"),
        (["scene", "imprt"], "import"),
        (["scene", "check", "room", "--uot"], "--out"),
    ],
)
def test_a_close_name_is_proposed(capsys, words, meant):
    assert f"(did you mean {meant}?)" in fails(capsys, *words)


FAULTY = """
from anm_mj.planning.policies.random_walk import RandomWalk


class Faulty(RandomWalk):
    def plan(self, mapper, observation):
        return super().plan(mapper, observation) if observation.step < 2 else 1 / 0
"""


@pytest.mark.slow
def test_a_policy_that_fails_leaves_a_complete_run_and_a_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "faulty_policy.py").write_text(FAULTY)
    quick = ["--set", "image_px=32", "--set", "mapping.schedule.first_iterations=5", "-v"]
    assert main(["explore", "room", "--policy", "faulty_policy:Faulty", "--steps", "5", "--out", "run", *quick]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "The run ends because policy faulty_policy:Faulty failed in plan at step 2: ZeroDivisionError" in said
    assert "(faulty_policy.py, line 7)" in said
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["stop_reason"] == "POLICY_ERROR"
    assert (tmp_path / "run" / "mesh.ply").is_file()


def test_a_file_that_is_named_like_a_module_of_pythons_does_not_take_its_place(tmp_path):
    (tmp_path / "queue.py").write_text("raise RuntimeError")
    program = "import sys; from anm_mj.cli.main import main; sys.exit(main(sys.argv[1:]))"
    settings = ["image_px=32", "mapping.schedule.first_iterations=5", "mapping.schedule.final_iterations=0"]
    words = ["explore", "room", "--steps", "1", *(word for each in settings for word in ("--set", each))]
    # With -P, as a console script begins.
    done = subprocess.run([sys.executable, "-P", "-c", program, *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("reason", "status"), [("SENSOR_FAULT", 2), ("MAP_ERROR", 2), ("BUDGET", 0), ("LOST", 0)])
def test_a_run_that_a_fault_has_ended_has_failed(tmp_path, reason, status):
    counts = dict.fromkeys(COUNTS, 0)
    metrics = Metrics(stop_reason=reason, path_m=0.0, stage_hz={}, **counts)
    folder = RunFolder.create(tmp_path / "run", "room", "gvg")
    assert show_run(lambda observers: (folder, metrics), None, None, verbose=False).status == status


def test_a_bar_without_end_shows_only_in_a_terminal():
    for terminal in (True, False):
        said = io.StringIO()
        with busy(Console(file=said, force_terminal=terminal, width=60), "import"):
            pass
        assert ("import" in said.getvalue()) == terminal


def test_an_unforeseen_error_is_one_sentence_and_with_verbose_a_traceback(monkeypatch, capsys):
    def broken():
        """Fail."""
        return {}["key"]

    monkeypatch.setitem(COMMANDS.commands, "doctor", broken)
    assert main(["doctor"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("anm-mj: unforeseen KeyError in test_main.py, line ")
    assert "--verbose" in said
    with pytest.raises(KeyError):
        main(["doctor", "--verbose"])


@pytest.mark.parametrize(("raised", "words"), [(SystemExit(0), "ended the program"), (MemoryError(), "memory")])
def test_the_end_of_the_program_and_of_the_memory_are_sentences(monkeypatch, capsys, raised, words):
    def broken():
        """Fail."""
        raise raised

    monkeypatch.setitem(COMMANDS.commands, "doctor", broken)
    assert main(["doctor"]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("words", [("scene", "check", "home", "--out"), ("robot", "check", "diff_drive", "--out")])
def test_a_picture_of_an_unknown_kind_is_refused_before_it_is_drawn(tmp_path, capsys, words):
    assert "give a file that ends in .png" in fails(capsys, *words, tmp_path / "x.xyz")
    assert not list(tmp_path.iterdir())


def test_a_name_that_no_file_can_hold_is_refused_before_any_work(tmp_path, capsys):
    said = fails(capsys, "scene", "generate", tmp_path / "out", "--rooms", "1", "--name", "a\udc80")
    assert "is no UTF-8" in said
    assert not list(tmp_path.iterdir())
