"""Finds the leaves of doors among the parts of a scene, and opens or shuts them."""

import logging
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float64

from anm_mj.scene.importing.choose_parts import part_of, path_to
from anm_mj.scene.importing.readers.import_report import some
from anm_mj.scene.importing.readers.parsed_scene import Joint, ParsedScene
from anm_mj.scene.submesh import Submesh, is_within, transformed

_logger = logging.getLogger(__name__)

Doors = Literal["as-is", "open", "closed"]

_WORDS = re.compile(r"door|tuer|tür|porte(?![a-z])|puerta|(?<![a-z])gate(?![a-z])")
_NO_DOOR = re.compile(
    r"outdoor|indoor|wardrobe|cabinet|closet|cupboard|fridge|refrigerator|freezer|oven|microwave|dishwasher|locker|"
    r"drawer|shower|cage|doormat|doorbell|doorstop"
)
"""Furniture has doors too, and no robot drives through them."""
_NO_LEAF = re.compile(r"frame|jamb|lintel|doorway|knob|handle|hinge|threshold|trim|casing")
_WIDTH_M, _HEIGHT_M, _DEPTH_M = (0.4, 3.0), (1.5, 4.0), 0.4
"""Measures of a leaf, its handles included [m]."""
_OPEN_RAD = math.pi / 2.0
_SHUT = 0.1
"""A leaf is shut within this much of its closed end [rad, m]."""


@dataclass(frozen=True)
class Leaf:
    """The leaf of a door."""

    part: str
    joint: Joint | None
    """What it hangs on; None for one that is only named like a door."""

    @property
    def is_shut(self) -> bool:
        """Whether it stands in its doorway."""
        return self.joint is None or abs(self.joint.value - _closed_value(self.joint)) < _SHUT


def find_leaves(submeshes: Sequence[Submesh], joints: Mapping[str, Joint]) -> list[Leaf]:
    """The leaves of doors among the parts of a scene in the world (z up) [m].

    A leaf is upright and thin, as wide and high as a door, and hangs on a vertical hinge or slides level; without a
    joint its name must say that it is a door.
    """
    groups: dict[str, list[Float[np.ndarray, "v 3"]]] = {}
    for submesh in submeshes:
        if not len(submesh.faces):
            continue
        used = submesh.vertices_m[np.unique(submesh.faces)]
        for part in path_to(part_of(submesh)):
            groups.setdefault(part, []).append(used)
    found: list[Leaf] = []
    for part in sorted(groups, key=lambda name: (-name.count("/"), name)):
        joint = joints.get(part)
        if any(is_within(leaf.part, [part]) for leaf in found) or not _may_be_leaf(part, joint):
            continue
        if _is_door_sized(np.concatenate(groups[part])):
            found.append(Leaf(part, joint))
    return sorted(found, key=lambda leaf: leaf.part)


def _may_be_leaf(part: str, joint: Joint | None) -> bool:
    name = part.lower()
    if _NO_DOOR.search(name) or _NO_LEAF.search(name.rpartition("/")[2]):
        return False
    if joint is None:
        return _WORDS.search(name) is not None
    upright = abs(float(joint.axis[2]))
    return upright > 0.9 if joint.hinge else upright < 0.1


def _is_door_sized(points_m: Float[np.ndarray, "n 3"]) -> bool:
    from shapely import MultiPoint, Polygon

    height_m = float(np.ptp(points_m[:, 2]))
    if not _HEIGHT_M[0] <= height_m <= _HEIGHT_M[1] or float(np.ptp(points_m[:, :2], axis=0).max()) > 2 * _WIDTH_M[1]:
        return False
    outline = MultiPoint(points_m[:, :2]).minimum_rotated_rectangle
    if not isinstance(outline, Polygon):
        x_min, y_min, x_max, y_max = outline.bounds
        return _WIDTH_M[0] <= math.hypot(x_max - x_min, y_max - y_min) <= _WIDTH_M[1]
    corners = np.asarray(outline.exterior.coords)
    sides = sorted(float(length) for length in np.linalg.norm(np.diff(corners[:3], axis=0), axis=1))
    return sides[0] <= _DEPTH_M and _WIDTH_M[0] <= sides[1] <= _WIDTH_M[1]


def _closed_value(joint: Joint) -> float:
    """The value at which a leaf is shut: 0, or the end nearest to it."""
    return 0.0 if joint.limits is None else min(max(0.0, joint.limits[0]), joint.limits[1])


def _open_value(joint: Joint) -> float:
    """The value at which a leaf leaves its doorway free: the end farthest from the shut one, at most 90 degrees."""
    closed = _closed_value(joint)
    if joint.limits is None:
        return closed + (_OPEN_RAD if joint.hinge else 1.0)
    end = max(joint.limits, key=lambda value: abs(value - closed))
    reach = _OPEN_RAD if joint.hinge else math.inf
    return closed + max(-reach, min(reach, end - closed))


def with_doors(world: ParsedScene, leaves: Sequence[Leaf], doors: Doors) -> ParsedScene:
    """The scene with all doors open or closed, as the log says; leaves without a joint are taken out to be open."""
    if doors == "as-is":
        return world
    motions: dict[str, tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3"]]] = {}
    for leaf in leaves:
        if leaf.joint is not None:
            to = _open_value(leaf.joint) if doors == "open" else _closed_value(leaf.joint)
            motions[leaf.part] = leaf.joint.motion(to)
    gone = [leaf.part for leaf in leaves if leaf.joint is None and doors == "open"]
    word = "opened" if doors == "open" else "closed"
    said = [f"{word} {len(motions)} ({some(motions, 6)})"] if motions else []
    said += [f"took out {len(gone)} without a hinge ({some(gone, 6)})"] if gone else []
    _logger.info("doors: %s", ", ".join(said) or "no part of the source looks like the leaf of a door")

    def move(submesh: Submesh) -> Submesh | None:
        own = next((part for part in (*motions, *gone) if is_within(part_of(submesh), [part])), None)
        return submesh if own is None else transformed(submesh, *motions[own]) if own in motions else None

    return world.changed(move)
