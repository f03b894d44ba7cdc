"""A command line from functions: a command is a function, its parameters are the arguments, its docstring is the help.

Parameters before ``*`` are positional, those behind it are options. A function gets only what was given, so that a
default stands once, in its signature. One that returns a :class:`Report` can be asked for it as JSON. An
:class:`Option` beside a type says what a signature cannot. Beside
the type of ``**options`` stands what has more of them: another function, or :class:`Fields` of a dataclass, whose
docstrings are their help.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import math
import re
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple, NoReturn, Union, get_args, get_origin, get_type_hints

from anm_mj.cli.streams import say_result
from anm_mj.errors import AnmError
from anm_mj.utils.close_names import close_name
from anm_mj.utils.docstrings import field_texts, parameter_texts

USAGE_ERROR = 2


class Report(NamedTuple):
    """What a command has found out."""

    facts: Any
    """What ``--json`` prints: whatever :func:`anm_mj.io.to_json.to_json` takes."""
    status: int = 0


class Manner(NamedTuple):
    """How a command speaks; options that no command has for itself."""

    verbose: bool = False
    quiet: bool = False
    json: bool = False


Command = Callable[..., int | Report]
MANNER = {
    "verbose": "show details and tracebacks",
    "quiet": "print only warnings and errors",
    "json": "print the result as JSON, and nothing else",
}


class Option(NamedTuple):
    """How a parameter is given, where its name and type do not say it."""

    words: str = ""
    """The option with what it takes, as in ``--set NAME=VALUE``, or one of the two."""
    read: Callable[[str], Any] | None = None
    """Makes the value of the text; raises ArgumentTypeError."""
    several: bool = False
    """Whether a sequence is given as several words, and not by repeating the option."""
    names: Callable[[], Iterable[str]] | None = None
    """What the help lists to choose from."""


class Fields(NamedTuple):
    """Fields of a dataclass as options."""

    known: Callable[[], tuple[type, Mapping[str, Option]]]
    """The dataclass, and how each field is given; called only for the command that was asked for."""


class Group(NamedTuple):
    """Commands below a word."""

    summary: str
    commands: Mapping[str, Command | Group]


class Argument(NamedTuple):
    """One argument of a command."""

    name: str
    """Of the parameter."""
    flag: str
    """Empty for a positional one."""
    metavar: str
    """What its value is called; empty without a value."""
    help: str
    reading: dict[str, Any]
    """For ``ArgumentParser.add_argument``: how the value is read."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, without the usage in front of it."""

    def print_help(self, file: object = None) -> None:
        say_result(self.format_help().rstrip())

    def error(self, message: str) -> NoReturn:
        self.exit(USAGE_ERROR, f"{self.prog}: {message}{self._hint(message)}; see {self.prog} --help.\n")

    def _hint(self, message: str) -> str:
        """The choice or option that was meant, where a misspelt one is close to it."""
        if choice := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message):
            return close_name(choice[1], re.findall(r"[\w-]+", choice[2]))
        option = re.search(r"unrecognized arguments: (--[\w-]+)", message)
        return close_name(option[1], self._option_string_actions) if option else ""


def arguments(command: Callable[..., Any]) -> list[Argument]:
    """The arguments of a function, but for ``--verbose``, which all commands have."""
    # What a function returns may be known to the type checker alone.
    typed = types.SimpleNamespace(__annotations__={**command.__annotations__, "return": None})
    hints = get_type_hints(typed, inspect.unwrap(command).__globals__, include_extras=True)
    texts, found = parameter_texts(command)[2], []
    for name, parameter in inspect.signature(command).parameters.items():
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            (source,) = hints[name].__metadata__
            options = _field_arguments(*source.known()) if isinstance(source, Fields) else arguments(source)
            found += [one for one in options if one.flag]
        elif name != "verbose":
            positional = parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
            found.append(_argument(name, *_split(hints[name]), texts[name], parameter.default, positional=positional))
    return found


def commands(prog: str, group: Group) -> Iterator[tuple[str, Command]]:
    """Every command below a group, with the words that call it."""
    for word, found in group.commands.items():
        if isinstance(found, Group):
            yield from commands(f"{prog} {word}", found)
        else:
            yield f"{prog} {word}", found


def find(prog: str, group: Group, words: Sequence[str]) -> tuple[str, Command, Sequence[str]]:
    """The command that a command line names: the words that call it, the function, and the words left. Raises
    SystemExit after the help of a group (status 0), or after a sentence about what is wrong (status 2).
    """
    if not words:
        fail(prog, f"name one of {', '.join(group.commands)}")
    word, *rest = words
    if word in ("-h", "--help"):
        say_result(_group_help(prog, group))
        sys.exit(0)
    if word not in group.commands:
        fail(prog, f"invalid choice: '{word}' (choose from {', '.join(group.commands)})")
    prog, found = f"{prog} {word}", group.commands[word]
    return find(prog, found, rest) if isinstance(found, Group) else (prog, found, rest)


