"""Random colours and materials, so that rooms look different."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from anm_mj.scene.generation import textures
from anm_mj.scene.generation.quads import Material
from anm_mj.scene.generation.textures import Colour, rgb

WHITE = textures.plain(rgb("f4f1ea"), 0.01)
DARK = textures.plain(rgb("2b2d31"))
METAL = textures.plain(rgb("8f959c"))
CEILING = replace(textures.plaster(rgb("f3f1ec"), 0.02), texel_m=0.06)

_WOODS = ("b98a56", "dcb887", "6e4a32", "9c5f3c", "c79a63", "8a6a4f", "e0c79a")
_ACCENTS = (
    "3f6c8f", "a8433d", "3b6b4f", "d9a441", "6b5b95", "b86f3c", "2f5f6e", "8c2f39", "4f6b5a", "c4573c", "5aa9c9",
)  # fmt: skip
_LIGHTS = ("ecd9ad", "a9cfc9", "e7d3bf", "c3cbe0", "dff0f5", "cfe0c4", "f0dcd2", "e6e2d3", "d7dfe6", "f1e7b8", "d9cbe0")
_BOARDS = ("b5855a", "7b5137", "d8b98c", "9c5f3c", "c9a376", "a58f74", "5f4636")
_TILES = (
    ("e9e4da", "b9694c"), ("6f7f8c", "7b8b98"), ("e9e4da", "6f8fa8"), ("dcd6c8", "d3ccbc"), ("3d4f5c", "e4ddd0"),
    ("c9d3c4", "8fa58a"), ("b7674a", "a95c42"),
)  # fmt: skip
_CARPETS = ("5d6b78", "7a8a6b", "4b5d7c", "8a5f5a", "6f6a62", "3f5e5a", "8d7a5f")


@dataclass(frozen=True, eq=False)
class RoomStyle:
    """Materials of one room."""

    floor: Material
    wall: Material
    trim: Material
    wood: Material
    wood_dark: Material
    cloth: Material
    cloth_2: Material
    paint: Material
    """Painted fronts of cupboards and the like."""
    colours: tuple[Colour, ...]
    """Bright colours for small things."""


def draw_style(room_type: str, rng: np.random.Generator) -> RoomStyle:
    """Materials that suit a type of room."""
    accents = [rgb(str(code)) for code in rng.permutation(_ACCENTS)]
    light = rgb(str(rng.choice(_LIGHTS)))
    return RoomStyle(
        floor=_floor(room_type, rng),
        wall=_wall(room_type, light, accents[5], rng),
        trim=WHITE if rng.random() < 0.7 else textures.wood(rgb(str(rng.choice(_WOODS))), 0.15),
        wood=textures.wood(rgb(str(rng.choice(_WOODS)))),
        wood_dark=textures.wood(rgb(str(rng.choice(_WOODS)))),
        cloth=textures.fabric(accents[0]),
        cloth_2=textures.fabric(accents[1]),
        paint=textures.plain(accents[2], 0.04),
        colours=tuple(accents),
    )


def _floor(room_type: str, rng: np.random.Generator) -> Material:
    if room_type in ("bathroom", "kitchen", "washroom", "break room", "laboratory"):
        first, second = _TILES[int(rng.integers(len(_TILES)))]
        return textures.tiles(rgb(first), rgb(second), float(rng.choice([0.2, 0.3, 0.4])), rgb("8f8a80"))
    if room_type in ("open office", "office", "meeting", "lounge", "library", "child") and rng.random() < 0.65:
        r, g, b = rgb(str(rng.choice(_CARPETS)))
        return textures.spots((r, g, b), (min(1.0, 1.16 * r), min(1.0, 1.16 * g), min(1.0, 1.16 * b)), 0.5, 30.0)
    if room_type in ("reception", "corridor") and rng.random() < 0.4:
        if rng.random() < 0.5:
            return textures.stone(rgb("d9d2c4"), rgb("8f8578"))
        return textures.tiles(rgb("d5cec0"), rgb("c2b9a8"), 0.5, rgb("9a9388"))
    board, width = rgb(str(rng.choice(_BOARDS))), float(rng.choice([0.1, 0.14, 0.18]))
    return textures.planks(board, width, float(rng.choice([0.7, 1.1, 1.6])), float(rng.uniform(0.2, 0.4)))


def _wall(room_type: str, light: Colour, accent: Colour, rng: np.random.Generator) -> Material:
    if room_type in ("bathroom", "washroom"):
        return textures.tiles(light, light, 0.2, rgb("ffffff"), 0.05)
    r, g, b = (0.55 * a + 0.45 * b for a, b in zip(light, accent, strict=True))
    second = (r, g, b)
    chance = rng.random()
    if room_type in ("bedroom", "living", "child", "corridor", "dining", "library") and chance < 0.45:
        pattern = (partial(textures.stripes, period_m=0.18), textures.leaves, textures.dots)[int(rng.integers(3))]
        return pattern(light, second)
    return textures.plaster(light if chance < 0.85 else second)
