"""What a reader found in a source: drawable parts, and what the source's kind says about axes, units and rights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from anm_mj.scene.submesh import Part

UNKNOWN_LICENCE = "unknown"


@dataclass(frozen=True)
class Content:
    """A scene as it was read, in the source's own axes and units."""

    parts: list[Part]
    source: str
    """Where it comes from, in words: the data set and the file."""
    licence: str = UNKNOWN_LICENCE
    up: Literal["x", "y", "z"] = "z"
    """The axis that usually points up in sources of this kind."""
    up_certainty: float = 1.25
    """How many times better another axis must look to be believed instead
    (:func:`anm_mj.scene.importing.canonical_axes.find_up`); infinite where the format fixes the axis."""
    scale: float | None = None
    """Metres per unit, or None to find it from the size."""
