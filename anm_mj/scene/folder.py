"""The scene folder, the only form in which other stages see a scene.

scene.toml     name, licence, source, how axes and units were found, bounds, start poses, hash
scene.xml      MJCF that MuJoCo loads by itself
assets/        meshes and textures of scene.xml
geometry.npz   vertices (V, 3) float32 in the world [m] and faces (F, 3) int32: the exact source triangles;
               obstacle_vertices and obstacle_faces where the robot meets something else than the camera sees
"""

import functools
import logging
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64, Int32
from msgspec import Meta, Struct

from anm_mj.errors import SceneError
from anm_mj.geometry.triangles import checked_triangles
from anm_mj.types import Pose2
from anm_mj.utils.close_names import close_name
from anm_mj.utils.files import home_folder, write_text
from anm_mj.utils.package_data import data_folder
from anm_mj.utils.read_file import convert, read_npz, read_toml

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


TOML, XML, ASSETS, GEOMETRY = "scene.toml", "scene.xml", "assets", "geometry.npz"
INDEX = "imported.txt"
"""File in the user's scenes folder that lists scenes elsewhere, one path per line."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene folder; the geometry is loaded on demand."""

    name: str
    folder: Path
    bounds_m: Float64[np.ndarray, "2 3"]
    """Smallest and largest world x, y, z of the geometry [m]; the floor is at z = 0."""
    num_triangles: int
    starts: tuple[Pose2, ...]
    """Clear poses, far apart, that reach most of the floor."""
    has_ceiling: bool
    cull_face: bool
    """True if back-face culling opens no wall."""
    licence: str
    source: str
    """Origin of the geometry: a file, or the command that generated it."""
    rooms: int | None
    budget_steps: int | None
    """Default number of steps of a run, or None."""
    hash: str
    """sha256 over geometry, texture coordinates, colours and textures."""

    @property
    def xml(self) -> Path:
        """The MJCF file."""
        return self.folder / XML

    def triangles(self) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
        """Vertices in the world [m] and faces of the exact source triangles; read-only, loaded once. Raises SceneError
        if geometry.npz cannot be read.
        """
        return _read_geometry(self.folder / GEOMETRY, self.hash)

    def obstacles(self) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
        """As :meth:`triangles`, of what the robot meets: most often the source triangles themselves. Raises SceneError
        if geometry.npz cannot be read.
        """
        return _read_geometry(self.folder / GEOMETRY, self.hash, "obstacle_")


def load_scene(name_or_path: str | Path) -> Scene:
    """The scene in a folder, or the scene of that name in the catalogue. Raises SceneError if there is no such scene,
    or the folder is not a complete scene folder.
    """
    return read_scene_folder(named_folder(name_or_path) if isinstance(name_or_path, str) else name_or_path)


def named_folder(name_or_path: str) -> Path:
    """The folder that a name or a path means here. Raises SceneError if there is no scene of that name."""
    path = Path(name_or_path)
    # A folder that merely shares its name with a scene, as /home does, does not hide the scene.
    if path.name == name_or_path and not os.path.isfile(path / TOML):
        known = _known_scenes()
        if name_or_path in known:
            path = known[name_or_path]
        elif not os.path.isdir(path):
            names = ", ".join(sorted(known)) or "none yet"
            raise SceneError(
                f"There is no scene {name_or_path!r}{close_name(name_or_path, known)}; the catalogue holds {names}. "
                "Give one of these, the path of a scene folder, or import a mesh file first."
            )
    return path


def list_scenes() -> list[Scene]:
    """All scenes that have a name, sorted: builtin, the user's, imported ones, and those in the current folder.

    A scene of the current folder hides others of the same folder name, as in :func:`load_scene`. A folder that cannot
    be read is logged and left out.
    """
    folders = _known_scenes() | {folder.name: folder for folder in _scene_folders(Path.cwd())}
    scenes = []
    for name in sorted(folders):
        try:
            scenes.append(read_scene_folder(folders[name]))
        except SceneError as err:
            _logger.warning("scene %s is left out: %s", name, err)
    return scenes


def _known_scenes() -> dict[str, Path]:
    """Folders of all named scenes, wherever the program runs: the user's hide builtin ones, these imported ones."""
    folders = [*remembered_folders(), *(folder for root in _scene_roots() for folder in _scene_folders(root))]
    return {folder.name: folder for folder in folders}


def _scene_roots() -> list[Path]:
    return [data_folder("scenes"), _user_root()]


def _user_root() -> Path:
    """The folder of the user's scenes (ANM_MJ_SCENES overrides it)."""
    data_home = os.environ.get("XDG_DATA_HOME") or home_folder() / ".local" / "share"
    return Path(os.environ.get("ANM_MJ_SCENES") or Path(data_home) / "anm_mj" / "scenes").expanduser()


