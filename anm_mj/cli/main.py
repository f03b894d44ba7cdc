"""The command line ``anm-mj``.

Wrong input ends with one sentence and exit status 2. Heavy packages are imported by the commands that need them, so
that ``--help`` and a mistyped option answer at once.
"""

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from anm_mj.cli.bench import bench
from anm_mj.cli.command_line import USAGE_ERROR, Group, Report, fail, find, parse
from anm_mj.cli.completion import completion
from anm_mj.cli.doctor import doctor, version
from anm_mj.cli.drive import drive
from anm_mj.cli.evaluate import evaluate
from anm_mj.cli.explore import explore
from anm_mj.cli.export import export
from anm_mj.cli.localise import localise
from anm_mj.cli.map import map_recorded
from anm_mj.cli.robot import robot_check
from anm_mj.cli.scene import scene_generate, scene_import, scene_list
from anm_mj.cli.scene_check import scene_check
from anm_mj.cli.simulate import simulate
from anm_mj.cli.streams import open_streams, say_error, say_result
from anm_mj.cli.view import view
from anm_mj.errors import AnmError
from anm_mj.utils.extras import missing_package

INTERRUPTED = 130
"""Exit status of a program that a second Ctrl-C has ended, by custom 128 + SIGINT."""
PROGRAM = "anm-mj"
COMMANDS = Group(
    "Active neural mapping of indoor scenes with a MuJoCo robot. --version prints the version.",
    {
        "explore": explore,
        "eval": evaluate,
        "map": map_recorded,
        "localise": localise,
        "simulate": simulate,
        "drive": drive,
        "view": view,
        "export": export,
        "bench": bench,
        "scene": Group(
            "Import, generate, check and list scenes.",
            {"import": scene_import, "generate": scene_generate, "check": scene_check, "list": scene_list},
        ),
        "robot": Group("Check robots.", {"check": robot_check}),
        "doctor": doctor,
        "completion": completion,
    },
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit status."""
    open_streams()
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        if words[:1] == ["--version"]:
            say_result(f"{PROGRAM} {version()}")
            return 0
        _require_text(words)
        prog, command, rest = find(PROGRAM, COMMANDS, words)
        given, manner = parse(prog, command, rest)
    except SystemExit as end:
        return int(end.code or 0)
    except AnmError as err:
        say_error(f"{PROGRAM}: {err}")
        return USAGE_ERROR
    from anm_mj.cli.console import PlainConsole, log_to, say_json
    from anm_mj.utils.files import home_folder, nowhere_folder

    # matplotlib and others end the program for a user without a home.
    os.environ.setdefault("HOME", str(home_folder()))
    if not os.access(os.environ["HOME"], os.W_OK):
        os.environ.setdefault("MPLCONFIGDIR", str(nowhere_folder() / "matplotlib"))

    PlainConsole.manner = manner
    console = PlainConsole(stderr=True)
    log_to(console, verbose=manner.verbose, quiet=manner.quiet)
    try:
        done = command(**given)
        if not isinstance(done, Report):
            return done
        if manner.json:
            say_json(done.facts)
        return done.status
    except AnmError as err:
        sentence = str(err)
    except KeyboardInterrupt:
        return INTERRUPTED
    except SystemExit as err:
        sentence = (
            f"A module that the command called ended the program (exit status {err.code!r}): take the call of "
            "sys.exit() out of it."
        )
    except MemoryError:
        sentence = (
            "The memory does not suffice for what was asked: give smaller settings or a smaller scene, or close other "
            "programs."
        )
    except Exception as err:
        known = _known(err)
        if manner.verbose and known is None:
            raise
        sentence = known or _unforeseen(err)
    # What a library says within the sentence may come in several lines.
    console.print(f"{PROGRAM}: {' '.join(sentence.split())}", style="red", highlight=False, soft_wrap=True)
    return USAGE_ERROR


def _require_text(words: Sequence[str]) -> None:
    """End the program for a word that the files of runs and scenes, which are UTF-8, cannot hold."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            fail(PROGRAM, f"{word!a} is no UTF-8; rename the file, or write it otherwise")


def _known(err: Exception) -> str | None:
    """What to say where a package is missing, or the folder that the user is in; None of another error."""
    if isinstance(err, ModuleNotFoundError):
        return missing_package(err)
    try:
        os.getcwd()
    except FileNotFoundError:
        return "The folder that you are in is gone; change to another one."
    return None


def _unforeseen(err: Exception) -> str:
    """What to say of an error that no reader has turned into a sentence of its own."""
    place = traceback.extract_tb(err.__traceback__)[-1]
    return (
        f"unforeseen {type(err).__name__} in {Path(place.filename).name}, line {place.lineno}: {err}. A file may be "
        "damaged in a new way, or the program is wrong. The same command with --verbose shows where; please report it "
        "with the output of anm-mj doctor --report."
    )
