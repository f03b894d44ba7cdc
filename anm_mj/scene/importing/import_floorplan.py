"""Imports floor plans in JSON."""

import logging
import zlib
from pathlib import Path
from typing import Any

from shapely.errors import ShapelyError

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.generation.building import Building
from anm_mj.scene.generation.generate_scene import write_building
from anm_mj.scene.importing.floorplans.houseexpo import is_houseexpo, read_houseexpo
from anm_mj.scene.importing.floorplans.plan1 import is_plan1, read_plan1
from anm_mj.scene.importing.floorplans.procthor import is_procthor, read_procthor
from anm_mj.scene.writer import SceneInfo, check_destination
from anm_mj.utils.file_limits import limit
from anm_mj.utils.read_file import parse_json, read_bytes, read_json

_logger = logging.getLogger(__name__)

_FARTHEST_M = 1000.0
"""Farther from the origin, a plan is in the coordinates of a survey [m]."""
_HEIGHT_M = (1.5, 20.0)
_MAX_ROOMS = limit("ANM_MJ_MAX_ROOMS", 300)
_MAX_FLOOR_M2 = limit("ANM_MJ_MAX_FLOOR_M2", 2_500)
_FORMATS = (
    ("plan-1", is_plan1, read_plan1),
    ("ProcTHOR", is_procthor, read_procthor),
    ("HouseExpo", is_houseexpo, read_houseexpo),
)


def is_floorplan(src: Path) -> bool:
    """Whether a file is a floor plan in one of the formats that can be read."""
    if src.suffix.lower() != ".json" or not src.is_file():
        return False
    try:
        plan = read_json(src)
    except (OSError, ValueError):
        return False
    return any(matches(plan) for _, matches, _ in _FORMATS)


def read_floorplan(src: Path) -> tuple[str, Building, dict[str, Any]]:
    """Format, building and document of a floor plan. Raises SceneError if the file cannot be read, is no floor plan of
    a known format, is damaged, or of no building that can be made.
    """
    try:
        plan = parse_json(read_bytes(src), parse_constant=_refuse)
    except OSError as err:
        raise SceneError(f"{src} cannot be read ({err.strerror}): give the path of a floor plan in JSON.") from err
    except ValueError as err:
        raise SceneError(f"{src} is not a JSON document ({err}): give a floor plan in JSON.") from err
    for form, matches, read in _FORMATS:
        if matches(plan):
            try:
                building = read(plan)
            except (KeyError, IndexError, TypeError, AttributeError, ValueError, ArithmeticError, ShapelyError) as err:
                raise SceneError(
                    f"{src} is a damaged {form} floor plan ({type(err).__name__}: {err}): fix or replace it."
                ) from err
            _check_size(building, src)
            return form, building, plan
    names = ", ".join(form for form, _, _ in _FORMATS)
    raise SceneError(f"{src} is no floor plan of a known format: give one of {names}.")


def import_floorplan(
    src: Path,
    out: Path,
    *,
    name: str | None = None,
    licence: str | None = None,
    source: str | None = None,
    furniture: bool = True,
) -> Scene:
    """Make a scene of a floor plan: walls, doors with lintels, windows and ceilings, furnished by the generator.

    Arguments are those of :func:`anm_mj.scene.importing.import_scene.import_scene`; licence and source are by default
    what the plan says. Raises SceneError if the plan cannot be used or the folder cannot be written.
    """
    check_destination(out)
    form, building, plan = read_floorplan(src)
    farthest_m = max(abs(bound) for room in building.rooms for bound in room.floor.bounds)
    if farthest_m > _FARTHEST_M:
        raise SceneError(
            f"{src} lies {farthest_m:.4g} m from its origin, where single precision is too coarse; floor plans end at "
            f"{_FARTHEST_M:g} m: subtract a corner of the building from its coordinates."
        )
    told = plan.get("source")
    told = told if isinstance(told, dict) else {}
    repo = f", {told['repo']}" if "repo" in told else ""
    info = SceneInfo(
        name or out.resolve().name,
        source or f"floor plan {src.name} ({form}{repo})",
        licence or str(told.get("licence", "unknown")),
    )
    rooms, passages = len(building.rooms), len(building.passages)
    counted = f"{rooms} room{'s' * (rooms != 1)}, {passages} passage{'s' * (passages != 1)}"
    _logger.info("%s: %s (%s)", src.name, counted, form)
    # The content of the file seeds the furniture.
    return write_building(building, zlib.crc32(read_bytes(src)), info, out, furniture)


def _check_size(building: Building, src: Path) -> None:
    low_m, high_m = _HEIGHT_M
    if not low_m <= building.ceiling_m <= high_m:
        raise SceneError(
            f"The walls of {src} are {building.ceiling_m:.4g} m high: give heights from {low_m:g} to {high_m:g} m."
        )
    if not 0.0 < building.door_height_m <= high_m:
        raise SceneError(
            f"The doors of {src} are {building.door_height_m:.4g} m high: give a height above 0 and up to {high_m:g} m."
        )
    if len(building.rooms) > _MAX_ROOMS:
        raise SceneError(
            f"{src} has {len(building.rooms)} rooms, but floor plans end at {_MAX_ROOMS}: give a part of it, or set "
            "ANM_MJ_MAX_ROOMS to allow more."
        )
    floor_m2 = sum(float(room.floor.area) for room in building.rooms)
    if not floor_m2 <= _MAX_FLOOR_M2:
        raise SceneError(
            f"The rooms of {src} have {floor_m2:.4g} m2, but floor plans end at {_MAX_FLOOR_M2} m2: give a part of it "
            "in metres, or set ANM_MJ_MAX_FLOOR_M2 if it should be so large."
        )


def _refuse(word: str) -> None:
    """Refuse NaN and Infinity, which Python reads although they are no JSON."""
    raise ValueError(f"it holds {word}")
