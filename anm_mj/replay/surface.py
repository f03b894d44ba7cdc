"""The final mesh of a run as replay and film show it: how certain it is, and when each face was first seen.

A vertex appears with the first frame whose depth has a surface within a tolerance of it. So nothing has to be stored
during the run, and a run of an older version grows as well.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from scipy.spatial import KDTree

from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.geometry.connected_components import connected_components
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.mesh_file import read_coloured_mesh
from anm_mj.io.read_run import Run
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import Intrinsics
from anm_mj.utils.progress import Progress, unheard
from anm_mj.viz.shapes import CEILING_CUT_M

LARGE_M2, FAR_M = 1.0, 0.3
"""Pieces of the surface of less area are left out where no larger one lies above, below or so near beside them [m]."""
TOLERANCE_M, TOLERANCE_SHARE = 0.06, 0.02
"""A vertex is seen where depth differs from its own by less than this [m], plus this share of it."""


@dataclass(frozen=True)
class GrowingMesh:
    """The mesh of the finished map below the ceiling cut, its faces in the order in which they were first seen."""

    vertices_m: Float32[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    rgb: UInt8[np.ndarray, "v 3"]
    first_frame: Int[np.ndarray, " v"]
    """Index of the frame that first saw each vertex."""
    face_count: Int[np.ndarray, " n"]
    """Number of faces seen up to and with each frame."""
    error_m: Float32[np.ndarray, " v"] | None
    """Expected error of the final map at each vertex [m]; None without a map."""
    true_error_m: Float32[np.ndarray, " v"] | None = None
    """Distance of each vertex to the true surface [m]; None where the run does not have it."""


def growing_mesh(
    run: Run, max_faces: int | None = None, on_progress: Progress = unheard, *, with_errors: bool = True
) -> GrowingMesh | None:
    """The mesh of a run; None where it has none, as a killed run. Vertices are merged until there are at most
    ``max_faces``, None = as they are. ``with_errors``: the map is asked how certain it is, and the mesh is compared
    with the true surface. Raises RunFolderError if mesh, depth or true surface cannot be read, and MapError if the map
    cannot be read.
    """
    if not run.folder.mesh.is_file():
        return None
    vertices, faces, rgb = _of_faces(
        *read_coloured_mesh(run.folder.mesh), lambda points_m, faces: np.all(points_m[faces, 2] < CEILING_CUT_M, axis=1)
    )
    vertices, faces, rgb = _of_faces(vertices, faces, rgb, without_shards)
    size_m = 0.05
    while max_faces is not None and len(faces) > max_faces:
        size_m *= 1.25
        vertices, faces, rgb = merged(vertices, faces, rgb, size_m)
    first = first_seen(run, vertices, on_progress)
    of_face = first[faces].max(axis=1) if len(faces) else np.zeros(0, np.int64)
    order = np.argsort(of_face, kind="stable")
    count = np.searchsorted(of_face[order], np.arange(len(run.frames)), side="right")
    points, error_m, true_error_m = vertices.astype(np.float64), None, None
    if with_errors and run.folder.map.is_file() and len(vertices):
        error_m = NeuralMap.load(run.folder.map, device="cpu").expected_error_m(points)
    if with_errors and run.folder.ground_truth.is_file() and len(vertices):
        truth = GroundTruth.load(run.folder.ground_truth)
        true_error_m = surface_distance(points, truth.vertices.astype(np.float64), truth.faces).astype(np.float32)
    return GrowingMesh(vertices.astype(np.float32), faces[order], rgb, first, count, error_m, true_error_m)


def merged(
    vertices_m: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], rgb: UInt8[np.ndarray, "v 3"], size_m: float
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"], UInt8[np.ndarray, "w 3"]]:
    """A lighter mesh: all vertices of a cube become their mean, and faces that collapse go.

    Source: Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.
    """
    cell = np.floor(vertices_m / size_m).astype(np.int64)
    _, place, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    place = place.reshape(-1)
    both = np.concatenate([vertices_m, rgb], axis=1)
    mean = np.stack([np.bincount(place, column) for column in both.T], axis=1) / count[:, None]
    faces = place[faces]
    a, b, c = faces.T
    return mean[:, :3], faces[(a != b) & (b != c) & (a != c)], np.rint(mean[:, 3:]).astype(np.uint8)


def without_shards(vertices_m: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
    """Which faces to show: none of the small pieces far from all large ones, as glimpses through windows leave them."""
    if not len(faces):
        return np.zeros(0, bool)
    piece = connected_components(faces[:, [0, 1, 1, 2]].reshape(-1, 2), len(vertices_m))[faces[:, 0]]
    a, b, c = vertices_m[faces].transpose(1, 0, 2)
    area_m2 = np.bincount(piece, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)
    middle = ((a + b + c) / 3.0)[:, :2]
    is_large = area_m2[piece] >= LARGE_M2
    if not is_large.any():
        return np.ones(len(faces), bool)
    far = KDTree(middle[is_large]).query(middle[~is_large], distance_upper_bound=FAR_M)[0] > FAR_M
    near_faces = np.bincount(piece[~is_large], ~far, minlength=len(area_m2))
    return is_large | (near_faces[piece] > 0)


def first_seen(
    run: Run, vertices_m: Float[np.ndarray, "v 3"], on_progress: Progress = unheard
) -> Int[np.ndarray, " v"]:
    """Index of the frame that first saw each vertex; a vertex that none saw takes that of its nearest neighbour.

    In a continued run, what none of its frames saw was there from the start. Depth and believed poses of the run are
    read. Raises RunFolderError if a depth image is missing or damaged.
    """
    points = np.asarray(vertices_m, np.float32)
    first = np.full(len(points), -1)
    waiting = np.arange(len(points))
    for index, frame in enumerate(run.frames):
        # Where a lost camera is taken to be, it may never have been.
        if len(waiting) and not frame.is_lost:
            depth_m = run.depth_mm(frame).astype(np.float32) / 1000.0
            seen = _seen(points[waiting], depth_m, run.intrinsics, frame.T_world_camera)
            first[waiting[seen]] = index
            waiting = waiting[~seen]
        on_progress(index + 1, len(run.frames))
    if len(waiting) and run.manifest.get("continued_from"):
        first[waiting] = 0
    elif len(waiting):
        found = first >= 0
        first[waiting] = first[found][KDTree(points[found]).query(points[waiting])[1]] if found.any() else 0
    return first


def _of_faces(
    vertices: np.ndarray, faces: np.ndarray, rgb: np.ndarray, which: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kept = faces[which(vertices, faces)]
    used, place = np.unique(kept, return_inverse=True)
    return vertices[used], place.reshape(-1, 3), rgb[used]


def _seen(
    points_m: Float32[np.ndarray, "n 3"],
    depth_m: Float32[np.ndarray, "rows cols"],
    intrinsics: Intrinsics,
    T_world_camera: Float[np.ndarray, "4 4"],
) -> np.ndarray:
    """Which points a frame has a surface at."""
    rotation, origin = T_world_camera[:3, :3].astype(np.float32), T_world_camera[:3, 3].astype(np.float32)
    x, y, z = ((points_m - origin) @ rotation).T
    safe_z = np.where(z > 0.05, z, np.float32(1.0))
    rows, cols = depth_m.shape
    col = np.floor((intrinsics.fx * x / safe_z + intrinsics.cx) * (cols / intrinsics.width)).astype(np.int64)
    row = np.floor((intrinsics.fy * y / safe_z + intrinsics.cy) * (rows / intrinsics.height)).astype(np.int64)
    inside = (z > 0.05) & (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
    seen = np.zeros(len(points_m), bool)
    measured = depth_m[row[inside], col[inside]]
    seen[inside] = (measured > 0.0) & (np.abs(measured - z[inside]) < TOLERANCE_M + TOLERANCE_SHARE * z[inside])
    return seen
