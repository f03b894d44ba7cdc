"""Lamps and windows as sources of light, and the conversion between sRGB and light intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True)
class Light:
    """A lamp or window that shines towards its normal."""

    centre_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    power: float
    """Radiance times area, in units in which a white surface 1 m away, face to face, is about fully lit by 1."""


def to_linear(srgb: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Light intensity of sRGB values in 0..1 (by the plain power law, near enough for paint)."""
    return srgb**2.2


def to_srgb(linear: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """SRGB values in 0..1 of light intensities; what is brighter than white is eased towards it."""
    soft = np.where(linear < 0.8, linear, 0.8 + 0.2 * np.tanh((linear - 0.8) / 0.2 * 0.8))
    return np.clip(soft, 0.0, 1.0) ** (1.0 / 2.2)
