"""Consoles of the command line, on which no file of others commands the terminal."""

import io
import json
import logging
import os
import re
import shutil
import signal
import subprocess
import sys

import matplotlib
import pytest
from rich.console import Console
from rich.table import Table

from anm_mj.cli.console import PlainConsole, log_to, printable
from anm_mj.cli.main import COMMANDS, main
from anm_mj.cli.progress import Interrupt
from anm_mj.utils.extras import EXTRAS
from tests.scene.small import make_small_scene


def test_no_character_of_a_file_commands_the_terminal():
    assert printable("a\x1b]0;b\x07\u202ec\nd é") == "a\\x1b]0;b\\x07\\u202ec\nd é"


def test_neither_lines_nor_cells_of_tables_do():
    console = PlainConsole()
    console.width = 40
    console.file = io.StringIO()
    table = Table(box=None, show_header=False)
    table.add_row("stop reason", "a\x1b[2J")
    console.print("Wrote \x1b]0;b\x07[red] :warning:", highlight=False)
    console.print(table)
    said = console.file.getvalue()
    assert "Wrote \\x1b]0;b" in said
    assert "[red] :warning:" in said
    assert "a\\x1b[2J" in said
    assert said.replace("\n", "").isprintable()


def test_a_closed_pipe_ends_nothing_and_says_nothing():
    program = """
from anm_mj.cli.console import PlainConsole
console = PlainConsole()
for _ in range(20000):
    console.say("line")
raise SystemExit(7)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""
    assert process.returncode == 7


def test_a_terminal_that_was_closed_ends_nothing_and_says_nothing():
    program = """
from anm_mj.cli.console import PlainConsole
console = PlainConsole()
console.say("line")
input()
console.say("line")
raise SystemExit(7)
"""
    terminal, end = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=end, stderr=subprocess.PIPE, text=True
    ) as process:
        os.close(end)
        assert os.read(terminal, 4) == b"line"
        os.close(terminal)
        assert process.communicate("\n")[1] == ""
    assert process.returncode == 7


SPEAK = ["--version", "scene --help", "explore --help", "completion bash", "scene list"]


@pytest.mark.parametrize("words", SPEAK)
def test_what_nobody_reads_is_not_missed(words):
    command = f"{sys.executable} -m anm_mj.cli {words}"
    done = subprocess.run(["bash", "-c", f"{command} >&- && {command} | true"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("words", SPEAK)
def test_a_full_disk_behind_the_output_is_named(words):
    # A machine may have Python write without a buffer, of which nothing is left to flush at the end.
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-m", "anm_mj.cli", *words.split()]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=buffered)
        told_nobody = subprocess.run(command, stdout=full, stderr=full, env=buffered)
    assert done.stderr == (
        "anm-mj: What the program prints cannot be written (No space left on device); free some space, or print to "
        "another place.\n"
    )
    assert (done.returncode, told_nobody.returncode) == (2, 2)


def test_letters_that_the_output_lacks_are_escaped(monkeypatch):
    def speaks():
        PlainConsole().say("step 50 · 3 %")
        return 0

    monkeypatch.setitem(COMMANDS.commands, "doctor", speaks)
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    assert main(["doctor"]) == 0
    assert written.getvalue() == b"step 50 \\xb7 3 %\n"


def test_a_closed_terminal_on_top_of_an_announced_end_ends_nothing_at_once(monkeypatch):
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.StringIO())  # The signal takes them away.
    # Below nohup, SIGHUP is ignored.
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with Interrupt(PlainConsole()) as interrupt:
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGHUP)
            assert interrupt.is_requested
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
        sys.stdout.close()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("home", [None, pytest.param("/proc/nowhere", marks=pytest.mark.slow)])
def test_a_user_without_home_and_extras_explores(tmp_path, home):
    program = f"""
import pwd, sys
sys.modules |= dict.fromkeys({[*EXTRAS, "triton"]})
def nobody(uid): raise KeyError(uid)
pwd.getpwuid = nobody
from anm_mj.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
    folder = tmp_path / "Küche mit Leerzeichen"
    make_small_scene(tmp_path / "small")
    # The list of fonts, which takes seconds to make.
    shutil.copytree(matplotlib.get_cachedir(), tmp_path / f"anm_mj-{os.getuid()}" / ".cache" / "matplotlib")
    words = ["explore", str(tmp_path / "small"), "--steps", "3", "--out", str(folder), "--set", "image_px=32"]
    words += ["--set", "mapping.schedule.first_iterations=5", "--set", "mapping.schedule.final_iterations=0"]
    env = {key: value for key, value in os.environ.items() if key not in {"HOME", "MPLCONFIGDIR"}}
    env |= {"TMPDIR": str(tmp_path)} | ({"HOME": home} if home else {})
    done = subprocess.run([sys.executable, "-c", program, *words], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (folder / "curve.png").is_file()
    assert "atplotlib" not in done.stderr
    # Progress, table and file state one figure at the end.
    final = json.loads((folder / "metrics.json").read_text())["observable_ratio"]
    assert f"step 3 of 3 · {final:.1f} % of the observable surface" in done.stdout
    assert re.search(rf"completion ratio, observable +{final:.2f} ", done.stdout)


def test_a_record_is_one_line_as_it_stands_however_narrow_the_console(monkeypatch):
    monkeypatch.setattr(logging.root, "handlers", [])
    said = io.StringIO()
    log_to(Console(file=said, width=40), verbose=False)
    long = "/a/rather/long/path " * 10
    logging.getLogger("anm_mj.x").info("Wrote %s[red]", long)
    logging.getLogger("anm_mj.x").debug("a detail")
    logging.getLogger("another").info("its detail")
    assert said.getvalue() == f"Wrote {long}[red]\n"
