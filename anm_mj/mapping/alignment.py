"""What an engine is given, and gives, to register a frame to its field.

A pose is varied by a displacement of the camera in the world [m] and a rotation vector about world axes through the
camera [rad]: ``R' = exp(w) R``, ``t' = t + v``. The distance of a point to the surface is the signed distance over the
length of its gradient, with that direction as the normal; to first order that is the distance to the zero-crossing,
however the field is scaled.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64


@dataclass(frozen=True)
class FramePoints:
    """Some pixels of a frame, as points in the camera's axes."""

    camera_m: Float32[np.ndarray, "n 3"]
    """x right, y down, z forward [m]."""
    rgb: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    variance_m2: Float32[np.ndarray, " n"]
    """Of the measured distance along the ray [m2]."""
    trust: Float32[np.ndarray, " n"]
    """Factor on a point's weight; 0 leaves it out."""

    def __len__(self) -> int:
        return len(self.trust)

    def every(self, step: int) -> FramePoints:
        """Each ``step``-th of them."""
        return FramePoints(*(np.ascontiguousarray(part[::step]) for part in vars(self).values()))

    def about(self, count: int) -> FramePoints:
        """So many of them, or up to twice as many, evenly spread."""
        return self.every(max(1, len(self) // count))


class AlignSettings(NamedTuple):
    """How residuals are weighted."""

    kernel: float
    """Width of the Geman-McClure kernel on distances, in standard deviations."""
    field_deviation_m: float
    """Standard deviation of the field's surface along its normal, beside the sensor's noise [m]."""
    color_deviation: float
    """Standard deviation of a colour channel in [0, 1]; 0 leaves colours out."""
    color_kernel: float
    """Width of the kernel on colours, in standard deviations."""
    saturation: float = 0.9
    """Points where the SDF is a larger fraction of the truncation are left out: its gradient vanishes."""
    least_slope: float = 0.3
    """Points where the SDF's gradient is shorter are left out."""
    most_slope: float = 3.0
    """Points where it is longer are left out."""


class NormalEquations(NamedTuple):
    """Sums over a frame's residuals: row 0 of distances, row 1 of colours."""

    hessian: Float64[np.ndarray, "2 6 6"]
    """Weighted sums of the products of Jacobians (Gauss-Newton's matrix), by displacement, then rotation."""
    gradient: Float64[np.ndarray, "2 6"]
    """Weighted sums of Jacobian times residual: half the gradient of the cost."""
    facts: Float64[np.ndarray, "2 3"]
    """Robust cost, sum of the robust weights in [0, 1], number of points that counted."""
