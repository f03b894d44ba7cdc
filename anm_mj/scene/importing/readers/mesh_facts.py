"""What the check of a mesh file finds out for its reader."""

from pathlib import Path
from typing import NamedTuple

from anm_mj.errors import SceneError

_MAX_REASON = 200
"""Letters of what a reader says; one may quote the whole file."""


class MeshFacts(NamedTuple):
    """What a mesh file says of itself before it is read."""

    decodable: bool = True
    """Whether its textures can be decoded as far as it says."""
    draco: bool = False
    geometries: tuple[str, ...] = ()
    """COLLADA: the ids of the geometries that its scene shows."""
    uneven: bool = False
    """OBJ, glTF, COLLADA: whether it has to be rewritten before it is read
    (:func:`anm_mj.scene.importing.readers.obj_check.even_text`,
    :func:`anm_mj.scene.importing.readers.gltf_file.even_gltf`,
    :func:`anm_mj.scene.importing.readers.collada_check.even_collada`)."""


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    line = line if len(line) <= _MAX_REASON else line[:_MAX_REASON] + "..."
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")
