"""Suites: comparisons that come with the package, so that everybody can repeat them; and the scenes that a comparison
says how to make.

``tune`` is for choosing settings. ``test`` is for judging them: other seeds, never used for a choice. ``variants`` has
policies with other maps, sensors and poses, or without parts of them, in the buildings of ``test``, and ``real`` has
these buildings in the real world. ``large`` holds buildings of 40 to 60 rooms. In ``people``, people walk about.
``smoke`` takes minutes. All these are on generated scenes, given by seed and hash; ``open`` is on scenes of others. An
entry of these names the public repository, the commit and the file, the command that imports it, and the hash of the
scene that comes out, so that everybody can have the same scene although this program passes on nothing of it.
"""

import logging
import shlex
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from anm_mj.errors import BenchError, SceneError
from anm_mj.scene.folder import TOML, Scene, load_scene, read_scene_folder
from anm_mj.scene.generation.generate_scene import generate_scene
from anm_mj.utils.files import cache_folder

_logger = logging.getLogger(__name__)
_FOLDER = Path(__file__).parent / "suites"


def suite_names() -> tuple[str, ...]:
    """Names of the suites."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def suite_file(name: str) -> Path:
    """The file of a suite. Raises BenchError if there is no such suite."""
    if name not in suite_names():
        raise BenchError(f"There is no suite {name!r}; give one of {', '.join(suite_names())}.")
    return _FOLDER / f"{name}.toml"


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
    hash: Annotated[str, Meta(pattern=r"^([0-9a-f]{64})?$")] = ""
    """sha256 of the scene that comes out; empty = not checked."""

    @property
    def instructions(self) -> str:
        """The commands that make the scene, one per line."""
        # Users paste these lines into a shell, and anybody may have written the entry.
        options = "".join(f" {shlex.quote(word)}" for word in self.options.split())
        return (
            f"git clone {shlex.quote(self.repository)} {self.name}_source\n"
            f"cd {self.name}_source && git checkout {self.commit}\n"
            f"anm-mj scene import {shlex.quote(self.file)} $ANM_MJ_SCENES/{self.name}{options}"
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
