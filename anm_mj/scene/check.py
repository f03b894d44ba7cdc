"""Checks whether a robot can use a scene, and measures its rooms, doors and textures."""

import re
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from anm_mj.errors import SceneError
from anm_mj.scene.folder import ASSETS, TOML, Scene
from anm_mj.scene.importing.canonical_axes import find_floor, find_up
from anm_mj.scene.navigable import NavigableArea, floor_cells, is_clear, scene_area, with_floor_of
from anm_mj.scene.raster import border_labels, clip_to_slab, distance_cells, label_components, rasterise
from anm_mj.scene.room_segmentation import RoomPlan, segment_rooms
from anm_mj.types import Footprint, Pose2
from anm_mj.utils.files import write_text
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import read_text

_ON_ITS_SIDE = 2.0
"""How many times as level the floors along another axis must be to count as the up axis."""
_HEIGHTS_M = (0.5, 200.0)
MIN_HOLE_M2 = 0.02
"""Smaller gaps in the floor are slits between tiles [m2]."""


@dataclass(frozen=True, eq=False)
class SceneCheck:
    """Findings of a check."""

    scene: Scene
    footprint: Footprint
    floor_m: float | None
    """Height of the lowest floor, which should be 0 [m]; None if there is none."""
    texture_sizes_px: tuple[tuple[int, int], ...]
    """Width and height of every texture [px]."""
    area: NavigableArea | None = None
    """None if the robot can stand nowhere."""
    plan: RoomPlan | None = None
    holes: tuple[tuple[float, float, float], ...] = ()
    """x [m], y [m] and area [m2] of holes in the floor that are wide enough for the robot."""
    clear_starts: tuple[Pose2, ...] = ()
    blocked_starts: tuple[Pose2, ...] = ()
    problems: tuple[str, ...] = ()
    """Reasons why the robot cannot use the scene, a sentence each."""


def check_scene(scene: Scene, footprint: Footprint) -> SceneCheck:
    """Check floor, textures, rooms and starts of a scene. Raises SceneError if one of its files cannot be read."""
    vertices, faces = scene.triangles()
    triangles = vertices[faces]
    solid_vertices, solid_faces = scene.obstacles()
    if solid_faces is not faces:
        triangles = with_floor_of(triangles, solid_vertices[solid_faces])
    floor = find_floor(triangles)
    sizes = []
    for path in sorted((scene.folder / ASSETS).glob("*.png")):
        try:
            with open_picture(path) as image:
                sizes.append(image.size)
        except (OSError, ValueError) as err:
            raise SceneError(f"The texture {path} cannot be read ({err}): import the scene again.") from err
    found = SceneCheck(scene, footprint, None if floor is None else float(floor.z_m), tuple(sizes))
    misread = _misread(triangles)
    try:
        area = scene_area(scene, footprint)
    except SceneError as err:
        return replace(found, blocked_starts=scene.starts, problems=(*misread, str(err)))
    clear = tuple(start for start in scene.starts if is_clear(scene, start, footprint))
    problems = misread
    if not clear:
        near = area.nearest(area.places(1).mean(axis=0))
        problems += (
            f"None of the {len(scene.starts)} start poses is clear: put starts = [[{near[0]:.2f}, {near[1]:.2f}, 0.0]] "
            f"into {TOML}, or import the scene again.",
        )
    return replace(
        found,
        area=area,
        plan=segment_rooms(triangles, area),
        holes=_holes(triangles, area, footprint),
        clear_starts=clear,
        blocked_starts=tuple(start for start in scene.starts if start not in clear),
        problems=problems,
    )


def _misread(triangles_m: Float[np.ndarray, "f 3 3"]) -> tuple[str, ...]:
    """What looks as if axes or units of the source had been misread, a sentence each."""
    found = []
    up = find_up(triangles_m, "z", _ON_ITS_SIDE, "xyz")
    if up != "z":
        found.append(
            f"The scene lies on its side: its floors are level along {up}, not along z. Import it again with --up {up} "
            "if that is the axis of the source, or else with the axis that points up there."
        )
    height_m = float(np.ptp(triangles_m[:, :, 2]))
    if not _HEIGHTS_M[0] <= height_m <= _HEIGHTS_M[1]:
        found.append(
            f"The scene is {height_m:.3g} m high, which no building is: import it again with --scale (0.01 for cm, "
            "0.001 for mm)."
        )
    return tuple(found)


def _holes(
    triangles_m: Float[np.ndarray, "f 3 3"], area: NavigableArea, footprint: Footprint
) -> tuple[tuple[float, float, float], ...]:
    """Gaps in the floor, enclosed by floor and walls, that the robot could drive into."""
    grid = area.grid
    floor = floor_cells(triangles_m, grid, closing_cells=2)
    blocked = rasterise(clip_to_slab(triangles_m, footprint.z_min_m, footprint.z_max_m), grid)
    # Hollow walls have no floor inside either, but no robot fits there.
    roomy = distance_cells(~blocked) * grid.resolution_m >= footprint.radius_m
    gaps, num = label_components(~floor & ~blocked)
    found = []
    for gap in np.setdiff1d(np.arange(1, num + 1), border_labels(gaps)).tolist():
        cells = gaps == gap
        size_m2 = float(np.count_nonzero(cells)) * grid.resolution_m**2
        if size_m2 >= MIN_HOLE_M2 and (cells & roomy).any():
            rows, cols = np.nonzero(cells)
            x, y = grid.centres_m(rows.mean(), cols.mean())
            found.append((round(float(x), 2), round(float(y), 2), round(size_m2, 3)))
    return tuple(found)


def disable_backface_culling(scene: Scene) -> bool:
    """Set ``cull_face = false`` in scene.toml, so that both sides are drawn; False if it is set already. Raises
    SceneError if the file cannot be written.
    """
    path = scene.folder / TOML
    try:
        text = read_text(path)
        changed = re.sub(r"(?m)^cull_face\s*=\s*true\s*$", "cull_face = false", text)
        if changed == text:
            return False
        write_text(path, changed)
    except (OSError, ValueError) as err:
        raise SceneError(f"{path} cannot be written ({err}): set cull_face = false in it by hand.") from err
    return True
