"""Lamps and windows as sources of light, and the conversion between sRGB and light intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True)
class Light:
    """A rectangle that shines towards its normal."""

    centre_m: tuple[float, float, float]
    half_u_m: tuple[float, float, float]
    half_v_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    power: float
    """Radiance times area, in units in which a white surface 1 m away, face to face, is about fully lit by 1."""


def ceiling_light(x_m: float, y_m: float, z_m: float, power: float) -> Light:
    """The light of a lamp below the ceiling."""
    return Light((x_m, y_m, z_m), (0.18, 0.0, 0.0), (0.0, 0.18, 0.0), (0.0, 0.0, -1.0), power)


def window_light(
    centre_m: tuple[float, float, float], along: tuple[float, float], width_m: float, height_m: float, power: float
) -> Light:
    """The daylight of a window; ``along`` runs along its wall so that the room lies to the right of it."""
    u = (along[0] * width_m / 2, along[1] * width_m / 2, 0.0)
    return Light(centre_m, u, (0.0, 0.0, height_m / 2), (along[1], -along[0], 0.0), power)


def to_linear(srgb: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Light intensity of sRGB values in 0..1 (by the plain power law, near enough for paint)."""
    return srgb**2.2


def to_srgb(linear: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """SRGB values in 0..1 of light intensities; what is brighter than white is eased towards it."""
    soft = np.where(linear < 0.8, linear, 0.8 + 0.2 * np.tanh((linear - 0.8) / 0.2 * 0.8))
    return np.clip(soft, 0.0, 1.0) ** (1.0 / 2.2)
