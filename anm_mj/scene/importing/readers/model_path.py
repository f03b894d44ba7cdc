"""Finds the models and files that a Gazebo world names by URI."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

_VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
_LEVELS = 5
"""A ROS package keeps its worlds up to this many folders below the folder that also holds ``models``."""


def search_folders(world: Path, given: Sequence[Path]) -> list[Path]:
    """Folders that may hold models, best first.

    Those given, then those of Gazebo's environment variables, then ``models`` beside the world's folder or a few levels
    above it, and last Gazebo's own caches.
    """
    folders = list(given)
    for variable in _VARIABLES:
        folders += [Path(entry).expanduser() for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
    for above in [world.absolute().parent, *world.absolute().parent.parents][:_LEVELS]:
        folders += [above / "models", above / "gazebo_models", above]
    home = Path.home()
    folders.append(home / ".gazebo" / "models")
    for cache in (home / ".gz" / "fuel", home / ".ignition" / "fuel"):
        folders += sorted(cache.glob("*/*/models"))
    return [folder for folder in dict.fromkeys(folders) if os.path.isdir(folder)]


def find_uri(uri: str, folder: Path, folders: Sequence[Path]) -> Path | None:
    """The file or folder that a URI in a file of ``folder`` means, or None if it is nowhere.

    ``model://NAME/PATH`` and ``package://NAME/PATH`` are looked for in ``folders`` and above ``folder``; an address of
    the Fuel server by its model's name and what follows; anything else is a path, from ``folder`` if it is relative.
    """
    uri = uri.strip()
    scheme, _, rest = uri.partition("://") if "://" in uri else ("", "", uri)
    if scheme in ("http", "https", "fuel"):
        return _find_fuel(uri, folders)
    rest = unquote(rest)
    if scheme in ("model", "package"):
        return _find_named(rest.strip("/"), folder, folders)
    places = [Path(rest)] if os.path.isabs(rest) else [folder / rest]
    # Gazebo's own materials and meshes are named file://media/..., from its resource folder.
    places += [above / rest.lstrip("/") for root in folders for above in (root, root.parent)]
    return next((place for place in places if rest and place.exists()), None)


def _find_named(name: str, folder: Path, folders: Sequence[Path]) -> Path | None:
    """A model, or a file in one, by its path below the folder that holds the model."""
    if not name:
        return None
    model = name.partition("/")[0]
    # Inside a model, its own name means it wherever it lies, and its siblings are the next thing to look at.
    own = [above.parent for above in (folder, *folder.parents)[:4] if above.name == model]
    beside = list(folder.parents)[:3]
    for root in (*own, *folders, *beside):
        if (root / name).exists():
            return root / name
    return None


def _find_fuel(uri: str, folders: Sequence[Path]) -> Path | None:
    """A model of the Fuel server, or a file in one, in a folder that has been downloaded.

    Addresses are https://SERVER/VERSION/OWNER/models/NAME[/VERSION[/files/PATH]]; Fuel's own cache writes names in
    small letters and keeps each version in a subfolder.
    """
    parts = [unquote(part) for part in urlparse(uri).path.split("/") if part]
    if "models" not in parts or parts.index("models") + 1 == len(parts):
        return None
    name, *rest = parts[parts.index("models") + 1 :]
    inside = rest[rest.index("files") + 1 :] if "files" in rest else []
    for root in folders:
        for called in dict.fromkeys((name, name.lower(), name.replace(" ", "_"))):
            model = root / called
            if model.is_dir():
                versions = sorted((path for path in model.iterdir() if path.name.isdigit()), key=lambda p: -int(p.name))
                for place in (model, *versions):
                    wanted = place.joinpath(*inside)
                    if wanted.exists() and (inside or model_file(place) is not None):
                        return wanted
    return None


def model_file(folder: Path) -> Path | None:
    """The SDF file of a model's folder: the newest that model.config names, or model.sdf; None if there is none."""
    if folder.is_file():
        return folder
    config = folder / "model.config"
    if not config.is_file():
        config = folder / "manifest.xml"
    if config.is_file():
        try:
            listed = ET.fromstring(config.read_bytes().lstrip()).findall("sdf")
        except ET.ParseError:
            listed = []
        named = [(_version(entry.get("version", "0")), (entry.text or "").strip()) for entry in listed]
        for _, name in sorted(named, reverse=True):
            if name and (folder / name).is_file():
                return folder / name
    return next((folder / name for name in ("model.sdf", "model.world") if (folder / name).is_file()), None)


def _version(text: str) -> tuple[int, ...]:
    """A version number, for sorting."""
    return tuple(int(number) for number in re.findall(r"\d+", text))
