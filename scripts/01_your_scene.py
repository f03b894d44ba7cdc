"""Makes a scene from a mesh file, checks that the robot can use it, and explores it.

    python scripts/01_your_scene.py                         # a flat of boxes that the script builds
    python scripts/01_your_scene.py --mesh my_house.glb     # a scan or a model of yours

A mesh may have any unit and axis; textures and colours are kept. More sources: docs/scenes.md.
"""

from pathlib import Path

import trimesh
import trimesh.visual

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.scene.check import check_scene
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.types import DEFAULT_FOOTPRINT

BOXES = (
    # size [m], centre [m], colour
    ((5.0, 4.0, 0.1), (2.5, 2.0, -0.05), (150, 120, 90)),  # the floor
    ((5.0, 0.1, 2.5), (2.5, 0.0, 1.25), (220, 220, 210)),  # four walls
    ((5.0, 0.1, 2.5), (2.5, 4.0, 1.25), (220, 220, 210)),
    ((0.1, 4.0, 2.5), (0.0, 2.0, 1.25), (200, 215, 225)),
    ((0.1, 4.0, 2.5), (5.0, 2.0, 1.25), (200, 215, 225)),
    ((0.1, 2.8, 2.5), (2.8, 1.4, 1.25), (230, 200, 190)),  # a wall with a passage
    ((1.2, 0.7, 0.75), (1.2, 0.5, 0.38), (120, 60, 40)),  # a table
    ((0.5, 0.5, 1.6), (4.5, 0.5, 0.8), (60, 90, 120)),  # a cupboard
)


def build(path: Path) -> Path:
    """Write the boxes as a mesh file with colours."""
    parts = []
    for size_m, centre_m, colour in BOXES:
        box = trimesh.creation.box(size_m)
        box.apply_translation(centre_m)
        box.visual = trimesh.visual.ColorVisuals(box, face_colors=(*colour, 255))
        parts.append(box)
    trimesh.util.concatenate(parts).export(path)
    return path


def main(mesh: Path | None = None, out: Path = Path("my_scene"), steps: int = 200) -> None:
    """Import, check, explore.

    Args:
        mesh: the file; without one, a flat of boxes is built.
        out: the scene folder to make; one of an earlier call is replaced.
        steps: budget of actions.
    """
    scene = import_scene(mesh or build(out.with_suffix(".ply")), out)
    found = check_scene(scene, DEFAULT_FOOTPRINT)
    print(f"{scene.name}: {scene.num_triangles} triangles, {len(found.clear_starts)} clear starts")
    for problem in found.problems:
        print(f"cannot be used: {problem}")
    if found.area is None or found.plan is None or found.problems:
        return
    print(f"the robot reaches {found.area.area_m2:.1f} m2; rooms: {len(found.plan.area_m2)}")
    for door in found.plan.doors:
        print(f"a door of {door.width_m:.2f} m; the robot {'fits' if door.fits else 'does not fit'}")

    made = anm_mj.explore_scene(out, steps=steps)
    print(f"seen to 5 cm: {made.metrics['completion_ratio']:.1f} % of the surface; {made.folder}")


if __name__ == "__main__":
    run_script(main)
