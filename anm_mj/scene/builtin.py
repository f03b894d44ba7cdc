"""The scenes that come with the project: how each of them is made."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.scene import generate_scene
from anm_mj.scene.home.house import make_home

OWN_SCENES: dict[str, Callable[[Path], Scene]] = {
    "room": partial(generate_scene, rooms=1, seed=3, name="room"),
    "flat": partial(generate_scene, rooms=4, seed=5, name="flat"),
    "home": make_home,
    "office": partial(generate_scene, rooms=10, seed=4, style="office", name="office"),
    "residence": partial(generate_scene, rooms=24, seed=1, name="residence"),
}
"""What makes each scene, by its name, from small to large."""


def make_own_scene(name: str, out: Path) -> Scene:
    """Make one of the project's own scenes; the same bytes every time.

    Raises:
        SceneError: if there is none of that name, what it needs is missing, or the folder cannot be written.
    """
    if name not in OWN_SCENES:
        raise SceneError(f"The project has no scene {name!r} of its own: give one of {', '.join(OWN_SCENES)}.")
    return OWN_SCENES[name](out)
