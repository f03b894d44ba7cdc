"""Imports meshes, worlds, scans and floor plans as scene folders."""

import logging
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.importing.canonical_axes import UNITS
from anm_mj.scene.importing.choose_parts import chosen
from anm_mj.scene.importing.doors import Doors
from anm_mj.scene.importing.import_floorplan import import_floorplan, is_floorplan
from anm_mj.scene.importing.named_scenes import find_named, is_name
from anm_mj.scene.importing.placing import UpAxis, place
from anm_mj.scene.importing.readers.import_limits import check_triangles
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.source_formats import find_format
from anm_mj.scene.importing.report_reach import report_reach
from anm_mj.scene.writer import check_destination, write_scene

_logger = logging.getLogger(__name__)


def import_scene(
    src: Path,
    out: Path,
    *,
    source_format: str = "auto",
    up: UpAxis = "auto",
    scale: float | None = None,
    name: str | None = None,
    licence: str | None = None,
    source: str | None = None,
    model_paths: Sequence[Path] = (),
    furniture: bool = True,
    only: Sequence[str] = (),
    leave_out: Sequence[str] = (),
    doors: Doors = "as-is",
    storey: str | None = None,
    settle: bool = False,
    movable: bool = False,
    groups: Sequence[int] | None = None,
    root: Path | None = None,
    overwrite: bool = True,
) -> Scene:
    """Make the scene folder ``out`` from a mesh, a Gazebo or MuJoCo world, a scene of a data set or a floor plan.

    The scene is rotated to z up, scaled to metres and lowered onto its floor; x and y stay. One log line and scene.toml
    say which axes and units were found or given. What cannot be imported is logged, a sentence per problem. Raises
    SceneError if the source cannot be used, an option has no meaning for it, or the folder cannot be written.

    Args:
        src: The file, the folder of a scene of a known layout, or a name such as "molmospaces:procthor-10k-val/12".
        out: The folder to make; a scene folder already there is replaced in one step.
        source_format: A name in :data:`anm_mj.scene.importing.readers.source_formats.FORMATS`, "floorplan", or
            "auto" to find it.
        up: The source's up axis, or "auto" to find it.
        scale: Metres per unit of the source, or None to find it: fixed by the format, or among m, cm and mm by size.
        name: Name of the scene; the name of ``out`` by default.
        licence: Licence of the source; by default the data set's, or "unknown".
        source: Where the source came from; by default the data set and the file.
        model_paths: Folders that hold models, or files of a MuJoCo world, which the source refers to.
        furniture: False to leave the rooms of a floor plan empty.
        only: Patterns of names of parts; if there are any, only parts that match one are imported.
        leave_out: Patterns of names of parts that are not imported.
        doors: State of the leaves of doors that are parts of their own.
        storey: Of several storeys only this: a number from 1 at the bottom, or the height of its floor [m].
        settle: MuJoCo worlds: drop all bodies until they rest.
        movable: MuJoCo worlds: keep free bodies as objects that the robot may push.
        groups: MuJoCo worlds: geom groups that are drawn; None for those that MuJoCo draws, 0 to 2.
        root: Where the data set of a name lies; None for what its environment variable says.
        overwrite: False to refuse a folder that holds a scene already.
    """
    src, out = Path(src), Path(out)
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise SceneError(f"A scale of {scale:g} m per unit makes no sense: give 1 for m, 0.01 for cm, 0.001 for mm.")
    if up not in ("x", "y", "z", "auto"):
        raise SceneError(f"There is no up axis {up!r}: give x, y, z or auto.")
    missing = next((folder for folder in model_paths if not os.path.isdir(folder)), None)
    if missing is not None:
        raise SceneError(f"{missing} is not a folder: give folders that hold models with --model-path.")
    check_destination(out, overwrite)
    if is_name(src):
        named = find_named(src, root)
        src, source_format = named.path, named.source_format
        source, licence = source or named.source, licence or named.licence
        groups = named.groups if groups is None else groups
        model_paths = (*model_paths, *named.folders)
    elif root is not None:
        raise SceneError(f"{src} is no name of a data set's scene: leave --root out.")
    if source_format == "floorplan" or (source_format == "auto" and is_floorplan(src)):
        if up != "auto" or scale is not None or model_paths:
            raise SceneError(
                f"{src} is a floor plan, whose format fixes axes and units: leave --up, --scale and --model-path out."
            )
        if settle or movable or groups is not None:
            raise SceneError(f"{src} is a floor plan, no MuJoCo world: leave --settle, --movable and --groups out.")
        if only or leave_out or doors != "as-is" or storey is not None:
            raise SceneError(
                f"{src} is a floor plan, which has one storey, open doors and no parts: leave --only, --leave-out, "
                "--doors and --storey out."
            )
        return import_floorplan(src, out, name=name, licence=licence, source=source, furniture=furniture)
    found = find_format(src, source_format)
    if not furniture:
        raise SceneError(
            f"{src} is no floor plan ({found.name}), so that its furniture stays: leave --no-furniture out."
        )
    if model_paths and found.is_whole:
        raise SceneError(f"{src} refers to no models elsewhere ({found.name}): leave --model-path out.")
    read = found.read
    if found.name == "mjcf":
        read = partial(read, settle=settle, movable=movable, groups=groups)
    elif settle or movable or groups is not None:
        raise SceneError(f"{src} is no MuJoCo world ({found.name}): leave --settle, --movable and --groups out.")
    report = ImportReport()
    parsed = read(src, list(model_paths), report)
    report.log()
    check_triangles(src, sum(len(submesh.faces) for submesh in parsed.submeshes))
    parsed = replace(parsed, source=source or parsed.source, licence=licence or parsed.licence)
    parsed = chosen(parsed, only, leave_out)
    placed = place(parsed, src, name or out.resolve().name, up, scale, doors, storey)
    info = placed.info
    _logger.info(
        "%s (%s): %s is up (%s), 1 unit is %g m (%s, %s), the floor was at %.3f m",
        src.name,
        found.name,
        info.up,
        info.up_how,
        info.scale,
        UNITS.get(info.scale, "own unit"),
        info.scale_how,
        info.floor_removed_m,
    )
    if any(info.origin_m):
        _logger.info("x = y = 0 is at (%.0f, %.0f) m of the source, which lies far from its origin", *info.origin_m)
    return write_scene(
        placed.world.submeshes,
        info,
        out,
        obstacles=placed.world.obstacles,
        movables=placed.world.movables,
        on_area=partial(report_reach, placed=placed, doors=doors),
    )
