"""How far the map's surface is expected to lie from the true one, from the last-layer variance.

The variance alone orders places; its scale means nothing. The expected error is a constant plus a power of it, fitted
to the distance between the zero-crossings and the true surface in three scenes after whole runs with the default preset
(``scripts/fit_expected_error.py``; docs/experiments/improvement.md). The constant stays, however often a place is
looked at. The rest falls as observations are added, because the variance is the leverage over the number of pixels that
training uses.
"""

import numpy as np
from jaxtyping import Float

from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.last_layer import last_layer_variance, observation_density
from anm_mj.types import SurfaceErrors

SCALE_M = 0.0014
"""Reducible part of the expected error at a variance of 1 [m]."""
CONSTANT_M = np.float32(0.0018)
"""The part beside it that stays [m]."""
EXPONENT = 0.54
"""The reducible part grows with this power of the variance."""


def expected_errors(
    backend: MapperBackend, occupancy: DepthOccupancy, points_m: Float[np.ndarray, "n 3"], density_exponent: float
) -> SurfaceErrors:
    """The part of the expected error at surface points [m] that more observations can take away.

    It comes from the last-layer variance, whatever method the map is configured for: that predicts the error best.
    ``density_exponent`` is that of the schedule that the map was trained by.
    """
    variance = last_layer_variance(backend, occupancy, points_m, density_exponent)
    error_m = (SCALE_M * variance**EXPONENT).astype(np.float32)
    count = observation_density(occupancy, points_m).astype(np.float32)
    return SurfaceErrors(points_m.astype(np.float32, copy=False), error_m, count, (1.0 - density_exponent) * EXPONENT)
