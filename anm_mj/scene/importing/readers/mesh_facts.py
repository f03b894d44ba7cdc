"""What the check of a mesh file finds out for its reader."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anm_mj.errors import SceneError


class MeshFacts(NamedTuple):
    """What a mesh file says of itself before it is read."""

    decodable: bool = True
    """Whether its textures can be decoded as far as it says."""
    draco: bool = False
    """Whether triangles of it are Draco-compressed."""
    geometries: tuple[str, ...] = ()
    """COLLADA: the ids of the geometries that its scene shows."""
    uneven: bool = False
    """OBJ: whether its lines have to be put in order before they are read
    (:func:`anm_mj.scene.importing.readers.obj_check.even_text`)."""


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")
