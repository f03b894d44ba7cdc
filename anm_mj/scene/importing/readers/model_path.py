"""Finds the models and files that a Gazebo world or a URDF file names by URI, and says which of them may be read.

Expands such a file where it is written with macros (xacro), and the program that does so is installed.
"""

import importlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse

from anm_mj.errors import SceneError
from anm_mj.mjcf.read_mjcf import LEVELS_UP, top_folder
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.utils.files import home_folder
from anm_mj.utils.read_file import read_bytes

XACRO = ".xacro"

VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
ROS_VARIABLES = (("ROS_PACKAGE_PATH", "."), ("AMENT_PREFIX_PATH", "share"))
"""Variables with folders of ROS, and where below each the packages are."""
_LEVELS = 5
"""A ROS package keeps its worlds up to this many folders below the folder that also holds ``models``."""
_ELSEWHERE = (
    "Not read, because they lie elsewhere than the file that names them, the folders up to three above it and the "
    "folders of models: {names}; give their folders with --model-path."
)


@dataclass(frozen=True)
class Places:
    """Where the files that a scene names are looked for, and where they may lie."""

    searched: tuple[Path, ...]
    """Folders that may hold models, best first."""
    own: tuple[Path, ...]
    """Folders whose files may be read whatever names them, links followed."""

    def holds(self, path: Path, folder: Path) -> bool:
        """Whether a file or folder that a file in ``folder`` names may be read, links followed."""
        real = Path(os.path.realpath(path))
        tops = (top_folder(Path(os.path.realpath(folder)), LEVELS_UP), *self.own)
        return any(top in (real, *real.parents) for top in tops)

    def first(self, places: Iterable[Path], folder: Path, report: ImportReport) -> Path | None:
        """The first that exists and may be read; a note, if those that exist lie elsewhere."""
        existing = [place for place in places if os.path.exists(place)]  # Unlike Path.exists, never an error.
        found = next((place for place in existing if self.holds(place, folder)), None)
        if found is None and existing:
            report.add(_ELSEWHERE, str(existing[0]))
        return found


def places_of(source: Path, others: Sequence[Path] = ()) -> Places:
    """Where files that ``source`` names may lie: up to three folders above it, and in ``others``."""
    # A file that is linked, as colcon does, has its neighbours where it really is, too.
    real, *real_others = (Path(os.path.realpath(path)) for path in (source, *others))
    return Places((), (top_folder(real.parent, LEVELS_UP), *real_others))


