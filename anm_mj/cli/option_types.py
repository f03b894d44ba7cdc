"""What options hold that several commands have."""

from argparse import ArgumentTypeError
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from anm_mj.cli.command_line import Fields, Option
from anm_mj.errors import ConfigError
from anm_mj.planning.policies.registry import policies


def _place(text: str) -> Path:
    if not text.strip():
        raise ArgumentTypeError("it is empty; name a file or folder, or leave the option out")
    return Path(text)


def _port(text: str) -> int:
    if not (text.isdecimal() and len(text) <= 5 and 1 <= int(text) <= 65535):
        raise ArgumentTypeError(f"{text!r} is no port; give a number from 1 to 65535")
    return int(text)


Count = Annotated[int, Option("N")]
NewFile = Annotated[Path, Option("FILE", _place)]
NewFolder = Annotated[Path, Option("DIR", _place)]
Port = Annotated[int, Option("PORT", _port)]
Settings = Annotated[Sequence[str], Option("--set NAME=VALUE")]


def require_read(settings: Sequence[str], *read: str) -> None:
    """Accept the settings of groups that a command reads, such as ``"model"``, and others by their names. Raises
    ConfigError for one that has no effect.
    """
    for text in settings:
        name = text.partition("=")[0].strip()
        if not {name, name.partition(".")[0]} & set(read):
            raise ConfigError(f"--set {name} has no effect here; this command reads settings of {', '.join(read)}.")


def refuse_idle(given: Mapping[str, Any], why: str) -> None:
    """Raises ConfigError for an option without effect that was given, by its name; the value of one that was not is
    None, or False. ``why`` says the reason and what to do.
    """
    for flag, value in given.items():
        if value is not None and value is not False:
            raise ConfigError(f"{flag} is {'given' if value is True else value}, but {why}.")


def policy_names(*, has_truth: bool = True) -> Iterator[str]:
    """The names of the policies that can be used, with a few words where one has any."""
    for name, entry in policies().items():
        if has_truth or not entry.needs_truth:
            yield f"{name} ({entry.summary})" if entry.summary else name


def run_fields(*fields: str, **names: Callable[[], Iterable[str]]) -> Fields:
    """Fields of ``RunConfig`` as options, all where none is given; ``names`` gives what the help of a field lists."""

    def known() -> tuple[type, Mapping[str, Option]]:
        from anm_mj.config import OPTIONS, RunConfig

        return RunConfig, {field: Option(OPTIONS[field], names=names.get(field)) for field in fields or OPTIONS}

    return Fields(known)


def require_ending(out: Path | None, endings: Sequence[str]) -> None:
    """Accept the place of a picture by its ending. Raises ConfigError if it ends in no kind that can be written."""
    if out is not None and out.suffix not in endings:
        raise ConfigError(f"--out is '{out}'; give a file that ends in {' or '.join(endings)}.")
