"""The checks of calls that `make test` makes find a wrong shape."""

from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Float64, TypeCheckError

from tests import typechecker


def some(fn):
    return typechecker._check_some_calls(fn, typechecker=typechecker.check)


@some
def lengths(points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n"]:
    return np.hypot(points[:, 0], points[:, 1])[: 1 if (points < 0).any() else None]


RIGHT, WRONG, WRONG_RESULT = np.ones((3, 2)), np.ones((3, 3)), -np.ones((3, 2))


@pytest.mark.parametrize("wrong", [WRONG, WRONG_RESULT])
def test_a_wrong_shape_is_found_among_the_first_calls_and_soon_among_later_ones(wrong):
    with pytest.raises(TypeCheckError):
        lengths(wrong)
    for _ in range(typechecker.FIRST):
        lengths(RIGHT)
    with pytest.raises(TypeCheckError):
        [lengths(wrong) for _ in range(typechecker.LATER)]


def test_members_and_fields_are_checked():
    @some
    @dataclass
    class Line:
        ends: Float64[np.ndarray, "2 2"]

    class Way:
        @some
        @staticmethod
        def copied(points: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, "n 2"]:
            return points

        @some
        @property
        def start(self) -> Float64[np.ndarray, "2"]:
            return RIGHT

    for call in (lambda: Line(WRONG), lambda: Way.copied(WRONG), lambda: Way().start):
        with pytest.raises(TypeCheckError):
            call()
    Line(np.zeros((2, 2)))
    Way.copied(RIGHT)
