"""A furnished scene of two rooms of 3 m by 3 m, made in a second by the generator."""

from pathlib import Path

import shapely

from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.building import Building, Passage, PlanRoom
from anm_mj.scene.generation.generate_scene import write_building
from anm_mj.scene.writer import SceneInfo


def make_small_scene(out: Path) -> Scene:
    """Write the scene folder: the same bytes every time."""
    building = Building(
        rooms=(
            PlanRoom("west room", "library", shapely.box(0.0, 0.0, 2.94, 3.0)),
            PlanRoom("east room", "bedroom", shapely.box(3.06, 0.0, 6.0, 3.0)),
        ),
        passages=(Passage((0, 1), shapely.box(2.94, 1.05, 3.06, 1.95)),),
    )
    return write_building(building, 1, SceneInfo("small", "tests", "MIT"), out)
