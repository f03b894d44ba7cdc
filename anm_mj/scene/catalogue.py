"""Which scenes there are."""

from __future__ import annotations

import logging

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene, read_scene_folder, scene_folders, scene_roots

_logger = logging.getLogger(__name__)


def list_scenes() -> list[Scene]:
    """All scenes that can be named: the repository's own and the user's, by name.

    A user's scene hides one of the repository with the same folder name. A folder that cannot be read is reported in
    the log and left out.
    """
    folders = {folder.name: folder for root in scene_roots() for folder in scene_folders(root)}
    scenes = []
    for name in sorted(folders):
        try:
            scenes.append(read_scene_folder(folders[name]))
        except SceneError as err:
            _logger.warning("scene %s is left out: %s", name, err)
    return scenes
