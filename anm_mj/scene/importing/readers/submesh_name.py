"""Finds what of a mesh file a Gazebo world means by the name of a submesh."""

import os
import re
import struct
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from anm_mj.scene.importing.readers.collada_check import collada_nodes
from anm_mj.scene.importing.readers.gltf_file import gltf_nodes, open_gltf
from anm_mj.scene.submesh import Submesh

_ENDING = re.compile(r"[-_.](mesh|geometry|lib|shape)")
"""What exporters append to the name of an object for that of its geometry."""

Nodes = Mapping[str, Collection[str]]
"""The geometries of a mesh file that its nodes place, by the names of the nodes."""


def nodes_of(src: Path) -> Nodes:
    """The nodes of a mesh file; none where its format has none, or it cannot be read."""
    try:
        if src.suffix.lower() == ".dae":
            return collada_nodes(src)
        if src.suffix.lower() in (".glb", ".gltf"):
            return gltf_nodes(open_gltf(src, os.path.getsize(src)))
    # What is wrong with a file is said where its triangles are read.
    except (struct.error, ValueError, TypeError, AttributeError, LookupError, OSError):
        pass
    return {}


def named_submeshes(nodes: Nodes, submeshes: Sequence[Submesh], wanted: str) -> list[Submesh]:
    """Those submeshes of a mesh file that Gazebo calls ``wanted``, in whatever letters; none where nothing is.

    Gazebo calls a submesh after the node that places it. Where no node has the name, a geometry may have it, with a
    word of its exporter behind if need be.
    """
    wanted = wanted.lower()
    geometries = {name for names in nodes.values() for name in names}
    own = [(_geometry(submesh.name, geometries).lower(), submesh) for submesh in submeshes]
    placed = {name.lower() for node, names in nodes.items() if node.lower() == wanted for name in names}
    for names in (placed, {wanted}):
        found = [submesh for name, submesh in own if name in names]
        if found:
            return found
    return [
        submesh for name, submesh in own if name.startswith(wanted) and _ENDING.fullmatch(name.removeprefix(wanted))
    ]


def _geometry(submesh: str, geometries: Collection[str]) -> str:
    """The geometry that a submesh is of: a number stands behind its name where it has several materials or places."""
    stem, _, number = submesh.rpartition("_")
    return stem if submesh not in geometries and stem in geometries and number.isdecimal() else submesh
