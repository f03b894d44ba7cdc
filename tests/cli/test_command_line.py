"""A command line made from the signature and the docstring of a function."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from anm_mj.cli.command_line import Fields, Group, Manner, Option, Report, arguments, commands, find, parse
from anm_mj.cli.main import main


@dataclass
class Fruit:
    """Something to eat."""

    colour: str = "red"
    """Its colour. Most are red."""
    mass_g: int | None = None
    """Mass [g]; None = the kind's own."""
    seeds: bool = True
    """Not given on the command line."""


def eat(
    fruit: str,
    place: Path | None = None,
    *,
    bites: int = 3,
    at: Annotated[tuple[float, float] | None, Option("--where X,Y")] = None,
    with_: Annotated[Sequence[str], Option("--with NAME", names=lambda: ["milk", "honey"])] = (),
    words: Annotated[Sequence[str], Option("WORD", several=True)] = (),
    peel_it: bool = False,
    how: Literal["slowly", "fast"] = "slowly",
    **fields: Annotated[Any, Fields(lambda: (Fruit, {"colour": Option(), "mass_g": Option("--mass G")}))],
) -> int:
    """Eat a fruit.

    One must be hungry.

    Args:
        fruit: what to eat
        place: where to sit
        bites: how often to bite,
            at the most
        at: the plate
        with_: what to it
        words: of thanks
        peel_it: take 100 % of the peel off
        how: at what speed
        **fields: of the fruit
    """
    return 0


GROUP = Group("Food.", {"eat": eat, "more": Group("More food.", {"eat": eat})})


def parsed(*words):
    return parse("food eat", eat, words)[0]


def test_only_what_is_given_is_handed_over():
    assert parsed("apple") == {"fruit": "apple"}
    assert parse("food eat", eat, ["apple", "-v"]) == ({"fruit": "apple"}, Manner(verbose=True))


def test_json_is_an_option_of_what_returns_a_report(capsys):
    def taste() -> Report:
        """Taste."""
        return Report({})

    assert parse("food taste", taste, ["--json"]) == ({}, Manner(json=True))
    assert parse("food taste", taste, ["-q"]) == ({}, Manner(quiet=True))
    for command, words, said in ((eat, ["apple", "--json"], "unrecognized arguments: --json"),
                                 (taste, ["-q", "-v"], "not allowed with argument")):  # fmt: skip
        with pytest.raises(SystemExit):
            parse("food", command, words)
        assert said in capsys.readouterr().err


def test_types_are_read():
    given = parsed("apple", "table", "--bites", "2", "--where", "-1,2.5", "--peel-it", "--how", "fast", "--mass=7")
    assert given == {
        "fruit": "apple", "place": Path("table"), "bites": 2, "at": (-1.0, 2.5), "peel_it": True, "how": "fast",
        "mass_g": 7,
    }  # fmt: skip
    assert parsed("apple", "--with", "a", "--with", "b", "--words", "c", "d") == {
        "fruit": "apple", "with_": ["a", "b"], "words": ["c", "d"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "the following arguments are required: FRUIT"),
        (["apple", "--bites", "many"], "argument --bites: invalid int value: 'many'"),
        (["apple", "--where", "1"], "argument --where: '1' is not X,Y; give 2 numbers with commas between them"),
        (["apple", "--where", "-1,nan"], "'-1,nan' is not X,Y"),
        (["apple", "--how", "fsat"], "(did you mean fast?)"),
        (["apple", "--peelit"], "unrecognized arguments: --peelit (did you mean --peel-it?)"),
        (["apple", "--seeds"], "unrecognized arguments: --seeds"),
    ],
)
def test_wrong_words_are_one_sentence(words, said, capsys):
    with pytest.raises(SystemExit) as end:
        parsed(*words)
    assert end.value.code == 2
    sentence = capsys.readouterr().err
    assert said in sentence
    assert sentence.startswith("food eat: ")
    assert sentence.endswith("; see food eat --help.\n")
    assert sentence.count("\n") == 1


def test_the_docstrings_are_the_help(capsys):
    with pytest.raises(SystemExit) as end:
        parsed("--help")
    assert end.value.code == 0
    shown = " ".join(capsys.readouterr().out.split())
    for text in ("Eat a fruit.", "One must be hungry.", "--bites BITES how often to bite, at the most (default: 3)",
                 "--where X,Y the plate", "what to it: milk, honey", "take 100 % of the peel off",
                 "--how slowly|fast at what speed (default: slowly)",
                 "--colour COLOUR its colour. Most are red (default: red)",
                 "--mass G mass [g]; by default the kind's own"):  # fmt: skip
        assert text in shown


def test_what_has_further_options_may_be_a_function():
    def sit(chair: str, **more: Annotated[Any, eat]) -> int:
        """Sit down.

        Args:
            chair: where
            **more: of eating
        """
        return 0

    assert [one.name for one in arguments(sit) if not one.flag] == ["chair"]
    assert {"bites", "colour", "peel_it"} < {one.name for one in arguments(sit)}


def test_commands_are_found_by_their_words(capsys):
    assert find("food", GROUP, ["more", "eat", "apple"]) == ("food more eat", eat, ["apple"])
    assert [name for name, _ in commands("food", GROUP)] == ["food eat", "food more eat"]
    for words, said in ((["eet"], "food: invalid choice: 'eet' (choose from eat, more) (did you mean eat?)"),
                        (["more"], "food more: name one of eat")):  # fmt: skip
        with pytest.raises(SystemExit):
            find("food", GROUP, words)
        assert said in capsys.readouterr().err
    with pytest.raises(SystemExit) as end:
        find("food", GROUP, ["--help"])
    assert end.value.code == 0
    assert "eat         Eat a fruit.\n  more        More food." in capsys.readouterr().out


@pytest.mark.parametrize("words", [["scene", "list"], ["explore", "home"], ["map", "walk"], ["bench", "own.toml"]])
def test_a_folder_that_is_gone_is_named(tmp_path, monkeypatch, capsys, words):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(words) == 2
    assert capsys.readouterr().err == "anm-mj: The folder that you are in is gone; change to another one.\n"
