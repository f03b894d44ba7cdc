"""How many steps a run in a scene has, where nobody says."""

import math

from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import scene_area
from anm_mj.types import DEFAULT_FOOTPRINT

STEPS_PER_M2, BASE_STEPS = 10, 200
"""Budget by floor: the paper's budgets by rooms leave 3 steps per square metre to a wide office, 20 to a small room."""


def default_steps(scene: Scene, budget: str = "scene") -> int:
    """Steps by the floor that the default robot reaches, in hundreds, or by another rule. ``budget`` is ``scene`` (what
    the scene names, or else by floor), ``area`` (by floor) or ``rooms`` (the paper's, by the number of rooms). Raises
    SceneError if the scene has no floor that the robot reaches.
    """
    if budget == "rooms":
        rooms = scene.rooms or 1
        return 1000 if rooms <= 5 else 2000 if rooms < 20 else 10_000
    if budget == "scene" and scene.budget_steps is not None:
        return scene.budget_steps
    area_m2 = scene_area(scene, DEFAULT_FOOTPRINT).area_m2
    return 100 * math.ceil((BASE_STEPS + STEPS_PER_M2 * area_m2) / 100)
