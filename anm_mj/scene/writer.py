"""Writes scene folders, for imported and generated scenes."""

import hashlib
import json
import logging
import math
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32
from PIL import Image

from anm_mj.errors import SceneError
from anm_mj.scene.collision import collision_boxes
from anm_mj.scene.folder import ASSETS, GEOMETRY, TOML, XML, Scene, read_scene_folder
from anm_mj.scene.importing.canonical_axes import covered_share
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.mjcf import BOX_TOP_M, Drawn, scene_mjcf, write_msh
from anm_mj.scene.movable import Movable
from anm_mj.scene.navigable import NavigableArea, choose_starts, navigable_area, with_floor_of
from anm_mj.scene.room_segmentation import segment_rooms
from anm_mj.scene.submesh import Submesh, is_within, merge_geometry, without_degenerate_faces
from anm_mj.types import DEFAULT_FOOTPRINT, Pose2

_logger = logging.getLogger(__name__)

_NARROWEST_FLOOR_M = 0.3
"""The robot's wheels need more [m]; tops of walls have less."""
_OVERLAP_M = 0.03
"""Collision boxes are up to a cell thicker than what they hold [m]."""
_PNG_COMPRESSION = 3
"""Four times as fast as Pillow's default, with files a few per cent larger."""


@dataclass(frozen=True)
class SceneInfo:
    """Facts about a scene beside its geometry."""

    name: str
    source: str
    """The file or the generator that the geometry came from."""
    licence: str
    up: str = "z"
    """Up axis of the source."""
    up_how: str = "given"
    """Or "found"."""
    scale: float = 1.0
    """Metres per unit of the source."""
    scale_how: str = "given"
    floor_removed_m: float = 0.0
    """Height of the source's floor, subtracted so that the floor is at z = 0 [m]."""
    origin_m: tuple[float, float] = (0.0, 0.0)
    """Where x = y = 0 lies in the source, turned to z up and scaled to metres [m]."""
    rooms: int | None = None
    """Number of rooms; None to count them by segmentation."""
    budget_steps: int | None = None
    cull_face: bool = False
    """Whether the renderer may cull back faces: only where every surface is closed or two-sided. Culling a one-sided
    wall would open the view into the next room."""


def with_area(submeshes: list[Submesh]) -> list[Submesh]:
    """Submeshes without triangles of no area; the log names those of which nothing is left."""
    cleaned = [without_degenerate_faces(submesh) for submesh in submeshes]
    vanished = {
        own.name: None for own, clean in zip(submeshes, cleaned, strict=True) if clean is None and len(own.faces)
    }
    if vanished:
        _logger.warning("Left out, because none of their triangles has an area: %s.", some(vanished))
    return [submesh for submesh in cleaned if submesh is not None]


