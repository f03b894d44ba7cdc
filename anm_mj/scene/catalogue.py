"""Lists the available scenes."""

from __future__ import annotations

import logging
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene, known_scenes, read_scene_folder, scene_folders

_logger = logging.getLogger(__name__)


def list_scenes() -> list[Scene]:
    """All scenes that have a name, sorted: builtin, the user's, imported ones, and those in the current folder.

    A scene of the current folder hides others of the same folder name, as in :func:`load_scene`. A folder that cannot
    be read is logged and left out.
    """
    folders = known_scenes() | {folder.name: folder for folder in scene_folders(Path.cwd())}
    scenes = []
    for name in sorted(folders):
        try:
            scenes.append(read_scene_folder(folders[name]))
        except SceneError as err:
            _logger.warning("scene %s is left out: %s", name, err)
    return scenes
