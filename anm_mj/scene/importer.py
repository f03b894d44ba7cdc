"""Turns a mesh file that someone has into a scene folder that MuJoCo can load."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from anm_mj.errors import SceneError
from anm_mj.scene.folder import Scene
from anm_mj.scene.part import Part, merge_geometry
from anm_mj.scene.source import read_parts
from anm_mj.scene.upright import UNITS, find_floor, find_scale, find_up, rotation_to_z_up
from anm_mj.scene.writer import SceneInfo, check_destination, write_scene

_logger = logging.getLogger(__name__)

_FLOOR_AT_ZERO_M = 0.01
"""A floor this near to z = 0 was put there on purpose: coordinates then stay those of the file [m]."""

_MAX_EXTENT_M = 500.0
"""Larger buildings there are few; larger files are mostly misread units or a part that lies far off [m]."""

UpAxis = Literal["x", "y", "z", "auto"]


def import_scene(
    src: Path,
    out: Path,
    *,
    up: UpAxis = "auto",
    scale: float | None = None,
    name: str | None = None,
    licence: str | None = None,
    source: str | None = None,
) -> Scene:
    """Make the scene folder ``out`` from a .glb, .gltf, .obj or .ply file.

    The scene is turned to z up, scaled to metres and lowered onto its floor; x and y stay where they are. What was
    found or given is logged in one line and written into scene.toml.

    Args:
        src: The mesh file.
        out: The folder to make; a scene folder already there is replaced.
        up: The file's up axis, or "auto" to find it.
        scale: Metres per unit of the file, or None to find it among m, cm and mm.
        name: Name of the scene; the name of ``out`` by default.
        licence: Licence of the file; "unknown" by default.
        source: Where the file came from; its name by default.

    Raises:
        SceneError: if the file cannot be used, or the folder cannot be written.
    """
    src, out = Path(src), Path(out)
    if scale is not None and not (math.isfinite(scale) and scale > 0.0):
        raise SceneError(f"A scale of {scale:g} m per unit makes no sense: give 1 for m, 0.01 for cm, 0.001 for mm.")
    if up not in ("x", "y", "z", "auto"):
        raise SceneError(f"There is no up axis {up!r}: give x, y, z or auto.")
    check_destination(out)
    parts = read_parts(src)

    vertices, faces = merge_geometry(parts)
    scale_how, up_how = ("given" if scale is not None else "found"), ("given" if up != "auto" else "found")
    if scale is None:
        scale = find_scale(np.ptp(vertices[faces].reshape(-1, 3), axis=0))
    triangles = vertices[faces] * scale
    largest_m = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if largest_m > _MAX_EXTENT_M:
        raise SceneError(
            f"{src} would be {largest_m:.3g} m large at {scale:g} m per unit, but scenes end at {_MAX_EXTENT_M:g} m: "
            "give another scale, or remove stray parts."
        )
    if up == "auto":
        up = "z" if find_up(triangles, "z" if src.suffix.lower() == ".ply" else "y") == "z" else "y"
    rotation = rotation_to_z_up(up)
    floor = find_floor(triangles @ rotation.T)
    floor_m = float((triangles @ rotation.T)[:, :, 2].min()) if floor is None else floor.z_m
    if abs(floor_m) < _FLOOR_AT_ZERO_M:
        floor_m = 0.0
    _logger.info(
        "%s: %s is up (%s), 1 unit is %g m (%s, %s), the floor was at %.3f m",
        src.name,
        up,
        up_how,
        scale,
        UNITS.get(scale, "own unit"),
        scale_how,
        floor_m,
    )

    def to_world(part: Part) -> Part:
        moved = part.vertices_m * scale @ rotation.T - np.array([0.0, 0.0, floor_m])
        return replace(part, vertices_m=moved.astype(np.float32))

    info = SceneInfo(
        name=name or out.resolve().name,
        source=source or src.name,
        licence=licence or "unknown",
        up=up,
        up_how=up_how,
        scale=scale,
        scale_how=scale_how,
        floor_removed_m=floor_m,
    )
    return write_scene([to_world(part) for part in parts], info, out)
