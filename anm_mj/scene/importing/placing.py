"""Brings a source into the world: metres, z up, floor at z = 0; doors open and a storey alone if that is wanted."""

import logging
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.errors import SceneError
from anm_mj.scene.importing.canonical_axes import R_WORLD_SOURCE, find_floor, find_scale, find_up
from anm_mj.scene.importing.choose_parts import part_of, split_stray
from anm_mj.scene.importing.doors import Doors, Leaf, find_leaves, with_doors
from anm_mj.scene.importing.readers.import_limits import check_spread
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.importing.readers.parsed_scene import Joint, ParsedScene
from anm_mj.scene.importing.readers.texture_file import limit_textures
from anm_mj.scene.importing.shading import shaded
from anm_mj.scene.importing.storeys import Storey, clip_submesh, find_storeys, pick_storey
from anm_mj.scene.movable import Movable
from anm_mj.scene.submesh import Submesh, is_within, merge_alike, triangles_of
from anm_mj.scene.writer import SceneInfo, with_area

_logger = logging.getLogger(__name__)

_FLOOR_AT_ZERO_M = 0.01
"""A floor this near to z = 0 was put there on purpose: coordinates then stay those of the file [m]."""
_MAX_EXTENT_M = 500.0
"""Larger extents mostly mean misread units [m]."""
_MIN_EXTENT_M = 0.1
_ONE_STOREY_M = 4.5
"""What is no higher has one storey [m]."""
_BELOW_DRAWN_M = 0.3
"""No floor of a building is farther below all that is drawn [m]."""
_LOW_M = 1.8
"""A building found to be lower is mostly in inches, which look like cm [m]."""
_FAR_M = 1000.0
"""Farther from the origin, single precision is coarser than a tenth of a millimetre [m]."""

UpAxis = Literal["x", "y", "z", "auto"]


@dataclass(frozen=True)
class Placed:
    """A source in the world."""

    info: SceneInfo
    world: ParsedScene
    """Textures can be rendered; submeshes that look alike are one."""
    leaves: tuple[Leaf, ...]
    """The doors' leaves as they were found, in the source's heights."""
    floors_m: tuple[float, ...]
    """Heights of the floors of all storeys that are in it, in the source's heights [m]."""


def place(
    parsed: ParsedScene, src: Path, name: str, up: UpAxis, scale: float | None, doors: Doors, wanted_storey: str | None
) -> Placed:
    """A parsed source in the world as the scene ``name``, and how axes and units were found. Raises SceneError if the
    source holds no triangles, is too large, or lacks the storey that is wanted.
    """
    if not any(len(submesh.faces) for submesh in parsed.submeshes):
        raise SceneError(f"{src} holds no triangles: give a file with a surface.")
    scale_how, up_how = ("given" if scale is not None else "found"), ("given" if up != "auto" else "found")
    if scale is None and parsed.scale is not None:
        scale, scale_how = parsed.scale, "known"
    if scale is None:
        scale = find_scale(np.ptp(triangles_of(parsed.submeshes).reshape(-1, 3), axis=0))
    parsed = _without_stray(parsed, scale)
    triangles = triangles_of(parsed.submeshes) * scale
    _check_extent(triangles, src, scale)
    check_spread(src, triangles)
    if up == "auto" and math.isinf(parsed.up_certainty):
        up, up_how = parsed.up, "known"
    elif up == "auto":
        up = find_up(triangles, parsed.up, parsed.up_certainty)
    rotation = R_WORLD_SOURCE[up]
    triangles = triangles @ rotation.T
    height_m = float(np.ptp(triangles[:, :, 2]))
    # In metres, low walls are those of an arena.
    if scale_how == "found" and scale != 1.0 and height_m < _LOW_M:
        _logger.warning(
            "The scene is only %.2g m high: if its source has another unit give --scale 0.0254 (inches) or "
            "--scale 0.3048 (feet).",
            height_m,
        )
    origin = _origin(triangles)
    # Only a source whose axes are known has joints.
    world = _turned(parsed, rotation, scale, np.array([-origin[0], -origin[1], 0.0]))
    leaves = find_leaves(world.submeshes, world.joints)
    world = with_doors(world, leaves, doors)
    if doors != "as-is" or origin.any():
        triangles = triangles_of(world.submeshes)
    if world.obstacles:
        # The robot may stand on what the camera does not see, but not on what catches things below a building.
        solid = triangles_of(world.obstacles)
        low, high = (drawn := triangles[:, :, 2]).min() - _BELOW_DRAWN_M, drawn.max()
        triangles = np.concatenate([triangles, solid[((low <= solid[:, :, 2]) & (solid[:, :, 2] <= high)).all(axis=1)]])
    is_high = float(np.ptp(triangles[:, :, 2])) > _ONE_STOREY_M
    storeys = find_storeys(triangles) if wanted_storey is not None or is_high else []
    if wanted_storey is not None:
        storey = pick_storey(storeys, wanted_storey)
        world = _with_storey(world, storey, storeys)
        storeys, floor_m = [storey], storey.floor_m
    else:
        floor = find_floor(triangles)
        floor_m = float(triangles[:, :, 2].min()) if floor is None else floor.z_m
    if abs(floor_m) < _FLOOR_AT_ZERO_M:
        floor_m = 0.0
    info = SceneInfo(
        name,
        parsed.source,
        parsed.licence,
        up=up,
        up_how=up_how,
        scale=scale,
        scale_how=scale_how,
        floor_removed_m=floor_m,
        origin_m=(float(origin[0]), float(origin[1])),
    )
    world = _lowered(world, floor_m)
    apart = [movable.part for movable in world.movables]
    world = replace(world, submeshes=merge_alike(limit_textures(shaded(with_area(world.submeshes))), apart))
    return Placed(info, world, tuple(leaves), tuple(storey.floor_m for storey in storeys))


