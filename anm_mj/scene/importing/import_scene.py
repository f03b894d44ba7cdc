"""Imports meshes, worlds, scans and floor plans as scene folders."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.importing.canonical_axes import UNITS, find_floor, find_scale, find_up, rotation_to_z_up
from anm_mj.scene.importing.floorplan import import_floorplan, is_floorplan
from anm_mj.scene.importing.readers.formats import find_format
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.parsed_scene import ParsedScene
from anm_mj.scene.importing.readers.texture_limit import limit_textures
from anm_mj.scene.submesh import Submesh, merge_alike, merge_geometry
from anm_mj.scene.writer import SceneInfo, check_destination, write_scene

_logger = logging.getLogger(__name__)

_FLOOR_AT_ZERO_M = 0.01
"""A floor this near to z = 0 was put there on purpose: coordinates then stay those of the file [m]."""

_MAX_EXTENT_M = 500.0
"""Larger extents mostly mean misread units or a stray part [m]."""

UpAxis = Literal["x", "y", "z", "auto"]


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
) -> Scene:
    """Make the scene folder ``out`` from a mesh file, a Gazebo world, a scene of a known data set or a floor plan.

    The scene is rotated to z up, scaled to metres and lowered onto its floor; x and y stay. One log line and scene.toml
    say which axes and units were found or given. What cannot be imported is logged, a sentence per problem.

    Args:
        src: The file, or the folder of a scene of a known layout.
        out: The folder to make; a scene folder already there is replaced.
        source_format: A name in :data:`anm_mj.scene.importing.readers.formats.FORMATS`, "floorplan", or "auto" to
            find it.
        up: The source's up axis, or "auto" to find it.
        scale: Metres per unit of the source, or None to find it: fixed by the format, or among m, cm and mm by size.
        name: Name of the scene; the name of ``out`` by default.
        licence: Licence of the source; by default the data set's, or "unknown".
        source: Where the source came from; by default the data set and the file.
        model_paths: Folders that hold models which the source refers to.
        furniture: False to leave the rooms of a floor plan empty.

    Raises:
        SceneError: if the source cannot be used, an option has no meaning for it, or the folder cannot be written.
    """
    src, out = Path(src), Path(out)
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise SceneError(f"A scale of {scale:g} m per unit makes no sense: give 1 for m, 0.01 for cm, 0.001 for mm.")
    if up not in ("x", "y", "z", "auto"):
        raise SceneError(f"There is no up axis {up!r}: give x, y, z or auto.")
    missing = next((folder for folder in model_paths if not folder.is_dir()), None)
    if missing is not None:
        raise SceneError(f"{missing} is not a folder: give folders that hold models with --model-path.")
    check_destination(out)
    if source_format == "floorplan" or (source_format == "auto" and is_floorplan(src)):
        if up != "auto" or scale is not None or model_paths:
            raise SceneError(
                f"{src} is a floor plan, whose format fixes axes and units: leave --up, --scale and --model-path out."
            )
        return import_floorplan(src, out, name=name, licence=licence, source=source, furniture=furniture)
    found = find_format(src, source_format)
    if not furniture:
        raise SceneError(
            f"{src} is no floor plan ({found.name}), so that its furniture stays: leave --no-furniture out."
        )
    report = ImportReport()
    parsed = found.read(src, list(model_paths), report)
    report.log()

    info, submeshes = _placed(parsed, src, up, scale)
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
    info = replace(
        info,
        name=name or out.resolve().name,
        source=source or parsed.source,
        licence=licence or parsed.licence,
    )
    return write_scene(submeshes, info, out)


def _placed(parsed: ParsedScene, src: Path, up: UpAxis, scale: float | None) -> tuple[SceneInfo, list[Submesh]]:
    """The submeshes in the world, with textures that can be rendered, and how axes and units were found."""
    submeshes = parsed.submeshes
    vertices, faces = merge_geometry(submeshes)
    if not len(faces):
        raise SceneError(f"{src} holds no triangles: give a file with a surface.")
    scale_how, up_how = ("given" if scale is not None else "found"), ("given" if up != "auto" else "found")
    if scale is None and parsed.scale is not None:
        scale, scale_how = parsed.scale, "known"
    if scale is None:
        scale = find_scale(np.ptp(vertices[faces].reshape(-1, 3), axis=0))
    triangles = vertices[faces] * scale
    largest_m = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if largest_m > _MAX_EXTENT_M:
        raise SceneError(
            f"{src} would be {largest_m:.3g} m large at {scale:g} m per unit, but scenes end at {_MAX_EXTENT_M:g} m: "
            "give another scale, or remove stray parts."
        )
    if up == "auto" and math.isinf(parsed.up_certainty):
        up, up_how = parsed.up, "known"
    elif up == "auto":
        up = find_up(triangles, parsed.up, parsed.up_certainty)
    rotation = rotation_to_z_up(up)
    turned = triangles @ rotation.T
    floor = find_floor(turned)
    floor_m = float(turned[:, :, 2].min()) if floor is None else floor.z_m
    if abs(floor_m) < _FLOOR_AT_ZERO_M:
        floor_m = 0.0

    def to_world(submesh: Submesh) -> Submesh:
        moved = submesh.vertices_m * scale @ rotation.T - np.array([0.0, 0.0, floor_m])
        return replace(submesh, vertices_m=moved.astype(np.float32))

    info = SceneInfo(
        name="",
        source="",
        licence="",
        up=up,
        up_how=up_how,
        scale=scale,
        scale_how=scale_how,
        floor_removed_m=floor_m,
    )
    return info, merge_alike(limit_textures([to_world(submesh) for submesh in submeshes]))
