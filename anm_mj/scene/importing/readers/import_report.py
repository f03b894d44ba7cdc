"""What readers say of a source: what in it cannot be imported, logged once at the end, and what a file is like."""

import logging
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from anm_mj.errors import SceneError

_logger = logging.getLogger(__name__)

LEFT_OUT = "Left out, because they cannot be read: {names}."
NO_MESH = "Not found: the meshes {names}, which are left out."
NO_SHAPE = "Left out, because such shapes cannot be imported: {names}."

_MAX_REASON = 200
"""Letters of what a reader says; one may quote the whole file."""


def some(names: Collection[str], number: int = 12) -> str:
    """The first names of many, and how many more there are."""
    first = ", ".join(list(names)[:number])
    return first if len(names) <= number else f"{first} and {len(names) - number} more"


def damaged(src: Path, reason: object) -> SceneError:
    """The error for a file that is not what its suffix says."""
    line = str(reason).strip().split("\n")[0] or type(reason).__name__
    line = line if len(line) <= _MAX_REASON else line[:_MAX_REASON] + "..."
    return SceneError(f"{src} is damaged or no {src.suffix[1:]} file ({line}): export it again.")


class MeshFacts(NamedTuple):
    """What a mesh file says of itself before it is read."""

    decodable: bool = True
    """Whether its textures can be decoded as far as it says."""
    draco: bool = False
    geometries: tuple[str, ...] = ()
    """COLLADA: the ids of the geometries that its scene shows."""
    latin: bool = False
    """OBJ: whether texts that are no UTF-8 are Latin-1."""
    unmapped: frozenset[bytes] = frozenset()
    """OBJ: the materials with a picture of whose faces some have texture coordinates and others have none."""
    uneven: bool = False
    """OBJ, glTF, COLLADA: whether it has to be rewritten before it is read
    (:func:`anm_mj.scene.importing.readers.obj_check.even_text`,
    :func:`anm_mj.scene.importing.readers.gltf_file.even_gltf`,
    :func:`anm_mj.scene.importing.readers.collada_check.even_collada`)."""


@dataclass
class ImportReport:
    """Missing and skipped things, by what that means for the scene."""

    _names: dict[str, dict[str, None]] = field(default_factory=dict)

    def add(self, sentence: str, name: str) -> None:
        """Note a thing once; the sentence says what comes of it, with ``{names}`` for the names of all such things."""
        self._names.setdefault(sentence, {})[name] = None

    def sentences(self) -> list[str]:
        """One sentence per problem, with the names of all that it concerns."""
        return [sentence.replace("{names}", some(names, 8)) for sentence, names in self._names.items()]

    def log(self) -> None:
        """Log every sentence as a warning."""
        for sentence in self.sentences():
            _logger.warning("%s", sentence)
