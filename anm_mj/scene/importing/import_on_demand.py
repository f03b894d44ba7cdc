"""Scenes given as the file that they would be imported from."""

import hashlib
import logging
import os
import shlex
from itertools import chain
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.mjcf.read_mjcf import is_mjcf, named_files
from anm_mj.scene.folder import TOML, XML
from anm_mj.scene.importing.named_scenes import find_named, is_name
from anm_mj.scene.importing.readers.model_path import ROS_VARIABLES, VARIABLES
from anm_mj.utils.files import cache_folder

_logger = logging.getLogger(__name__)

_MAX_FILES = 2000
_FRAMES = "frames.jsonl"
"""A folder that holds it is that of a run."""


def folder_of(name_or_path: str) -> str:
    """What names a scene folder for what a user gave: a file, or a data set's scene, is imported first.

    Imported scenes are kept in the user's cache folder, until the file or what lies beside it changes. Raises
    SceneError if the file cannot be imported, or the cache cannot be written.
    """
    path = Path(name_or_path)
    if is_name(name_or_path):
        path = find_named(name_or_path).path
    elif not os.path.isfile(path):
        return name_or_path
    elif path.name in (XML, TOML) and (path.parent / TOML).is_file():
        # The scene's own file means the scene.
        return str(path.parent)
    # The name of a folder has at most 255 bytes, and a letter up to four of them.
    out = cache_folder("imported") / f"{path.stem[:48]}-{_state_of(path)}"
    if not (out / TOML).is_file():
        # Its libraries take a second and 40 MB, which a run in a scene of the catalogue does not need.
        from anm_mj.scene.importing.import_scene import import_scene

        _require_writable(out.parent, name_or_path)
        import_scene(Path(name_or_path), out, name=path.stem)
        _logger.info(
            "imported %s as it is; `anm-mj scene import` has options, and keeps the scene where you want it",
            name_or_path,
        )
    return str(out)


def _require_writable(cache: Path, source: str) -> None:
    """Raises SceneError if the cache cannot be written, before the work of an import is lost."""
    try:
        cache.mkdir(parents=True, exist_ok=True)
        writable = os.access(cache, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise SceneError(
            f"{source} is imported into {cache} first, which cannot be written: name another place for the cache by "
            f"XDG_CACHE_HOME, or import it where you may write, by anm-mj scene import {shlex.quote(source)} DIR."
        )


def _state_of(path: Path) -> str:
    """Digest of path, size and age of a file, of the files that it names, and of those beside and below it and in the
    ``models`` beside its folder; and of the variables that name folders of models. Runs below it do not count.
    """
    # Names of files need not be UTF-8.
    digest = hashlib.sha256(os.fsencode(path.resolve()))
    for variable in (*VARIABLES, *(name for name, _ in ROS_VARIABLES)):
        if variable in os.environ:
            digest.update(os.fsencode(f"{variable}={os.environ[variable]}\0"))
    files = [path]
    for parent, below, names in chain(os.walk(path.parent), os.walk(path.parent.parent / "models")):
        if _FRAMES in names:
            below.clear()
            continue
        below.sort()
        files += [Path(parent) / name for name in sorted(names)]
        if len(files) > _MAX_FILES:
            break
    if is_mjcf(path):
        # An MJCF file names others that lie above it, too.
        files = [*named_files(path), *files]
    for file in files[:_MAX_FILES]:
        try:
            stat = file.stat()
        except OSError:
            continue
        digest.update(os.fsencode(f"{file}\0{stat.st_size}\0{stat.st_mtime_ns}\0"))
    return digest.hexdigest()[:12]
