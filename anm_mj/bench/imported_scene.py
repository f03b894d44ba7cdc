"""Scenes of a comparison that belong to others: the user imports each, by the entry's own instructions.

An entry names the public repository, the commit and the file, the command that imports it, and the hash of the scene
that comes out, so that everybody can have the same scene although this program passes on nothing of it.
"""

import shlex
from typing import Annotated

from msgspec import Meta, Struct

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene, load_scene

HASH = r"^([0-9a-f]{64})?$"
"""A sha256 in hexadecimal digits, or nothing."""


class ImportedScene(Struct, forbid_unknown_fields=True):
    """An entry ``[[imported]]`` of a comparison's file."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=80)]
    repository: Annotated[str, Meta(pattern=r"^https://")]
    """Public address of the repository."""
    commit: Annotated[str, Meta(pattern=r"^[0-9a-f]{40}$")]
    file: str
    """Path of the source within the repository."""
    licence: str
    """Licence of the source, as its repository states it."""
    options: str = ""
    """Options of ``anm-mj scene import``; folders in them are relative to the repository."""
    hash: Annotated[str, Meta(pattern=HASH)] = ""
    """sha256 of the scene that comes out; empty = not checked."""

    @property
    def instructions(self) -> str:
        """The commands that make the scene, one per line."""
        # Users paste these lines into a shell, and anybody may have written the entry.
        options = "".join(f" {shlex.quote(word)}" for word in self.options.split())
        return "\n".join(
            (
                f"git clone {shlex.quote(self.repository)} {self.name}_source",
                f"cd {self.name}_source && git checkout {self.commit}",
                f"anm-mj scene import {shlex.quote(self.file)} $ANM_MJ_SCENES/{self.name}{options}",
            )
        )


def find_imported(wanted: ImportedScene) -> Scene:
    """The scene, from where scenes are looked for. Raises SceneError if it was not imported, or another scene came out
    than the entry says.
    """
    try:
        scene = load_scene(wanted.name)
    except SceneError as err:
        raise SceneError(
            f"Scene {wanted.name} belongs to others and is not here; set ANM_MJ_SCENES to a folder for scenes and "
            f"make it by:\n{wanted.instructions}"
        ) from err
    if wanted.hash and scene.hash != wanted.hash:
        raise SceneError(
            f"Scene {wanted.name} in {scene.folder} is {scene.hash[:12]}, but the comparison's file says "
            f"{wanted.hash[:12]}: results would not compare. Import it again with GAZEBO_MODEL_PATH and "
            f"GZ_SIM_RESOURCE_PATH unset, since Gazebo's own materials change the scene:\n{wanted.instructions}"
        )
    return scene
