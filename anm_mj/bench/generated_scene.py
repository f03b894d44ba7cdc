"""Scenes of a comparison that are generated, given by seed and hash, so that everybody has the same ones."""

import logging
from typing import Annotated, Literal

from msgspec import Meta, Struct

from anm_mj.errors import SceneError
from anm_mj.scene.folder import TOML, Scene, read_scene_folder
from anm_mj.scene.generation.generate_scene import generate_scene
from anm_mj.utils.files import cache_folder

_logger = logging.getLogger(__name__)


class GeneratedScene(Struct, forbid_unknown_fields=True):
    """An entry ``[[generated]]`` of a comparison's file."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_.-]+$", max_length=80)]
    rooms: Annotated[int, Meta(ge=1, le=60)]
    seed: Annotated[int, Meta(ge=0, le=2**31)]
    kind: Literal["apartment", "office"] = "apartment"
    hash: str = ""
    """sha256 of the scene that comes out; empty = not checked."""


def provide(wanted: GeneratedScene) -> Scene:
    """The scene, generated into the user's cache unless it is there. Raises SceneError if this version makes another
    scene than the file says, or the cache cannot be written.
    """
    folder = cache_folder("suites") / f"{wanted.name}-{wanted.rooms}-{wanted.seed}-{wanted.kind}"
    scene = read_scene_folder(folder) if (folder / TOML).is_file() else None
    if scene is None or (wanted.hash and scene.hash != wanted.hash):
        _logger.info("Generating scene %s (%d rooms).", wanted.name, wanted.rooms)
        folder.parent.mkdir(parents=True, exist_ok=True)
        scene = generate_scene(folder, wanted.rooms, wanted.seed, wanted.kind, wanted.name)
    if wanted.hash and scene.hash != wanted.hash:
        raise SceneError(
            f"Scene {wanted.name} comes out as {scene.hash[:12]}, but its file says {wanted.hash[:12]}: results would "
            "not compare with those published. Use the version of this program that the file belongs to, or leave hash "
            "out."
        )
    return scene
