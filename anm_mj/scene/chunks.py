"""Cuts the meshes of a scene into chunks of about two metres, so that a camera can skip those outside its view.

Only the model holds chunks; the scene folder keeps whole meshes.
"""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float32, Int, Int32

from anm_mj.scene.mjcf import MIN_VERTICES, VISUAL_GROUP, read_msh

MIN_TRIANGLES = 100_000
"""Smaller scenes render too fast for culling to pay."""
CHUNK_M = 2.0
"""Side of a chunk [m]; smaller chunks cost more draw calls than they save triangles."""
MIN_FACES = 256
"""Meshes with fewer triangles stay whole: drawing them costs less than testing them."""


def cut_into_chunks(spec: mujoco.MjSpec) -> None:
    """Replace every visual mesh that never moves by one chunk per cell that holds triangles of it.

    A triangle belongs to the cell of its centre. Each triangle is drawn once, and chunks reach a little beyond their
    cells. Raises OSError if a mesh file cannot be read.
    """
    assets = Path(spec.modelfiledir) / spec.meshdir
    visual = [geom for geom in spec.worldbody.geoms if geom.group == VISUAL_GROUP and geom.meshname]
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
            _add_mesh(spec, f"{name}/{i}", vertices, uv, faces[members])
            # With the settings of the class "visual".
            spec.worldbody.add_geom(
                name=f"{name}/{i}",
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"{name}/{i}",
                material=material,
                group=VISUAL_GROUP,
                contype=0,
                conaffinity=0,
                mass=0.0,
            )


def _chunks_of(vertices: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]) -> list[Int[np.ndarray, " n"]]:
    """Indices of the faces of each chunk, in the order of the faces."""
    if len(faces) < MIN_FACES:
        return [np.arange(len(faces))]
    cells = np.floor(vertices[faces].mean(axis=1) / CHUNK_M).astype(np.int64)
    _, chunk = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(chunk.ravel(), kind="stable")
    return np.split(order, np.cumsum(np.bincount(chunk.ravel()))[:-1])


def _add_mesh(spec: mujoco.MjSpec, name: str, vertices: np.ndarray, uv: np.ndarray, faces: np.ndarray) -> None:
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