def remembered_folders() -> list[Path]:
    """Existing scene folders that were made elsewhere, the latest last; none if the list cannot be read."""
    try:
        return [folder for folder in _recorded_folders() if (folder / TOML).is_file()]
    except (OSError, UnicodeDecodeError):
        return []


def remember_folder(folder: Path) -> None:
    """Record the place of a scene, so that its name works from everywhere.

    Folders below the system's temporary folder are not recorded. Failure to write the record is logged only: the path
    of the scene still works.
    """
    folder = folder.resolve()
    root, temporary = _user_root(), Path(tempfile.gettempdir()).resolve()
    if temporary in folder.parents or folder.parent in [place.resolve() for place in _scene_roots()]:
        return
    try:
        # Also those on disks that are not mounted at the moment.
        kept = [place for place in _recorded_folders() if place != folder]
        root.mkdir(parents=True, exist_ok=True)
        write_text(root / INDEX, "".join(f"{place}\n" for place in [*kept, folder]))
    except (OSError, UnicodeDecodeError) as err:
        _logger.info("%s is not recorded among the scenes (%s)", folder, err)


def _recorded_folders() -> list[Path]:
    """Folders of the record, which may be gone. Raises OSError or UnicodeDecodeError if it cannot be read."""
    index = _user_root() / INDEX
    return [Path(line) for line in index.read_text("utf-8").splitlines() if line] if index.is_file() else []


def _scene_folders(root: Path) -> list[Path]:
    """The scene folders directly below a folder, by name; none when it does not exist or may not be read."""
    try:
        return sorted(entry for entry in root.iterdir() if (entry / TOML).is_file())
    except OSError:
        return []


def read_scene_folder(folder: Path) -> Scene:
    """The scene in a folder. Raises SceneError if the folder is missing, is not a scene folder, or lacks a part."""
    if not os.path.exists(folder):  # Unlike Path.exists, never an error.
        raise SceneError(f"{folder} does not exist: give a scene's name, or the path of a scene folder.")
    if not os.path.isdir(folder):
        raise SceneError(
            f"{folder} is a file, not a scene folder: turn it into one with `anm-mj scene import` and give that."
        )
    if not os.path.isfile(folder / TOML):
        raise SceneError(f"{folder} is not a scene folder: it holds no {TOML}. Make one with `anm-mj scene import`.")
    missing = [part for part in (XML, GEOMETRY, ASSETS) if not os.path.exists(folder / part)]
    if missing:
        raise SceneError(f"Scene folder {folder} is incomplete: {', '.join(missing)} missing. Import the scene again.")
    try:
        entries = read_toml(folder / TOML)
    except (OSError, ValueError) as err:
        raise SceneError(f"{folder / TOML} cannot be read ({err}): fix it or import the scene again.") from err
    try:
        return _scene_of(folder, entries)
    except ValueError as err:
        raise SceneError(f"{folder / TOML} lacks or misstates an entry ({err}): import the scene again.") from err


def _scene_of(folder: Path, entries: dict[str, Any]) -> Scene:
    shape = convert(entries, SceneShape)
    bounds = np.asarray(shape.bounds, dtype=np.float64)
    if not ((bounds[0] <= bounds[1]).all() and (bounds[0] < bounds[1])[:2].all()):
        raise ValueError(f"bounds end before or where they begin: {shape.bounds}")
    if not shape.name.isprintable():
        raise ValueError(f"name = {shape.name!r} holds what cannot be printed")
    starts = tuple(Pose2(x, y, math.radians(yaw_deg)) for x, y, yaw_deg in shape.starts)
    same = {name: getattr(shape, name) for name in shape.__struct_fields__ if name in Scene.__dataclass_fields__}
    return Scene(**same | {"folder": folder, "bounds_m": bounds, "num_triangles": shape.triangles, "starts": starts})


@functools.lru_cache(maxsize=4)
def _read_geometry(
    path: Path, content_hash: str, prefix: str = ""
) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
    """The arrays with the prefix, or else those without; the hash invalidates the cache when a scene changes."""
    try:
        arrays = read_npz(path)
        if prefix and f"{prefix}vertices" not in arrays:
            return _read_geometry(path, content_hash)
        vertices, faces = checked_triangles(arrays[f"{prefix}vertices"], arrays[f"{prefix}faces"])
        if not len(faces):
            raise ValueError(f"{prefix}faces is empty")
    except (OSError, ValueError, KeyError) as err:
        raise SceneError(f"{path} cannot be read ({err}): import the scene again.") from err
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return vertices, faces
