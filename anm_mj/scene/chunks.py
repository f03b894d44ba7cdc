"""Cuts the scene's meshes into pieces of about two metres, so that a camera need not draw what lies behind it.

The pieces take the place of the meshes in the model only; the scene folder keeps its meshes whole.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Int, Int32

from anm_mj.scene.mjcf import MIN_VERTICES, VISUAL_GROUP, read_msh

if TYPE_CHECKING:
    import mujoco

MIN_TRIANGLES = 100_000
"""Smaller scenes are drawn so fast that choosing what to draw would not pay."""
CHUNK_M = 2.0
"""Side of the cells that meshes are cut along [m]: smaller ones cost more calls than they save triangles."""
MIN_FACES = 256
"""Meshes with fewer triangles are left whole: drawing them costs less than asking whether to."""


def cut_into_chunks(spec: mujoco.MjSpec) -> None:
    """Replace the visual meshes of a scene by pieces, one for each cell that holds triangles of it.

    A triangle belongs to the cell of its centre, so that each is drawn once and pieces stick out of their cells a
    little.

    Raises:
        OSError: if a mesh file cannot be read.
    """
    assets = Path(spec.modelfiledir) / spec.meshdir
    visual = [geom for geom in spec.geoms if geom.group == VISUAL_GROUP and geom.meshname]
    for geom in visual:
        mesh = spec.mesh(geom.meshname)
        if not mesh.file.endswith(".msh"):
            continue
        vertices, uv, faces = read_msh(assets / mesh.file)
        chunks = _chunks_of(vertices, faces)
        if len(chunks) < 2:
            continue
        name, material = mesh.name, geom.material
        spec.delete(geom)
        spec.delete(mesh)
        for i, members in enumerate(chunks):
            _add_chunk(spec, f"{name}/{i}", material, vertices, uv, faces[members])


def _chunks_of(vertices: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]) -> list[Int[np.ndarray, " n"]]:
    """Indices of the faces of each chunk, in the order of the faces."""
    if len(faces) < MIN_FACES:
        return [np.arange(len(faces))]
    cells = np.floor(vertices[faces].mean(axis=1) / CHUNK_M).astype(np.int64)
    _, chunk = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(chunk.ravel(), kind="stable")
    return np.split(order, np.cumsum(np.bincount(chunk.ravel()))[:-1])


def _add_chunk(
    spec: mujoco.MjSpec,
    name: str,
    material: str,
    vertices: Float32[np.ndarray, "v 3"],
    uv: Float32[np.ndarray, "w 2"],
    faces: Int32[np.ndarray, "f 3"],
) -> None:
    """Add a mesh of some of the faces, and a geom like those of the class "visual" that shows it."""
    import mujoco

    used, compact = np.unique(faces, return_inverse=True)
    # A lone triangle has too few vertices for a mesh.
    used = np.concatenate([used, np.repeat(used[:1], max(0, MIN_VERTICES - len(used)))])
    mesh = spec.add_mesh(
        name=name,
        uservert=vertices[used].ravel(),
        userface=compact.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    if len(uv):
        mesh.usertexcoord = uv[used].ravel()
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=material,
        group=VISUAL_GROUP,
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