def _without_stray(parsed: ParsedScene, scale: float) -> ParsedScene:
    """The scene without parts far away from it, which are named in the log."""
    kept, stray = split_stray(parsed.submeshes, scale)
    if not stray:
        return parsed
    named = [f"{name} ({away_m:.0f} m away)" for name, away_m in sorted(stray.items(), key=lambda item: -item[1])]
    _logger.warning("Left out, because they lie far from everything else: %s.", some(named, 8))
    parts = {part_of(submesh) for submesh in kept}
    gone = set(stray) - parts
    obstacles = parsed.obstacles
    if obstacles is not None:
        obstacles, _ = split_stray([own for own in obstacles if part_of(own) not in gone], scale)
    movables = tuple(own for own in parsed.movables if _has_any(own, parts) or not _has_any(own, gone))
    return replace(parsed, submeshes=kept, obstacles=obstacles, movables=movables)


def _has_any(movable: Movable, parts: Collection[str]) -> bool:
    return any(is_within(part, [movable.part]) for part in parts)


def _check_extent(triangles_m: Float[np.ndarray, "f 3 3"], src: Path, scale: float) -> None:
    largest_m = float(np.ptp(triangles_m.reshape(-1, 3), axis=0).max())
    if largest_m == 0.0 or _MIN_EXTENT_M <= largest_m <= _MAX_EXTENT_M:
        return
    advice = f"begin at {_MIN_EXTENT_M:g} m: give another scale."
    if largest_m > _MAX_EXTENT_M:
        advice = f"end at {_MAX_EXTENT_M:g} m: give another scale, or leave out parts with --leave-out."
    raise SceneError(f"{src} would be {largest_m:.3g} m large at {scale:g} m per unit, but scenes {advice}")


def _origin(triangles_m: Float[np.ndarray, "f 3 3"]) -> Float64[np.ndarray, "2"]:
    """The point that becomes x = y = 0: the origin, or whole metres near the middle of a scene far from it [m]."""
    flat = triangles_m.reshape(-1, 3)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    if float(np.abs([low, high]).max()) <= _FAR_M:
        return np.zeros(2)
    return np.round((low.astype(np.float64) + high) / 2.0)


def _turned(
    parsed: ParsedScene, rotation: Float64[np.ndarray, "3 3"], scale: float, shift_m: Float64[np.ndarray, "3"]
) -> ParsedScene:
    def turn(submesh: Submesh) -> Submesh:
        moved = submesh.vertices_m * scale @ rotation.T
        return replace(submesh, vertices_m=moved + shift_m if shift_m.any() else moved)

    def turn_joint(joint: Joint) -> Joint:
        factor = 1.0 if joint.hinge else scale
        limits = None if joint.limits is None else (joint.limits[0] * factor, joint.limits[1] * factor)
        return replace(
            joint,
            axis=rotation @ joint.axis,
            anchor_m=rotation @ joint.anchor_m * scale + shift_m,
            value=joint.value * factor,
            limits=limits,
        )

    if parsed.movables and scale != 1.0:
        raise SceneError(
            f"Objects that can be pushed have no mass at {scale:g} m per unit: leave --scale or --movable out."
        )
    joints = {part: turn_joint(joint) for part, joint in parsed.joints.items()}
    return replace(parsed.changed(turn, lambda movable: movable.moved(rotation, shift_m)), joints=joints)


def _with_storey(world: ParsedScene, storey: Storey, storeys: Sequence[Storey]) -> ParsedScene:
    others = [f"{own.floor_m:.2f} m ({own.walkable_m2:.0f} m2)" for own in storeys if own is not storey]
    if others:
        _logger.info("storeys: took the one at %.2f m, left out those at %s", storey.floor_m, ", ".join(others))
    cut = world.changed(
        lambda submesh: clip_submesh(submesh, storey.low_m, storey.high_m),
        lambda movable: movable if storey.low_m <= movable.centre_z_m <= storey.high_m else None,
    )
    if not cut.submeshes:
        raise SceneError(f"Nothing is left of the storey at {storey.floor_m:.2f} m.")
    return cut


def _lowered(world: ParsedScene, floor_m: float) -> ParsedScene:
    """The scene with its floor at z = 0, in single precision."""
    shift = np.array([0.0, 0.0, floor_m])
    return world.changed(
        lambda submesh: replace(submesh, vertices_m=(submesh.vertices_m - shift).astype(np.float32)),
        lambda movable: movable.moved(np.eye(3), -shift),
    )
