"""The command line: ``anm-mj explore | map | eval | view | export | bench | scene | robot | doctor``.

Wrong input ends with one sentence and exit status 2. Heavy packages are imported by the commands that need them, so
that ``--help`` and a mistyped option answer at once.
"""

from __future__ import annotations

import argparse
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from anm_mj.cli.bench import add_bench
from anm_mj.cli.evaluate import add_evaluate
from anm_mj.cli.explore import add_explore
from anm_mj.cli.export import add_export
from anm_mj.cli.map import add_map
from anm_mj.cli.robot import add_robot
from anm_mj.cli.scene import add_scene
from anm_mj.cli.view import add_view
from anm_mj.errors import AnmError
from anm_mj.utils.close_names import close_name

USAGE_ERROR = 2
INTERRUPTED = 130
"""Exit status of a program that a second Ctrl-C has ended, by custom 128 + SIGINT."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, without the usage in front of it."""

    words: Sequence[str] = ()
    """What is being parsed."""

    def error(self, message: str) -> NoReturn:
        self.exit(USAGE_ERROR, f"{self.prog}: {message}{self._hint(message)}; see {self.prog} --help.\n")

    def _hint(self, message: str) -> str:
        """The command or option that was meant, where a misspelt one is close to it."""
        choice = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if choice:
            return close_name(choice[1], re.findall(r"[\w-]+", choice[2]))
        option = re.search(r"unrecognized arguments: (--[\w-]+)", message)
        if not option:
            return ""
        command: argparse.ArgumentParser = self
        for word in self.words:
            below = [action.choices for action in command._actions if isinstance(action, argparse._SubParsersAction)]
            command = below[0].get(word, command) if below else command
        return close_name(option[1], command._option_string_actions)


class _Version(argparse.Action):
    """Prints the version; looked up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib import metadata

        from anm_mj.io.manifest import git_revision
        from anm_mj.utils.package_data import checkout

        folder = checkout()
        git = None if folder is None else git_revision(folder)
        revision = f" (revision {git['revision'][:12]}{', changed' if git['changed'] else ''})" if git else ""
        sys.stdout.write(f"{parser.prog} {metadata.version('anm-mj')}{revision}\n")
        parser.exit()


def main(argv: list[str] | None = None) -> int:
    """Run a command line and return its exit status."""
    arguments = _with_joined_start(sys.argv[1:] if argv is None else argv)
    parser = make_parser()
    parser.words = arguments
    _require_text(parser, arguments)
    parsed = parser.parse_args(arguments)
    from anm_mj.cli.console import PlainConsole
    from anm_mj.cli.log import log_to

    console = PlainConsole(stderr=True)
    log_to(console, verbose=parsed.verbose)
    try:
        return parsed.command(parsed)
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
        if parsed.verbose:
            raise
        sentence = _unforeseen(err)
    # What a library says within the sentence may come in several lines.
    console.print(f"anm-mj: {' '.join(sentence.split())}", style="red", highlight=False, soft_wrap=True)
    return USAGE_ERROR


def _require_text(parser: _Parser, words: Sequence[str]) -> None:
    """End the program for a word that the files of runs and scenes, which are UTF-8, cannot hold."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            parser.error(f"{word!a} is no UTF-8; rename the file, or write it otherwise")


def _unforeseen(err: Exception) -> str:
    """What to say of an error that no reader has turned into a sentence of its own."""
    place = traceback.extract_tb(err.__traceback__)[-1]
    return (
        f"unforeseen {type(err).__name__} in {Path(place.filename).name}, line {place.lineno}: {err}. A file may be "
        "damaged in a new way, or the program is wrong. The same command with --verbose shows where; please report it "
        "with the output of anm-mj doctor --report."
    )


def _with_joined_start(argv: list[str]) -> list[str]:
    """The same words with ``--start -1,2,0`` as one: alone, a word that begins with '-' is taken for an option."""
    words = list(argv)
    if "--start" in words[:-1]:
        at = words.index("--start")
        words[at : at + 2] = [f"--start={words[at + 1]}"]
    return words


def make_parser() -> _Parser:
    """The parser of the whole command line."""
    parser = _Parser(prog="anm-mj", description="Active neural mapping of indoor scenes with a MuJoCo robot.")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version, and the revision of a checkout")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    add_explore(commands)
    add_evaluate(commands)
    add_map(commands)
    add_view(commands)
    add_export(commands)
    add_bench(commands)
    add_scene(commands)
    add_robot(commands)
    doctor = commands.add_parser("doctor", help="what this machine has, and what will be used")
    doctor.add_argument("--report", action="store_true", help="for a bug report: Markdown, without your folders")
    doctor.set_defaults(command=_doctor)
    _add_verbose(commands)
    return parser


def _add_verbose(commands: argparse._SubParsersAction[Any]) -> None:
    """Give every command the option, or each of its actions where it has some."""
    for command in commands.choices.values():
        actions = [action for action in command._actions if isinstance(action, argparse._SubParsersAction)]
        if actions:
            _add_verbose(actions[0])
        else:
            command.add_argument("-v", "--verbose", action="store_true", help="show details and tracebacks")


def _doctor(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.doctor import main as doctor
    from anm_mj.cli.doctor_report import print_report

    return doctor(print_report if parsed.report else None)
