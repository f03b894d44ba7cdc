"""The mesh of the neural map as a PLY file with colours."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int, Num, UInt8

from anm_mj.errors import RunFolderError
from anm_mj.geometry.triangles import checked_triangles
from anm_mj.io.write import writing
from anm_mj.utils.files import atomic_write
from anm_mj.utils.read_file import read_bytes

if TYPE_CHECKING:
    import trimesh

logger = logging.getLogger(__name__)

MESH_RESOLUTION_M = 0.05
"""Grid that the mesh of a run is made on [m] (the paper's released code)."""
GREY = 102
"""Colour of a surface whose file holds none, each of red, green and blue."""


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> None:
    """Write a mesh, whole or not at all; a mesh without faces is logged and not written. Raises RunFolderError if the
    file cannot be written.
    """
    if len(mesh.faces) == 0:
        logger.warning("The neural map holds no surface, so %s is not written.", path.name)
        return
    with writing(path), atomic_write(path) as partial:
        mesh.export(partial, file_type="ply")
    logger.info("Wrote %s: %d vertices, %d faces.", path, len(mesh.vertices), len(mesh.faces))


def read_mesh(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices (world [m]) and faces of a mesh file. Raises RunFolderError if it is cut short or holds no mesh."""
    return _read(path)[:2]


def read_coloured_mesh(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], UInt8[np.ndarray, "v 3"]]:
    """Vertices (world [m]), faces and the vertices' colours of a mesh file; grey where it has none. Raises
    RunFolderError as :func:`read_mesh`.
    """
    vertices, faces, stated = _read(path)
    if stated is None:
        return vertices, faces, np.full(vertices.shape, GREY, np.uint8)
    try:
        rgb = _rgb8(np.asarray(stated)[:, :3])
        if rgb.shape != vertices.shape:
            raise ValueError(f"{len(rgb)} colours for {len(vertices)} vertices")
    except Exception as err:
        raise _no_mesh(path, err) from err
    return vertices, faces, rgb


def _read(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"], Any]:
    """Vertices, faces, and the vertices' colours as the file has them; None where it has none."""
    # No run waits for these before its first step.
    from trimesh.exchange.ply import load_ply
    from trimesh.geometry import triangulate_quads

    try:
        # As arrays: a Trimesh and a scene about it take a hundred times as long.
        mesh = load_ply(io.BytesIO(read_bytes(path)))
        vertices, faces = checked_triangles(mesh["vertices"], triangulate_quads(mesh["faces"]))
    except Exception as err:
        # Readers of trimesh raise whatever the damaged bytes lead them to.
        raise _no_mesh(path, err) from err
    return vertices.astype(np.float64), faces.astype(np.int64), mesh.get("vertex_colors")


def _rgb8(stated: Num[np.ndarray, "v c"]) -> UInt8[np.ndarray, "v c"]:
    """Colours of 0 to 255, from shares or from whole numbers of 8 or 16 bits, whatever the type that holds them."""
    is_whole, stated = stated.dtype.kind in "iu", np.nan_to_num(stated.astype(np.float64), posinf=0.0)
    most = stated.max(initial=0.0)
    # Shares may exceed 1 by a rounding; of 255, 2 is black.
    full = 1.0 if most < 2.0 and not is_whole else 255.0 if most <= 255.0 else 65535.0
    return np.rint(np.clip(stated / full, 0.0, 1.0) * 255.0).astype(np.uint8)


def _no_mesh(path: Path, err: Exception) -> RunFolderError:
    return RunFolderError(f"{path} cannot be read as a mesh ({err}); copy the run again, or delete the mesh.")
