"""Textures of a compiled model as pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    import mujoco


def texture_image(model: mujoco.MjModel, texture: int) -> UInt8[np.ndarray, "h w 3"]:
    """A texture of the model; row 0 is at v = 0, the six faces of a cube lie below one another."""
    height, width, channels = model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture]
    first = model.tex_adr[texture]
    image = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
    return np.repeat(image, 3, axis=2) if channels == 1 else image[:, :, :3].copy()
