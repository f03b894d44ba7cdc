"""Mip levels of textures that stay where the textures are, however far away they are seen from.

Drivers make them by averages over two by two texels. Those move what is narrower than a texel of the next level to the
middle of that texel: the joints of a tiled floor, which lie at the same place in each tile, slip by a centimetre as the
camera comes nearer, all alike. That misleads whoever finds its way by images.
"""

import ctypes
from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt8
from PIL import Image

_RIM = 4
"""Texels of the other side about a texture, which repeats."""


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


def halved(texture: UInt8[np.ndarray, "h w c"]) -> UInt8[np.ndarray, "h2 w2 c"]:
    """The next mip level of a texture that repeats, at least one texel high and wide.

    Weights of 1 3 3 1 keep the centre of mass of all that a texture shows, however small (the binomial filter of Burt
    and Adelson, The Laplacian Pyramid as a Compact Image Code, IEEE Transactions on Communications 31(4), 1983, between
    an even number of texels).
    """
    height, width = texture.shape[:2]
    size = max(1, width // 2), max(1, height // 2)
    rimmed = np.pad(texture, ((_RIM, _RIM), (_RIM, _RIM), (0, 0)), mode="wrap")
    # Not as RGBA: transparent texels would turn black, and not everything that is drawn asks for transparency.
    mode = "RGBX" if texture.shape[2] == 4 else "RGB"
    picture = Image.frombuffer(mode, rimmed.shape[1::-1], rimmed, "raw", mode, 0, 1)
    # Where both sides are even, this filter has those weights.
    box = (_RIM, _RIM, _RIM + width, _RIM + height)
    return np.ascontiguousarray(picture.resize(size, Image.Resampling.BILINEAR, box))


def _mip_levels(texture: UInt8[np.ndarray, "h w 3"]) -> list[UInt8[np.ndarray, "_ _ 3"]]:
    """A texture and its mip levels."""
    levels = [texture]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halved(levels[-1]))
    return levels


class MipmapTextures:
    """Textures with their mip levels, each half the size of the previous one, and a bilinear filter."""

    def __init__(self, textures: tuple[UInt8[np.ndarray, "_ _ 3"], ...]):
        levels = [_mip_levels(texture) for texture in textures] or [[np.full((1, 1, 3), 255, np.uint8)]]
        deepest = max(len(level) for level in levels)
        shapes = np.array(
            [[(*texture[min(i, len(texture) - 1)].shape[:2],) for i in range(deepest)] for texture in levels]
        )
        self._height, self._width = shapes[:, :, 0], shapes[:, :, 1]
        self._first = np.zeros((len(levels), deepest), np.int64)
        flat, used = [], 0
        for i, texture in enumerate(levels):
            for level in range(deepest):
                self._first[i, level] = used if level < len(texture) else self._first[i, level - 1]
                if level < len(texture):
                    flat.append(texture[level].reshape(-1, 3))
                    used += len(flat[-1])
        # Four bytes per texel, so that one look-up fetches all channels.
        packed = np.full((used, 4), 255, np.uint8)
        packed[:, :3] = np.concatenate(flat)
        self._packed = packed.view(np.uint32).ravel()

    def size_px(self, texture: Int32[np.ndarray, " n"]) -> Int64[np.ndarray, "n 2"]:
        """Width and height of textures [px]."""
        return np.stack([self._width[texture, 0], self._height[texture, 0]], axis=1)

    def sample(
        self,
        texture: Int32[np.ndarray, " n"],
        uv: Float32[np.ndarray, "n 2"],
        texels_per_pixel: Float32[np.ndarray, " n"],
    ) -> Float32[np.ndarray, "n 3"]:
        """Colours in 0..255 at texture coordinates (v down; the texture repeats outside 0..1). The size of a pixel in
        the texture selects the mip level, whose four nearest texels are interpolated.
        """
        level = np.round(np.log2(np.maximum(texels_per_pixel, 1.0))).astype(np.int64)
        level = np.minimum(level, self._first.shape[1] - 1)
        width, height, first = self._width[texture, level], self._height[texture, level], self._first[texture, level]
        x = uv[:, 0] * width.astype(np.float32) - np.float32(0.5)
        y = uv[:, 1] * height.astype(np.float32) - np.float32(0.5)
        col, row = np.floor(x), np.floor(y)
        right, down = (x - col)[:, None], (y - row)[:, None]
        col, row = col.astype(np.int64) % width, row.astype(np.int64) % height
        next_col, next_row = (col + 1) % width, (row + 1) % height

        def along(line: Int64[np.ndarray, " n"]) -> Float32[np.ndarray, "n 3"]:
            left, beside = (
                self._packed[line + at].view(np.uint8).reshape(-1, 4)[:, :3].astype(np.float32)
                for at in (col, next_col)
            )
            return left + right * (beside - left)

        upper, lower = along(first + row * width), along(first + next_row * width)
        return upper + down * (lower - upper)
