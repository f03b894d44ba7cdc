"""Shape of scene.toml, which anybody may have written; numbers are finite."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Coordinate = Annotated[float, Meta(ge=-1e5, le=1e5)]
"""[m]"""
Corner = tuple[Coordinate, Coordinate, Coordinate]
Degrees = Annotated[float, Meta(ge=-1e4, le=1e4)]
Count = Annotated[int, Meta(ge=1, le=10**9)]


class SceneShape(Struct):
    """The entries that a scene needs; others are for people to read."""

    name: Annotated[str, Meta(min_length=1, max_length=255)]
    bounds: tuple[Corner, Corner]
    triangles: Count
    starts: Annotated[list[tuple[Coordinate, Coordinate, Degrees]], Meta(max_length=1000)]
    has_ceiling: bool
    cull_face: bool
    licence: str
    source: str
    hash: str
    rooms: Count | None = None
    budget_steps: Count | None = None