def write_scene(
    submeshes: list[Submesh],
    info: SceneInfo,
    out: Path,
    starts: tuple[Pose2, ...] | None = None,
    *,
    obstacles: list[Submesh] | None = None,
    movables: tuple[Movable, ...] = (),
    on_area: Callable[[NavigableArea], None] = lambda area: None,
) -> Scene:
    """Write a scene folder and read it back; the submeshes lie in the world (z up, floor at z = 0) [m].

    Collision boxes, whether there is a ceiling, and the number of rooms and start poses (unless given) follow from
    them. The folder appears at ``out`` complete or not at all; a scene folder already there is replaced. Raises
    SceneError if there are no triangles, the robot fits nowhere, or ``out`` cannot be written.

    Args:
        submeshes: Everything in the scene.
        info: Name, origin and licence.
        out: The scene folder to make.
        starts: Start poses, the default one first; None to choose them.
        obstacles: What the robot meets, if that is not what is in ``submeshes``.
        movables: Objects that the robot may push. Submeshes and obstacles hold them too, as they stand at first, in
            parts of their name.
        on_area: Called with where the robot can stand, unless starts and rooms are given.
    """
    if not (info.name.isprintable() and 0 < len(info.name) <= 255):
        raise SceneError(f"The scene cannot be named {info.name[:80]!r}: give 1 to 255 letters that can be printed.")
    proper = with_area(submeshes)
    if not proper:
        raise SceneError(
            f"Scene {info.name} holds no triangles (of {len(submeshes)} submeshes): give a file with a surface."
        )
    vertices, faces = _single(proper)
    triangles = vertices[faces]
    arrays: dict[str, Any] = {"vertices": vertices, "faces": faces}
    solid_triangles = None
    # Where all that collides was left out, the robot meets what is drawn.
    obstacles = obstacles or None
    if obstacles is not None:
        solid_vertices, solid_faces = _single(obstacles)
        solid_triangles = solid_vertices[solid_faces]
        arrays |= {"obstacle_vertices": solid_vertices, "obstacle_faces": solid_faces}
    rooms = info.rooms
    if starts is None or rooms is None:
        area = navigable_area(triangles, DEFAULT_FOOTPRINT, solid_triangles)
        _require_width(area, info.name)
        on_area(area)
        starts = starts or choose_starts(area, DEFAULT_FOOTPRINT)
        # A scan may have no wall that submeshes a room from the open.
        drawn = triangles if solid_triangles is None else with_floor_of(triangles, solid_triangles)
        rooms = rooms or len(segment_rooms(drawn, area).area_m2) or None
    solid = obstacles or proper
    movables, boxes = _standing_free(movables, solid)
    moving = [movable.part for movable in movables]
    bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)
    entries = {
        **{key: getattr(info, key) for key in ("name", "source", "licence", "up", "up_how", "scale", "scale_how")},
        "floor_removed": round(info.floor_removed_m, 4),
        "origin": list(info.origin_m) if any(info.origin_m) else None,
        "bounds": bounds.round(4).tolist(),
        "triangles": len(faces),
        "rooms": rooms,
        "rooms_how": None if rooms is None else "given" if info.rooms else "found",
        "has_ceiling": covered_share(triangles) > 0.5,
        "cull_face": info.cull_face,
        "starts": [[pose.x_m, pose.y_m, round(math.degrees(pose.yaw_rad), 2)] for pose in starts],
        "budget_steps": info.budget_steps,
        "movables": moving or None,
        "hash": _content_hash(proper, obstacles or [], movables),
    }
    with replaced_folder(out) as folder:
        drawn = _write_assets(proper, folder / ASSETS)
        mjcf = scene_mjcf(info.name, drawn, boxes, bounds, movables)
        (folder / XML).write_text(mjcf, encoding="utf-8")
        np.savez_compressed(folder / GEOMETRY, **arrays)
        # Names of files that are no UTF-8, and the escapes of JSON, may hold what cannot be written.
        (folder / TOML).write_text(_toml(entries), encoding="utf-8", errors="replace")
    return read_scene_folder(out)


def _fixed_boxes(solid: list[Submesh], moving: list[str]) -> Float64[np.ndarray, "n 4"]:
    """Collision boxes of all but the parts that move."""
    fixed = [submesh for submesh in solid if not is_within(submesh.part, moving)]
    if not fixed:
        return np.zeros((0, 4))
    vertices, faces = _single(fixed)
    return collision_boxes(vertices[faces])


def _standing_free(
    movables: tuple[Movable, ...], solid: list[Submesh]
) -> tuple[tuple[Movable, ...], Float64[np.ndarray, "n 4"]]:
    """The movable objects that begin outside of all collision boxes, and the boxes of all else, which stays.

    A box reaches from the floor to above the robot, so that what stands on a table begins within the table's box,
    and the simulation would fling it out.
    """
    held: list[str] = []
    while True:
        boxes = _fixed_boxes(solid, [movable.part for movable in movables])
        within = [movable.part for movable in movables if _is_within_boxes(movable, solid, boxes)]
        if not within:
            break
        held += within
        movables = tuple(movable for movable in movables if movable.part not in within)
    if held:
        _logger.warning("Not movable, because they stand on or in what stays: %s.", some(dict.fromkeys(held)))
    return movables, boxes


def _is_within_boxes(movable: Movable, solid: list[Submesh], boxes: Float64[np.ndarray, "n 4"]) -> bool:
    parts = [each for each in solid if is_within(each.part, [movable.part])]
    if not parts or not len(boxes):
        return False
    own, _ = _single(parts)
    overlap_m = np.minimum(boxes[:, 2:], own[:, :2].max(axis=0)) - np.maximum(boxes[:, :2], own[:, :2].min(axis=0))
    return bool(own[:, 2].min() < BOX_TOP_M and overlap_m.min(axis=1).max() > _OVERLAP_M)


def _require_width(area: NavigableArea, name: str) -> None:
    """Refuse a floor that is nowhere wider than a wall: without one, tops of walls are the largest level surface."""
    widest_m = 2.0 * float(area.clearance_m[area.component == 1].max())
    if widest_m < _NARROWEST_FLOOR_M:
        raise SceneError(
            f"Scene {name} has no floor: its largest level surface is {widest_m:.2f} m wide, like the top of a wall; "
            "add one, as a plane in a MuJoCo world."
        )


