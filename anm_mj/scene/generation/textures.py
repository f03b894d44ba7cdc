"""Patterns drawn by arithmetic: wood, tiles, wallpaper, plaster, fabric, pictures.

Randomness comes from hashed lattice coordinates, so a pattern is the same in whatever order it is evaluated.
"""

import functools
import math
from collections.abc import Callable
from typing import Concatenate, ParamSpec

import numpy as np
from jaxtyping import Float64, Int64

from anm_mj.scene.generation.quads import Material

Colour = tuple[float, float, float]
_Places = Float64[np.ndarray, "n 2"]
"""Surface coordinates u, v [m]."""
_Colours = Float64[np.ndarray, "n 3"]
_BLUR_M = 0.014
_Parameters = ParamSpec("_Parameters")


def _pattern(
    texel_m: float = 0.015, glows: bool = False
) -> Callable[[Callable[Concatenate[_Places, _Parameters], _Colours]], Callable[_Parameters, Material]]:
    """Turns a function for the colours at places into one that takes its other arguments and returns the material."""

    def decorate(colours: Callable[Concatenate[_Places, _Parameters], _Colours]) -> Callable[_Parameters, Material]:
        @functools.wraps(colours)
        def material(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> Material:
            return Material(lambda uv: colours(uv, *args, **kwargs), texel_m, glows)

        return material

    return decorate


def rgb(code: str) -> Colour:
    """The colour that six hexadecimal digits stand for."""
    return int(code[:2], 16) / 255, int(code[2:4], 16) / 255, int(code[4:], 16) / 255


@_pattern()
def plain(uv: _Places, colour: Colour, roughness: float = 0.02) -> _Colours:
    """One colour with a little mottle."""
    return _tint(colour, 1.0 + roughness * (noise(uv * 18.0) - 0.5))


@_pattern(texel_m=0.05, glows=True)
def glow(uv: _Places, colour: Colour) -> _Colours:
    """One colour that shines by itself."""
    return np.tile(colour, (len(uv), 1)).astype(float)


@_pattern(texel_m=0.03)
def plaster(uv: _Places, colour: Colour, roughness: float = 0.05) -> _Colours:
    """A painted wall: faint clouds and grain."""
    return _tint(colour, 1.0 + roughness * (0.6 * noise(uv * 2.5) + 0.4 * noise(uv * 25.0, 1) - 0.5))


@_pattern()
def wood(uv: _Places, colour: Colour, contrast: float = 0.25) -> _Colours:
    """Solid wood with its grain along u."""
    return _tint(colour, 1.0 + contrast * (_grain(uv, np.zeros(len(uv), np.int64)) - 0.5))


@_pattern(texel_m=0.0125)
def planks(uv: _Places, colour: Colour, width_m: float, length_m: float, contrast: float) -> _Colours:
    """A floor of boards along u, every board of its own shade."""
    row = np.floor(uv[:, 1] / width_m).astype(np.int64)
    along = uv[:, 0] / length_m + hashed(row, np.zeros_like(row), 5)
    board = np.floor(along).astype(np.int64)
    shade = 1.0 + contrast * (hashed(row, board, 6) - 0.5) + 0.5 * contrast * (_grain(uv, row * 31 + board) - 0.5)
    gap = (_edge(uv[:, 1], width_m) < 0.006) | (_edge(along, 1.0) * length_m < 0.004)
    return _tint(colour, np.where(gap, 0.55, shade))


@_pattern(texel_m=0.0125)
def tiles(uv: _Places, first: Colour, second: Colour, size_m: float, grout: Colour, shade: float = 0.08) -> _Colours:
    """A chequerboard of square tiles; give the same colour twice for a plain one."""
    cell = np.floor(uv / size_m).astype(np.int64)
    even = (cell.sum(axis=1) % 2 == 0)[:, None]
    colours = np.where(even, first, second) * (1.0 + shade * (hashed(cell[:, 0], cell[:, 1], 7) - 0.5))[:, None]
    colours = colours * (1.0 + 0.04 * (noise(uv * 30.0) - 0.5))[:, None]
    joint = np.minimum(_edge(uv[:, 0], size_m), _edge(uv[:, 1], size_m)) < 0.007
    return np.clip(np.where(joint[:, None], grout, colours), 0.0, 1.0)


@_pattern()
def stripes(uv: _Places, first: Colour, second: Colour, period_m: float = 0.2, share: float = 0.5) -> _Colours:
    """Wallpaper or cloth with stripes along v."""
    across = uv[:, 0] % period_m
    on = _inside(np.minimum(across, share * period_m - across)) + _inside(across - period_m)
    return _mix(second, first, on) * (0.98 + 0.04 * noise(uv * 40.0))[:, None]


@_pattern()
def dots(uv: _Places, ground: Colour, dot: Colour, period_m: float = 0.22, radius_m: float = 0.035) -> _Colours:
    """Wallpaper or cloth with staggered dots."""
    row = np.floor(uv[:, 1] / period_m)
    u = uv[:, 0] + 0.5 * period_m * (row % 2)
    distance = np.hypot((u % period_m) - period_m / 2, (uv[:, 1] % period_m) - period_m / 2)
    return _mix(ground, dot, _inside(radius_m - distance)) * (0.98 + 0.04 * noise(uv * 40.0))[:, None]


@_pattern()
def leaves(uv: _Places, ground: Colour, leaf: Colour, period_m: float = 0.3) -> _Colours:
    """Wallpaper with a twining pattern."""
    x, y = uv[:, 0] / period_m * math.tau, uv[:, 1] / period_m * math.tau
    # Near their outlines these grow by about one per 5 cm.
    stem = 0.10 - np.abs(np.sin(x / 2 + 0.9 * np.sin(y / 2)))
    blade = 0.5 * (np.sin(x + 1.8 * np.sin(y / 2)) * np.sin(y) - 0.62)
    return _mix(ground, leaf, _inside(0.1 * np.maximum(stem, blade))) * (0.98 + 0.04 * noise(uv * 40.0))[:, None]


@_pattern()
def fabric(uv: _Places, colour: Colour, contrast: float = 0.16) -> _Colours:
    """Woven cloth."""
    weave = 0.6 * noise(uv * (140.0, 30.0)) + 0.4 * noise(uv * (30.0, 140.0), 1)
    return _tint(colour, 1.0 + contrast * (weave - 0.5))


@_pattern(texel_m=0.0125)
def rug(uv: _Places, ground: Colour, border: Colour, motif: Colour, size_m: tuple[float, float]) -> _Colours:
    """A carpet centred on u = v = 0 with a border and a field of diamonds."""
    inset = np.minimum(size_m[0] / 2 - np.abs(uv[:, 0]), size_m[1] / 2 - np.abs(uv[:, 1]))
    diamond = np.abs(np.abs(uv) % 0.4 - 0.2).sum(axis=1)
    colours = _mix(ground, motif, _inside(np.minimum(0.12 - diamond, diamond - 0.05)))
    colours += _inside(np.minimum(0.14 - inset, inset - 0.05))[:, None] * (np.array(border) - colours)
    colours += _inside(0.02 - inset)[:, None] * (np.array(motif) - colours)
    return colours * (0.9 + 0.2 * noise(uv * 60.0))[:, None]


@_pattern()
def stone(uv: _Places, colour: Colour, vein: Colour) -> _Colours:
    """A polished slab with veins."""
    bent = uv * 3.0 + 1.2 * np.stack([noise(uv * 4.0), noise(uv * 4.0, 1)], axis=-1)
    line = np.exp(-14.0 * np.abs(noise(bent, 2) - 0.5))
    return np.array(colour) + line[:, None] * 0.5 * (np.array(vein) - colour)


@_pattern(texel_m=0.01)
def landscape(uv: _Places, seed: int, width_m: float, height_m: float) -> _Colours:
    """A painting of hills under a sky, on u in 0..width and v in 0..height."""
    sky, sun, hills = [
        ((0.55, 0.75, 0.92), (0.98, 0.93, 0.75), (0.30, 0.48, 0.30)),
        ((0.95, 0.66, 0.45), (0.99, 0.90, 0.60), (0.36, 0.25, 0.42)),
        ((0.70, 0.86, 0.88), (0.98, 0.98, 0.95), (0.20, 0.40, 0.55)),
        ((0.93, 0.85, 0.70), (0.85, 0.35, 0.25), (0.55, 0.42, 0.28)),
    ][seed % 4]
    x, y = uv[:, 0] / width_m, uv[:, 1] / height_m
    colours = np.array(sky) + (0.25 * (1.0 - y))[:, None] * (1.0 - np.array(sky))
    disc = np.hypot((x - 0.7) * width_m, (y - 0.75) * height_m) < 0.11 * height_m
    colours = np.where(disc[:, None], sun, colours)
    for ridge in range(4):
        line = 0.55 - 0.13 * ridge + 0.16 * (noise(np.stack([x * 3.0, x * 0.0], axis=-1), seed * 9 + ridge) - 0.5)
        colours = np.where((y < line)[:, None], np.array(hills) * (1.25 - 0.22 * ridge), colours)
    return np.clip(colours, 0.0, 1.0)


@_pattern(texel_m=0.01)
def abstract(uv: _Places, seed: int, width_m: float, height_m: float) -> _Colours:
    """A painting of coloured fields, on u in 0..width and v in 0..height."""
    palette = np.array([rgb(code) for code in ("d1495b", "edae49", "00798c", "30638e", "f4f1de", "3d405b")])
    scaled = uv / (width_m, height_m) * (3.0, 4.0)
    cell = np.floor(scaled + 0.25 * np.sin(scaled[:, ::-1] * 2.0 + seed)).astype(np.int64)
    pick = (hashed(cell[:, 0], cell[:, 1], seed) * len(palette)).astype(np.int64)
    return palette[pick]


@_pattern(texel_m=0.0125, glows=True)
def view_outside(uv: _Places, seed: int, width_m: float, height_m: float) -> _Colours:
    """What a window pane shows: sky, trees, a lawn; on u in 0..width and v in 0..height."""
    x, y = uv[:, 0] / width_m, uv[:, 1] / height_m
    cloud = np.clip(noise(uv * (1.8, 4.0), seed) + noise(uv * (5.0, 9.0), seed + 1) - 0.85, 0.0, 0.5)
    colours = np.array(rgb("9fcbf0")) + (0.35 * (1.0 - y) + cloud)[:, None] * (1.0 - np.array(rgb("9fcbf0")))
    crown = 0.38 + 0.22 * noise(np.stack([x * width_m * 2.2, x * 0.0], axis=-1), seed + 2)
    leafage = 0.8 + 0.4 * noise(uv * 14.0, seed + 3)
    colours = np.where((y < crown)[:, None], np.array(rgb("7fa874")) * leafage[:, None], colours)
    colours = np.where((y < 0.22)[:, None], np.array(rgb("a9c77f")) * (0.95 + 0.1 * leafage[:, None]), colours)
    return np.clip(colours, 0.0, 1.0)


@_pattern()
def spots(uv: _Places, ground: Colour, spot: Colour, share: float = 0.35, scale: float = 9.0) -> _Colours:
    """Irregular spots: soil, a cow hide, a cork board."""
    return _mix(ground, spot, _inside((share - noise(uv * scale, 3)) / scale))


def hashed(i: Int64[np.ndarray, " n"], j: Int64[np.ndarray, " n"], seed: int = 0) -> Float64[np.ndarray, " n"]:
    """A number in 0..1 for every lattice point, the same on every machine (integer mixing by multiply and shift)."""
    x = i.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) + j.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
    x += np.uint64(seed * 0x165667B19E3779F9 % 2**64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
    return ((x ^ (x >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) / 2.0**53


def noise(uv: Float64[np.ndarray, "n 2"], seed: int = 0) -> Float64[np.ndarray, " n"]:
    """Smooth noise in 0..1 with features of unit size: hashed lattice values, blended by a cubic."""
    cell = np.floor(uv).astype(np.int64)
    t = uv - cell
    t = t * t * (3.0 - 2.0 * t)
    i, j = cell[:, 0], cell[:, 1]
    low = hashed(i, j, seed) * (1 - t[:, 0]) + hashed(i + 1, j, seed) * t[:, 0]
    high = hashed(i, j + 1, seed) * (1 - t[:, 0]) + hashed(i + 1, j + 1, seed) * t[:, 0]
    return low * (1 - t[:, 1]) + high * t[:, 1]


def _grain(uv: Float64[np.ndarray, "n 2"], board: Int64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    """Fibres along u, different on every board."""
    shifted = uv + 7.3 * hashed(board, board, 8)[:, None]
    return 0.55 * noise(shifted * (2.0, 45.0), 9) + 0.45 * noise(shifted * (6.0, 120.0), 10)


def _edge(x: Float64[np.ndarray, " n"], period: float) -> Float64[np.ndarray, " n"]:
    rest = x % period
    return np.minimum(rest, period - rest)


def _tint(colour: Colour, factor: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n 3"]:
    return np.clip(np.array(colour) * factor[:, None], 0.0, 1.0)


def _inside(depth_m: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    """Share of a texel that lies inside an outline, from the depth of its middle below the outline."""
    return np.clip(depth_m / _BLUR_M + 0.5, 0.0, 1.0)


def _mix(ground: Colour, other: Colour, share: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n 3"]:
    return np.array(ground) + share[:, None] * (np.array(other) - ground)
