"""Joints of a source's parts: how a door leaf turns or slides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True, eq=False)
class Joint:
    """A hinge or a slide, in the source's axes."""

    hinge: bool
    axis: Float64[np.ndarray, "3"]
    """Direction of length 1."""
    anchor_m: Float64[np.ndarray, "3"]
    """A point on a hinge's axis [m]."""
    value: float
    """Where the joint stands [rad, m]."""
    limits: tuple[float, float] | None
    """Smallest and largest value [rad, m]; None if there are none."""

    def motion(self, to: float) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3"]]:
        """Rotation and shift that bring what hangs on the joint from where it stands to another value."""
        amount = to - self.value
        if not self.hinge:
            return np.eye(3), self.axis * amount
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + np.sin(amount) * cross + (1.0 - np.cos(amount)) * (cross @ cross)
        return rotation, self.anchor_m - rotation @ self.anchor_m
