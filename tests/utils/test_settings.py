from dataclasses import dataclass

import pytest

from anm_mj.utils.settings import Settings, limits_of, setting


@dataclass(frozen=True)
class Example(Settings, group="example", error=ValueError):
    plain: float = 1.0
    share: float = setting(0.5, at_least=0.0, at_most=1.0)
    percentile: float = setting(50.0, below=100.0)
    turns: int = setting(1)
    way: str = setting("left", choices=("left", "right"))
    name: str = "any"
    on: bool = False


def test_defaults_are_within_their_limits():
    Example()


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"plain": 0.0}, "example.plain is 0.0; it must be a number above zero and at most 1000000."),
        ({"plain": 1e9}, "at most 1000000"),
        ({"plain": float("nan")}, "above zero"),
        ({"plain": float("inf")}, "above zero"),
        ({"turns": 10**400}, "at most 1000000"),
        ({"share": 1.5}, "at least 0 and at most 1"),
        ({"share": -0.5}, "at least 0 and at most 1"),
        ({"percentile": 100.0}, "above zero and below 100"),
        ({"way": "up"}, "example.way is 'up'; it must be one of left, right."),
    ],
)
def test_a_value_beyond_the_limits_is_named_with_them(value, said):
    with pytest.raises(ValueError, match=said):
        Example(**value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("plain", ""),
        ("share", "≥ 0, ≤ 1"),
        ("percentile", "> 0, < 100"),
        ("turns", ""),
        ("way", "`left`, `right`"),
        ("on", ""),
    ],
)
def test_a_range_in_a_few_characters(name, said):
    assert limits_of(Example(), name).text == said


def test_a_limit_may_be_reached_where_it_is_included():
    Example(share=0.0)
    Example(share=1.0)