def _single(submeshes: list[Submesh]) -> tuple[Float32[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]:
    vertices, faces = merge_geometry(submeshes)
    return vertices.astype(np.float32), faces.astype(np.int32)


@contextmanager
def replaced_folder(out: Path) -> Iterator[Path]:
    """A temporary folder that takes the place of ``out`` when the block ends well and vanishes when it does not. Raises
    SceneError if ``out`` is neither new, empty nor a scene folder, or cannot be written.
    """
    out = Path(os.path.abspath(out))
    check_destination(out)
    partial = out.with_name(f".{out.name}.{uuid.uuid4().hex[:8]}")
    old = out.with_name(f"{partial.name}.old")
    try:
        partial.mkdir(parents=True)
        yield partial
        if out.exists():
            out.rename(old)
        try:
            partial.rename(out)
        except OSError:
            if old.exists():
                old.rename(out)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as err:
        raise SceneError(
            f"{out} cannot be written ({err.strerror or err}): choose a folder that you may write to."
        ) from err
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_destination(out: Path, overwrite: bool = True) -> None:
    """Accept a folder that is new, empty or a scene folder, before any work is done for it. Raises SceneError if it is
    something else, a scene folder and ``overwrite`` is false, or the current folder or one above it.
    """
    try:
        if not overwrite and (out / TOML).is_file():
            raise SceneError(f"{out} holds a scene already: choose a new folder, or replace it with --force.")
        if out.exists() and not out.is_dir():
            raise SceneError(f"{out} is a file: choose a new folder for the scene.")
        if out.is_dir() and not (out / TOML).is_file() and any(out.iterdir()):
            raise SceneError(f"{out} is not empty and not a scene folder: choose a new folder for the scene.")
        if out.is_dir() and _is_current(out):
            raise SceneError(f"{out} is replaced as a whole, and you are in it: choose another folder for the scene.")
        parent = next(folder for folder in out.absolute().parents if folder.exists())
    except OSError as err:
        raise SceneError(f"{out} cannot be looked at ({err.strerror}): choose a folder that you may write to.") from err
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise SceneError(f"{out} cannot be written, because {parent} is not writable: choose another folder.")


def _is_current(folder: Path) -> bool:
    """Whether this program runs in a folder or below it; not where its folder was deleted."""
    try:
        return Path.cwd().is_relative_to(folder.resolve())
    except FileNotFoundError:
        return False


def _write_assets(submeshes: list[Submesh], assets: Path) -> list[Drawn]:
    assets.mkdir()
    drawn, texture_files = [], {}
    for i, submesh in enumerate(submeshes):
        name = f"{i:03d}_{re.sub(r'[^A-Za-z0-9]+', '_', submesh.name).strip('_')[:40]}".rstrip("_")
        texture_file = None
        if submesh.texture is not None:
            # A row and a column of texels are the same bytes.
            key = submesh.texture.shape, hashlib.sha256(submesh.texture.tobytes()).digest()
            texture_file = texture_files.setdefault(key, f"{name}.png")
            if texture_file == f"{name}.png":
                Image.fromarray(submesh.texture).save(assets / texture_file, compress_level=_PNG_COMPRESSION)
        uv = None if texture_file is None else submesh.uv
        write_msh(assets / f"{name}.msh", submesh.vertices_m, submesh.faces, uv)
        drawn.append(Drawn(name, f"{name}.msh", texture_file, submesh.rgb, submesh.part))
    return drawn


def _content_hash(submeshes: list[Submesh], obstacles: list[Submesh], movables: tuple[Movable, ...]) -> str:
    """sha256 over everything that can be seen or bumped into."""
    digest = hashlib.sha256("".join(map(repr, movables)).encode())
    for submesh in [*submeshes, *obstacles]:
        for array in (submesh.vertices_m, submesh.faces, submesh.uv, submesh.texture):
            digest.update(b"-" if array is None else f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
        digest.update(repr(submesh.rgb).encode())
    return digest.hexdigest()


def _toml(entries: dict[str, object]) -> str:
    # JSON's strings, numbers, booleans and arrays are TOML's too, except for the delete character.
    texts = {key: json.dumps(value, ensure_ascii=False) for key, value in entries.items() if value is not None}
    return "".join(f"{key} = {text}\n" for key, text in texts.items()).replace("\x7f", "\\u007f")
