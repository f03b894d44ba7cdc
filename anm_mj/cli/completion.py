"""``anm-mj completion``: what makes a shell complete commands, options and their choices."""

import shlex
from collections.abc import Iterator
from typing import Literal, NamedTuple

from anm_mj.cli.command_line import Group, arguments, manner_options
from anm_mj.cli.streams import say_result
from anm_mj.utils.docstrings import parameter_texts

_BASH = """\
_anm_mj() {
  local words=
  case "${COMP_WORDS[*]:1:COMP_CWORD-1} " in
CASES
  esac
  [[ $words == -* && $2 != -* ]] || COMPREPLY=($(compgen -W "$words" -- "$2"))
}
complete -o default -F _anm_mj anm-mj"""
_ZSH = """\
_anm_mj() {
  local words_of_it= before="${(j: :)words[2,CURRENT-1]} "
  case $before in
CASES
  esac
  [[ -z $words_of_it || ( $words_of_it == -* && $PREFIX != -* ) ]] && _files || compadd -- ${=words_of_it}
}
compdef _anm_mj anm-mj"""


class _Place(NamedTuple):
    """Where a word may stand, and what may stand there."""

    path: tuple[str, ...]
    """The command that comes before."""
    flag: str
    """The option before, where it has choices."""
    words: dict[str, str]
    """What may stand there, with what it means."""


def completion(shell: Literal["bash", "zsh", "fish"]) -> int:
    """Print what makes a shell complete commands and options.

    In ~/.bashrc: eval "$(anm-mj completion bash)"; in ~/.zshrc, after compinit: eval "$(anm-mj completion zsh)". For
    fish: anm-mj completion fish > ~/.config/fish/completions/anm-mj.fish

    Args:
        shell: your shell
    """
    from anm_mj.cli.main import COMMANDS

    places = list(_places((), COMMANDS))
    if shell == "fish":
        say_result("\n".join(line for place in places for line in _fish(place)))
        return 0
    # The longest come first: a choice stands behind an option, and that behind its command.
    cases = "\n".join(_case(place, "words" if shell == "bash" else "words_of_it") for place in reversed(places))
    say_result((_BASH if shell == "bash" else _ZSH).replace("CASES", cases))
    return 0


def _places(path: tuple[str, ...], group: Group) -> Iterator[_Place]:
    summaries = {w: c.summary if isinstance(c, Group) else parameter_texts(c)[0] for w, c in group.commands.items()}
    yield _Place(path, "", summaries)
    for word, found in group.commands.items():
        if isinstance(found, Group):
            yield from _places((*path, word), found)
        else:
            known = arguments(found)
            flags = {one.flag: one.help for one in known if one.flag}
            flags |= {f"--{name}": text for name, text in manner_options(found).items()} | {"--help": "show help"}
            yield _Place((*path, word), "", flags)
            for one in known:
                if choices := one.reading.get("choices"):
                    yield _Place((*path, word), one.flag, dict.fromkeys(choices, ""))


def _case(place: _Place, variable: str) -> str:
    """A branch of ``case`` over the words before the one to complete."""
    before = " ".join((*place.path, "")) or " "
    is_command = next(iter(place.words)).startswith("-")
    pattern = f'"{before}"*"{place.flag} "' if place.flag else f'"{before}"' + "*" * is_command
    return f'    {pattern}) {variable}="{" ".join(place.words)}" ;;'


def _fish(place: _Place) -> Iterator[str]:
    seen = [f"__fish_seen_subcommand_from {word}" for word in place.path] or ["__fish_use_subcommand"]
    for word, text in place.words.items():
        condition = " && ".join(seen)
        if place.flag:
            what = f"-l {place.flag[2:]} -x -a {word}"
        elif word.startswith("--"):
            what = f"-l {word[2:]}"
        else:
            condition += f" && not __fish_seen_subcommand_from {' '.join(place.words)}" * bool(place.path)
            what = f"-f -a {word}"
        yield f"complete -c anm-mj -n {shlex.quote(condition)} {what} -d {shlex.quote(text)}"
