"""How far the map's surface is expected to lie from the true one, from the last-layer variance.

The variance alone orders places; its scale means nothing. The expected error is a constant plus a power of it, fitted
to the distance between the zero-crossings and the true surface in three scenes after whole runs with the default preset
(``scripts/fit_expected_error.py``; docs/experiments/improvement.md). The constant stays, however often a place is
looked at. The rest falls as observations are added, because the variance is the leverage over the number of pixels that
training uses.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

SCALE_M = 0.0014
"""Reducible part of the expected error at a variance of 1 [m]; the constant beside it is 0.0018 m."""
EXPONENT = 0.54
"""The reducible part grows with this power of the variance."""


def reducible_error_m(variance: Float[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
    """The part of the expected error that more observations can take away [m].

    Args:
        variance: Last-layer variance over the observation count (:mod:`anm_mj.mapping.last_layer`).
    """
    return (SCALE_M * variance**EXPONENT).astype(np.float32)
