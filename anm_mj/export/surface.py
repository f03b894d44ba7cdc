"""The mesh of a run as GLB, PLY and OBJ, each with its colours."""

from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from anm_mj.errors import RunFolderError
from anm_mj.io.mesh_file import read_coloured_mesh
from anm_mj.io.read_run import Run
from anm_mj.io.write import writing

T_Y_UP_WORLD = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""World to the axes of glTF, which has y up."""


def run_mesh(run: Run) -> trimesh.Trimesh:
    """The coloured mesh of a run, world [m]. Raises RunFolderError if the run has no mesh, or it is damaged."""
    path = run.folder.mesh
    if not path.is_file():
        raise RunFolderError(f"{run.folder.path} has no {path.name}: the run did not end, or saw no surface.")
    vertices, faces, rgb = read_coloured_mesh(path)
    return trimesh.Trimesh(vertices, faces, vertex_colors=rgb, process=False)


def surface_points(run: Run, most: int = 100_000) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """At most so many vertices of the mesh, spread evenly over their list, with their colours; none where the run has
    no mesh. Raises RunFolderError if it is damaged.
    """
    if not run.folder.mesh.is_file():
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    mesh = run_mesh(run)
    chosen = np.linspace(0, len(mesh.vertices) - 1, min(most, len(mesh.vertices))).astype(np.int64)
    colours = np.asarray(mesh.visual.vertex_colors)  # type: ignore[union-attr]
    return np.asarray(mesh.vertices)[chosen], colours[chosen, :3]


def export_glb(run: Run, out: Path) -> list[Path]:
    """``mesh.glb``: y up, as glTF has it."""
    mesh = run_mesh(run)
    mesh.apply_transform(T_Y_UP_WORLD)
    return [_written(mesh, out / "mesh.glb")]


def export_ply(run: Run, out: Path) -> list[Path]:
    """``mesh.ply``: z up."""
    return [_written(run_mesh(run), out / "mesh.ply")]


def export_obj(run: Run, out: Path) -> list[Path]:
    """``mesh.obj``: z up, colours behind the coordinates of each vertex."""
    return [_written(run_mesh(run), out / "mesh.obj")]


def _written(mesh: trimesh.Trimesh, path: Path) -> Path:
    with writing(path):
        mesh.export(path)
    return path
