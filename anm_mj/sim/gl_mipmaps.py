"""Mip levels of the textures of a GL context that stay where the textures are, however far away they are seen from.

Drivers make them by averages over two by two texels. Those move what is narrower than a texel of the next level to the
middle of that texel: the joints of a tiled floor, which lie at the same place in each tile, slip by a centimetre as the
camera comes nearer, all alike. That misleads whoever finds its way by images.
"""

import ctypes
from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import UInt8

from anm_mj.sim.mipmap import halved


def smooth_mipmaps(context: mujoco.MjrContext) -> None:
    """Replace the mip levels of all plane textures of a context, which is current."""
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