def world_places(world: Path, given: Sequence[Path]) -> Places:
    """Where the models that a world names are looked for, and may lie.

    Those given come first, then those of Gazebo's and ROS's environment variables, then ``models`` beside the world's
    folder or a few levels above it, and last Gazebo's own caches.
    """
    stated = list(given)
    for variable, below in (*((name, ".") for name in VARIABLES), *ROS_VARIABLES):
        entries = [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
        stated += [Path(entry).expanduser() / below for entry in entries]
    beside, above_world = [], [world.absolute().parent, *world.absolute().parent.parents][:_LEVELS]
    for above in above_world:
        beside += [above / "models", above / "gazebo_models", above]
    home = home_folder()
    caches = [home / ".gazebo" / "models"]
    for cache in (home / ".gz" / "fuel", home / ".ignition" / "fuel"):
        caches += sorted(cache.glob("*/*/models"))
    searched = tuple(folder for folder in dict.fromkeys((*stated, *beside, *caches)) if os.path.isdir(folder))
    # A folder far above the world is looked through for models, but all that is in it is not the world's own.
    models = [folder for folder in searched if folder in stated or folder not in above_world]
    media = [folder.parent / "media" for folder in models]
    return Places(searched, places_of(world, (*models, *media)).own)


def find_uri(uri: str, folder: Path, places: Places, report: ImportReport) -> Path | None:
    """The file or folder that a URI in a file of ``folder`` means, or None if it is nowhere, or may not be read.

    ``model://NAME/PATH`` and ``package://NAME/PATH`` are looked for in the folders of models and above ``folder``; an
    address of the Fuel server by its model's name and what follows; anything else is a path, from ``folder`` if it is
    relative.
    """
    uri = uri.strip()
    scheme, _, rest = uri.partition("://") if "://" in uri else ("", "", uri)
    if scheme in ("http", "https", "fuel"):
        return places.first(_fuel_places(uri, places.searched), folder, report)
    rest = unquote(rest)
    if scheme in ("model", "package"):
        return places.first(_named_places(rest.strip("/"), folder, places.searched), folder, report)
    if not rest:
        return None
    at = [Path(rest)] if os.path.isabs(rest) else [folder / rest]
    # Gazebo's own materials and meshes are named file://media/..., from its resource folder.
    at += [above / rest.lstrip("/") for root in places.searched for above in (root, root.parent)]
    return places.first(at, folder, report)


def _named_places(name: str, folder: Path, folders: Sequence[Path]) -> list[Path]:
    """Where a model, or a file in one, may be by its path below the folder that holds the model."""
    if not name:
        return []
    model, _, rest = name.partition("/")
    # Inside a model, its own name means it wherever it lies, and its siblings are the next thing to look at.
    own = [above for above in (folder, *folder.parents)[:4] if model in (above.name, _package_name(above))]
    beside = list(folder.parents)[:3]
    return [*(root / rest for root in own), *(root / name for root in (*folders, *beside))]


def _package_name(folder: Path) -> str:
    """The name of the ROS package in a folder, which may be called otherwise; empty where there is none."""
    try:
        return (ET.fromstring(read_bytes(folder / "package.xml").lstrip()).findtext("name") or "").strip()
    except (OSError, ValueError, LookupError, ET.ParseError):
        return ""


def uri_name(uri: str) -> str:
    """The name of the model that a URI means, as far as it is known without its files; the URI where it names none."""
    parts = [unquote(part) for part in uri.split("/") if part]
    at = parts.index("models") + 1 if "models" in parts[:-1] and uri.lower().startswith(("http", "fuel")) else -1
    return parts[at] if parts else uri


def _fuel_places(uri: str, folders: Sequence[Path]) -> list[Path]:
    """Where a model of the Fuel server, or a file in one, is in folders that have been downloaded.

    Addresses are https://SERVER/VERSION/OWNER/models/NAME[/VERSION[/files/PATH]]; they mean the same in small and large
    letters. Fuel's own cache writes names in small letters and keeps each version in a subfolder.
    """
    try:
        parts = [unquote(part) for part in urlparse(uri).path.split("/") if part]
    except ValueError:  # Brackets that belong to no address.
        return []
    if "models" not in parts or parts.index("models") + 1 == len(parts):
        return []
    name, *rest = parts[parts.index("models") + 1 :]
    inside = rest[rest.index("files") + 1 :] if "files" in rest else []
    found = []
    for root in folders:
        for model in _folders_called(root, name):
            if os.path.isdir(model):
                versions = [path for path in model.glob("*") if path.name.isdecimal()]
                for place in (model, *sorted(versions, key=lambda path: -int(path.name))):
                    if inside or model_file(place) is not None:
                        found.append(place.joinpath(*inside))
    return found


def _folders_called(root: Path, name: str) -> list[Path]:
    """The folder of a name, then those that differ from it in the case of letters or in blanks."""

    def plain(called: str) -> str:
        return called.lower().replace(" ", "_")

    try:
        alike = sorted(entry.name for entry in os.scandir(root) if plain(entry.name) == plain(name))
    except OSError:
        alike = []
    return [root / called for called in dict.fromkeys((name, *alike))]


def model_file(folder: Path) -> Path | None:
    """The SDF file of a model's folder: the newest that model.config names, or model.sdf; None if there is none."""
    if os.path.isfile(folder):
        return folder
    config = folder / "model.config"
    if not os.path.isfile(config):
        config = folder / "manifest.xml"
    try:
        listed = ET.fromstring(read_bytes(config).lstrip()).findall("sdf")
    except (OSError, ValueError, LookupError, ET.ParseError):
        listed = []
    named = [(_version(entry.get("version", "0")), (entry.text or "").strip()) for entry in listed]
    names = [name for _, name in sorted(named, reverse=True) if name and _stays_below(name)]
    files = [folder / name for name in (*names, "model.sdf", "model.world")]
    return next((file for file in files if os.path.isfile(file)), None)


def _stays_below(name: str) -> bool:
    return not os.path.isabs(name) and os.path.normpath(name).split(os.sep)[0] != os.pardir


def _version(text: str) -> tuple[int, ...]:
    """A version number, for sorting; Python refuses to read numbers of thousands of digits."""
    return tuple(int(number) for number in re.findall(r"\d{1,9}", text))


def expanded(src: Path) -> bytes:
    """What the macros of a file make of it, by its defaults. Raises SceneError if xacro is missing, or refuses it."""
    try:
        xacro = importlib.import_module("xacro")
    except ImportError:
        raise SceneError(
            f"{src} is written with macros: install xacro (pip install xacro), or expand it with "
            f"`xacro {src.name} > {src.name.removesuffix(XACRO)}` and give that."
        ) from None
    try:
        return xacro.process_file(str(src)).toxml().encode()
    # xacro evaluates Python expressions, which raise anything.
    except Exception as err:
        line = str(err).strip().split("\n")[0] or type(err).__name__
        raise SceneError(f"{src} cannot be expanded ({line}): fix it, or expand it with `xacro` yourself.") from err