def manner_options(command: Command) -> dict[str, str]:
    """Those of a command's options that say how it speaks, with their help: ``--json`` where it returns a report."""
    reports = inspect.unwrap(command).__annotations__.get("return") in (Report, Report.__name__)
    return {name: text for name, text in MANNER.items() if reports or name != "json"}


def parse(prog: str, command: Command, words: Sequence[str]) -> tuple[dict[str, Any], Manner]:
    """What a command line gives of the parameters of a command, and how the command is to speak. Raises SystemExit
    after the help (status 0), or after a sentence about what is wrong (status 2).
    """
    summary, more, _ = parameter_texts(command)
    parser = _Parser(prog=prog, description=summary, epilog=more, argument_default=argparse.SUPPRESS)
    for one in arguments(command):
        names = {"metavar": one.metavar} if one.metavar else {}
        names |= {"dest": one.name} if one.flag else {}
        parser.add_argument(one.flag or one.name, help=one.help.replace("%", "%%"), **names, **one.reading)
    options = manner_options(command)
    loudness = parser.add_mutually_exclusive_group()
    for name, text in options.items():
        short, place = ([], parser) if name == "json" else ([f"-{name[0]}"], loudness)
        place.add_argument(*short, f"--{name}", action="store_true", default=False, help=text)
    given = vars(parser.parse_args(_join_numbers(words)))
    manner = Manner(**{name: given.pop(name) for name in options})
    if "verbose" in inspect.signature(command).parameters:
        given["verbose"] = manner.verbose
    return {name: value for name, value in given.items() if value is not None}, manner


def run_script(main: Callable[..., None]) -> None:
    """Run the function of a script with the words of the command line; an error of this program is one sentence and
    exit status 2.
    """
    import tyro

    try:
        tyro.cli(main)
    except AnmError as err:
        sys.stderr.write(f"{err}\n")
        sys.exit(USAGE_ERROR)


def fail(prog: str, message: str) -> NoReturn:
    """End the program with a sentence about its command line, and status 2."""
    _Parser(prog=prog).error(message)


def _group_help(prog: str, group: Group) -> str:
    lines = [f"usage: {prog} COMMAND ...", "", group.summary, ""]
    for word, found in group.commands.items():
        summary = found.summary if isinstance(found, Group) else parameter_texts(found)[0]
        lines.append(f"  {word:<12}{summary}")
    return "\n".join(lines)


def _field_arguments(config: type, known: Mapping[str, Option]) -> list[Argument]:
    """Fields of a dataclass as options; the sentence of a docstring becomes the phrase of a help."""
    texts, hints, found = field_texts(config), get_type_hints(config), []
    for field in dataclasses.fields(config):
        if field.name in known:
            text = texts[field.name].rstrip(".").replace("None = ", "by default ")
            text = text[:1].lower() + text[1:]
            kind, _ = _split(hints[field.name])
            found.append(_argument(field.name, kind, known[field.name], text, field.default, positional=False))
    return found


def _split(hint: Any) -> tuple[Any, Option]:
    """The type of a parameter without None, and what stands beside it."""
    option = Option()
    while get_origin(hint) in (Annotated, Union, types.UnionType):
        if get_origin(hint) is Annotated:
            option = hint.__metadata__[0]
        hint = next(part for part in get_args(hint) if part is not types.NoneType)
    return hint, option


def _argument(name: str, kind: Any, option: Option, text: str, default: Any, *, positional: bool) -> Argument:
    """An argument from what is known of a parameter or field."""
    flag, metavar = f"--{name.replace('_', '-')}", name.upper()
    for word in option.words.split():
        flag, metavar = (word, metavar) if word.startswith("--") else (flag, word)
    reading = _reading(kind, option, metavar)
    if "choices" in reading:
        metavar = "|".join(reading["choices"])
    if positional and default is not inspect.Parameter.empty:
        reading |= {"nargs": "?", "default": None}
    if option.names is not None:
        text += f": {', '.join(option.names())}"
    if default not in (None, (), inspect.Parameter.empty) and kind is not bool:
        text += f" (default: {default})"
    takes = "" if kind is bool else metavar
    return Argument(name, "" if positional else flag, takes, text.replace("``", ""), reading)


def _reading(kind: Any, option: Option, metavar: str) -> dict[str, Any]:
    """How a value of a type is read."""
    if kind is bool:
        return {"action": "store_true"}
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Sequence:
        repeated = {"nargs": "+"} if option.several else {"action": "append"}
        return repeated | _reading(parts[0], option, metavar)
    if origin is Literal:
        return {"choices": parts}
    return {"type": _numbers(len(parts), metavar) if origin is tuple else option.read or kind}


def _numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """Reads as many numbers, with commas between them."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(f"'{text}' is not {names}; give {count} numbers with commas between them")
        return values

    return read


def _join_numbers(words: Sequence[str]) -> list[str]:
    """The same words, with ``--start -1,2,0`` as one: alone, what begins with '-' is taken for an option."""
    joined: list[str] = []
    for word in words:
        if re.match(r"-[\d.].*,", word) and joined and joined[-1].startswith("--"):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
