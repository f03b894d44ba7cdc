"""Arrays that grow and keep what they hold."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, Shaped


def embed(
    array: Shaped[np.ndarray, "..."], shape: tuple[int, ...], start: Int[np.ndarray, " axes"], fill: float | np.generic
) -> Shaped[np.ndarray, "..."]:
    """A larger array that contains a smaller one.

    Args:
        array: the smaller one; may be empty.
        shape: size of the larger one.
        start: index of the smaller one's first cell in the larger one.
        fill: value of all other cells.
    """
    widths = [(int(a), n - int(a) - old) for a, n, old in zip(start, shape, array.shape, strict=True)]
    return np.pad(array, widths, constant_values=fill)
