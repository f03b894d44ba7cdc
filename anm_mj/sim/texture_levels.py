"""Smaller levels of textures that stay where the texture is, however far away it is seen from.

GL reads a texture from a copy of about the size at which it is drawn, and its drivers make each copy by averages over
two by two pixels. Those move what is narrower than a pixel of the copy to the middle of that pixel: the joints of a
tiled floor, which lie at the same place in each tile, slip by a centimetre as the camera comes nearer, all alike. That
misleads whoever finds its way by images. Averages over four by four, weighted 1 3 3 1, keep the centre of mass of all
that they show (the binomial filter of Burt and Adelson, The Laplacian Pyramid as a Compact Image Code, IEEE
Transactions on Communications 31(4), 1983, here between an even number of pixels).
"""

import ctypes
from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import UInt8
from PIL import Image

_RIM = 4
"""Pixels of the other side about a texture, which repeats."""


def halved(texture: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h2 w2 4"]:
    """The next smaller level of a texture that repeats, at least one pixel high and wide."""
    height, width = texture.shape[:2]
    size = max(1, width // 2), max(1, height // 2)
    rimmed = Image.fromarray(np.pad(texture, ((_RIM, _RIM), (_RIM, _RIM), (0, 0)), mode="wrap"))
    # Between an even number of pixels this filter's weights are 1 3 3 1.
    box = (_RIM, _RIM, _RIM + width, _RIM + height)
    return np.ascontiguousarray(rimmed.resize(size, Image.Resampling.BILINEAR, box))


def smooth_texture_levels(context: mujoco.MjrContext) -> None:
    """Replace the smaller levels of all plane textures of a context, which is current."""
    # The bare functions, which MuJoCo has loaded: all of OpenGL.GL takes memory.
    from OpenGL.raw.GL.VERSION import GL_1_0 as GL

    alignments = GL.GL_PACK_ALIGNMENT, GL.GL_UNPACK_ALIGNMENT
    before = [_read(GL.glGetIntegerv, name) for name in alignments]
    for name in alignments:
        GL.glPixelStorei(name, 1)
    for number in range(context.ntexture):
        if context.textureType[number] == mujoco.mjtTexture.mjTEXTURE_2D:
            _smooth(int(context.texture[number]))
    for name, value in zip(alignments, before, strict=True):
        GL.glPixelStorei(name, value)


def _smooth(texture: int) -> None:
    from OpenGL.raw.GL.VERSION import GL_1_0 as GL
    from OpenGL.raw.GL.VERSION import GL_1_1

    plane = GL.GL_TEXTURE_2D
    GL_1_1.glBindTexture(plane, texture)
    names = GL.GL_TEXTURE_WIDTH, GL.GL_TEXTURE_HEIGHT, GL_1_1.GL_TEXTURE_INTERNAL_FORMAT
    width, height, kept_as = (_read(GL.glGetTexLevelParameteriv, plane, 0, name) for name in names)
    of_four = GL.GL_RGBA, GL.GL_UNSIGNED_BYTE
    level = np.empty((height, width, 4), np.uint8)
    GL.glGetTexImage(plane, 0, *of_four, _place(level))
    number = 0
    while max(level.shape[:2]) > 1:
        level, number = halved(level), number + 1
        height, width = level.shape[:2]
        GL.glTexImage2D(plane, number, kept_as, width, height, 0, *of_four, _place(level))


def _place(array: UInt8[np.ndarray, "h w 4"]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _read(function: Callable[..., object], *names: int) -> int:
    """The number that a function of GL writes where its last argument says."""
    value = np.zeros(1, np.int32)
    function(*names, value)
    return int(value[0])
